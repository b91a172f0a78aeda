"""The models of cross-validation on disk, so that each object can be met by one that has not seen it.

`fold_models/<fold>/` holds a model as `save_model` leaves it; `fold_models/objects.json` says of each object its fold
and its digest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from spgf_torch.affordance.model import GraspModel, load_model, save_model
from spgf_torch.errors import InputError
from spgf_torch.files.digests import KEY as SEAL
from spgf_torch.files.digests import sealed_json
from spgf_torch.files.reading import json_values
from spgf_torch.files.writing import write_bytes
from spgf_torch.objects.grasp_object import GraspObject

FOLDER, LIST = "fold_models", "objects.json"


@dataclass(frozen=True)
class FoldModels:
    """Models by fold, and the objects that each has not seen: name -> (fold, digest)."""

    models: Mapping[int, GraspModel]
    novel: Mapping[str, tuple[int, str]]

    def fold_of(self, obj: GraspObject) -> int:
        """The fold whose model has not seen this object. Raises InputError where there is none."""
        fold, digest = self.novel.get(obj.name, (None, None))
        if fold is None or digest != obj.digest:
            got = "another object of its name" if fold is not None else "no such object"
            raise InputError(f"held_out: expected objects of the run's cross-validation, got {obj.name}: {got} there")
        return fold


def save_fold_models(
    models: Mapping[int, GraspModel], objects: Sequence[GraspObject], folds: Sequence[int], run: Path
) -> None:
    """Leave the models in the run's folder; folds: of each object, the one whose model has not seen it."""
    for fold, model in models.items():
        folder = run / FOLDER / str(fold)
        folder.mkdir(parents=True)
        save_model(model, folder)
    about = {obj.name: {"fold": fold, "digest": obj.digest} for obj, fold in zip(objects, folds, strict=True)}
    write_bytes(run / FOLDER / LIST, sealed_json(about, indent=1, sort_keys=True))


def load_fold_models(run: Path, device: str = "cpu") -> FoldModels:
    """The models that `save_fold_models` left. Raises InputError where there are none, or they are damaged."""
    novel = novel_by_fold(run)
    folds = sorted({fold for fold, _ in novel.values()})
    return FoldModels({fold: load_model(run / FOLDER / str(fold), device) for fold in folds}, novel)


def novel_by_fold(run: Path) -> dict[str, tuple[int, str]]:
    """Of each object of the run the fold whose model has not seen it, and its digest. Raises InputError as above."""
    path = run / FOLDER / LIST
    if not path.is_file():
        raise InputError(
            f"{path}: expected the models of cross-validation (train fold_models=true leaves them), found no such file"
        )
    try:
        listed = json_values(path, "the folds of objects", sealed=True)
        return {name: (int(row["fold"]), str(row["digest"])) for name, row in listed.items() if name != SEAL}
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"{path}: expected fold and digest of each object, got something else") from None
