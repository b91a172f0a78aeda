"""Which model Figs. 1 to 13 picture, and what is novel to it."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from report_runs import tiny_model, train_config, write_run

from spgf_torch.errors import InputError
from spgf_torch.experiment.held_out import save_fold_models
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.runs import Notes, load_runs
from spgf_torch.reporting.data.sweep import find_sweep
from spgf_torch.reporting.figures.learned import Members
from spgf_torch.reporting.pages.context import Context, choose
from spgf_torch.reporting.pages.pictured import check_asked, looks, pictured, some_objects

CLASSES = {"mug": "containers", "jar": "containers", "can": "containers", "tin": "boxes", "egg": "curved"}
OBJECTS: Any = {name: SimpleNamespace(name=name, category=of, digest=name[::-1]) for name, of in CLASSES.items()}


def context(folder: Path, notes: Notes, fold: int | None = None, K: int | None = None) -> Context:
    config = ReportConfig(str(folder), "nested", ["paper"], None, K, fold, 1, 1, 4, 5, 100, 0)
    return choose(config, find_sweep(load_runs(config.runs, notes), 100, 0, notes), notes)


def test_a_fold_of_the_wanted_k_is_shown_with_what_it_has_not_seen(tmp_path: Path) -> None:
    """Fold 1 of K = 4 has two rims; egg is another object than the run's, mug belongs to fold 0."""
    write_run(tmp_path / "2026-01-01_00-00-00_a", K=3)
    run, notes = write_run(tmp_path / "2026-01-01_00-00-01_b", K=4, model=False), Notes()
    models = {fold: tiny_model(K, train_config(K)) for fold, K in ((0, 3), (1, 4))}
    strange = SimpleNamespace(name="egg", category="curved", digest="another")
    save_fold_models(models, [OBJECTS["mug"], OBJECTS["jar"], strange], [0, 1, 1], run)  # type: ignore[list-item]
    shown = pictured(context(tmp_path, notes, fold=1, K=4), OBJECTS)
    assert (shown.run.K, shown.fold, [obj.name for obj in shown.novel]) == (4, 1, ["jar"])
    assert [look.name for look in shown.looks] == ["surface 0", "wall 1", "rim 2", "rim 3"] and not notes.lines
    assert len({look.colour for look in shown.looks}) == 4 and shown.whose == "the model of fold 1, K = 4"
    assert pictured(context(tmp_path, notes, K=4), OBJECTS).fold == 0
    check_asked(context(tmp_path, notes, fold=1, K=4))
    with pytest.raises(InputError, match="fold: expected one of 0, 1, got 2"):
        check_asked(context(tmp_path, notes, fold=2, K=4))
    with pytest.raises(
        InputError, match=r"fold: expected a run of K = 3 .pictured. that keeps .* got none that could show fold 0"
    ):
        check_asked(context(tmp_path, notes, fold=0, K=3))
    with pytest.raises(InputError, match=r"^pictured: expected a K of runs with a model \(3, 4\), got 5$"):
        check_asked(context(tmp_path, notes, K=5))


def test_without_models_of_folds_that_of_all_objects_is_shown_and_told(tmp_path: Path) -> None:
    write_run(tmp_path / "run", K=3)
    shown = pictured(context(tmp_path, notes := Notes()), OBJECTS)
    assert shown.fold is None and not shown.novel and shown.members is None
    check_asked(context(tmp_path, notes))
    assert len(notes.lines) == 1 and "train +K=10 fold_models=true" in notes.lines[0]


def test_notes_tell_shares_and_twins() -> None:
    """A bend to one side and to the other, and a plane that half of the features belong to."""
    degrees = np.zeros((3, 2, 36, 2))
    degrees[:, 1] = 90, 180
    degrees[0, 0, 1:5], degrees[1, 0, -4:] = (30, 60), (30, 60)
    members = Members(np.array([0.2, 0.3, 0.5]), degrees, np.ones((3, 2, 36)))
    notes = [look.note for look in looks(degrees, members, 0.03)]
    assert notes == ["20 % of features, mirror twin of 1", "30 % of features, mirror twin of 0", "50 % of features"]
    assert [look.note for look in looks(degrees, None, 0.03)] == ["mirror twin of 1", "mirror twin of 0", ""]


def test_some_objects_of_each_class() -> None:
    """First and last by name, of classes in the table's order."""
    assert [obj.name for obj in some_objects(list(OBJECTS.values()), 2)] == ["can", "mug", "tin", "egg"]
