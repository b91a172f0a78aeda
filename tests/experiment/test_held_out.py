"""Which model has not seen an object, and whether another run's prototypes have."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.experiment import dictionary
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.dictionary import Dictionary, load_dictionary
from spgf_torch.experiment.held_out import FoldModels, novel_by_fold
from spgf_torch.files.digests import sealed_json


def thing(name: str, digest: str | None = None) -> Any:
    return SimpleNamespace(name=name, digest=digest or f"digest of {name}")


NOVEL = {name: (fold, f"digest of {name}") for name, fold in {"a": 0, "b": 2, "c": 0, "d": 2}.items()}


def test_the_fold_of_an_object_follows_from_name_and_content() -> None:
    folds = FoldModels({}, NOVEL)
    assert [folds.fold_of(thing(name)) for name in "abcd"] == [0, 2, 0, 2]
    with pytest.raises(InputError, match=r"cross-validation, got a: another object of its name there"):
        folds.fold_of(thing("a", "digest of b"))
    with pytest.raises(InputError, match=r"cross-validation, got e: no such object there"):
        folds.fold_of(thing("e"))


def test_the_list_of_folds(tmp_path: Path) -> None:
    """As it was written, without its seal; anything else is refused in a line."""
    with pytest.raises(InputError, match=r"objects.json: expected the models of cross-validation .*, found no such"):
        novel_by_fold(tmp_path)
    (tmp_path / "fold_models").mkdir()
    path = tmp_path / "fold_models/objects.json"
    rows = {name: {"fold": fold, "digest": digest} for name, (fold, digest) in NOVEL.items()}
    path.write_bytes(sealed_json(rows, indent=1))
    assert novel_by_fold(tmp_path) == NOVEL
    path.write_bytes(sealed_json({"a": {"fold": 1}}, indent=1))
    with pytest.raises(InputError, match=r"objects.json: expected fold and digest of each object, got something else"):
        novel_by_fold(tmp_path)
    path.write_text(json.dumps(rows)[:-3])
    with pytest.raises(InputError, match=r"objects.json"):
        novel_by_fold(tmp_path)


DESIGN = Design(np.array([0, 1, 0, 1]), np.arange(4), limit=4)
CENTRES = {None: torch.full((3, 2), 9.0), 0: torch.full((3, 2), 1.0), 2: torch.full((3, 2), 2.0)}


def model(fold: int | None, **settings: Any) -> Any:
    return SimpleNamespace(
        centres=CENTRES[fold], settings={"features": {}, "hand": {"name": "claw"}, "taught": {}, **settings}
    )


def dictionary_of(
    folder: Path, monkeypatch: pytest.MonkeyPatch, novel: dict[str, tuple[int, str]] | None, **settings: Any
) -> Dictionary:
    """Loaded from a run whose models are said to be these; None: one without models of folds."""
    if novel is not None:
        (folder / "fold_models").mkdir(exist_ok=True)
        (folder / "fold_models/objects.json").write_text("{}")
    theirs = FoldModels({0: model(0), 2: model(2)}, novel or {})
    monkeypatch.setattr(dictionary, "load_model", lambda *asked: model(None, **settings))
    monkeypatch.setattr(dictionary, "load_fold_models", lambda *asked: theirs)
    config = TrainConfig(K=3, prototypes_from=str(folder), device="cpu")
    found = load_dictionary(config, DESIGN, [thing(name) for name in "abcd"])
    assert found is not None
    return found


def test_each_fold_gets_the_prototypes_that_have_not_seen_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Theirs of fold 0 has not seen a and c, which are fold 0 here; theirs of fold 2 not b and d, here of fold 1."""
    found = dictionary_of(tmp_path, monkeypatch, NOVEL, taught={"a": "digest of a"})
    assert [float(found(test)[0, 0]) for test in (0, 1, None)] == [1, 2, 9]
    assert found.about["by_fold"] and found.about["seen"] == 0 and found.about["hand"] == "claw"
    assert found.told.endswith(", which has seen none of the novel objects")


@pytest.mark.parametrize(
    "novel",
    [
        None,
        {**NOVEL, "c": (2, "digest of c")},  # of the objects novel here in fold 0 each model knows one
        {**NOVEL, "d": (2, "another")},
        {name: NOVEL[name] for name in "abc"},
        {name: (fold, "another") for name, (fold, _) in NOVEL.items()},
    ],
)
def test_one_fold_that_was_seen_is_one_too_many(
    novel: dict[str, tuple[int, str]] | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Then all folds get the prototypes of the model of all objects; of a, b and c it knows b and c."""
    taught = {"a": "another", "b": "digest of b", "c": "digest of c", "e": "digest of e"}
    found = dictionary_of(tmp_path, monkeypatch, novel, taught=taught)
    assert [float(found(test)[0, 0]) for test in (0, 1, None)] == [9, 9, 9]
    assert not found.about["by_fold"] and found.about["seen"] == 2
    assert "knows the shapes of 2 of the novel objects, not their outcomes" in found.told


def test_a_model_that_does_not_say_what_it_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = dictionary_of(tmp_path, monkeypatch, None, taught=None)
    assert found.about["seen"] is None and found.told.endswith("which does not say what objects it knows")
    assert found.told.startswith(f"prototypes of a model of claw ({found.about['sha256'][:16]})")
    assert load_dictionary(TrainConfig(prototypes_from=None), DESIGN, []) is None
