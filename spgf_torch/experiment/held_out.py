"""The models and judges of cross-validation on disk, so that each object can be met by one that has not seen it.

`fold_models/<fold>/` holds a model as `save_model` leaves it, `folds/<fold>/` in a judge's folder a judge as
`save_judge` does; `objects.json` beside them says of each object its fold and its digest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from spgf_torch.affordance.model import GraspModel, load_model, save_model
from spgf_torch.errors import InputError
from spgf_torch.experiment.named import Identity
from spgf_torch.files.digests import KEY as SEAL
from spgf_torch.files.digests import sealed_json
from spgf_torch.files.reading import json_values
from spgf_torch.files.writing import write_bytes
from spgf_torch.proposing.judge import Judge, load_judge, save_judge

FOLDER, JUDGES, LIST = "fold_models", "folds", "objects.json"
# Folder -> what makes it.
_MADE_BY = {FOLDER: "train fold_models=true", JUDGES: "judge fold_judges=true"}
Learned = TypeVar("Learned", GraspModel, Judge)


@dataclass(frozen=True)
class FoldModels(Generic[Learned]):
    """Models, or judges, by fold, and the objects that each has not seen: name -> (fold, digest)."""

    models: Mapping[int, Learned]
    novel: Mapping[str, tuple[int, str]]

    def fold_of(self, obj: Identity) -> int:
        """The fold whose model has not seen this object. Raises InputError where there is none."""
        fold, digest = self.novel.get(obj.name, (None, None))
        if fold is None or digest != obj.digest:
            got = "another object of its name" if fold is not None else "no such object"
            raise InputError(f"held_out: expected objects of the run's cross-validation, got {obj.name}: {got} there")
        return fold


def save_fold_models(
    models: Mapping[int, GraspModel], objects: Sequence[Identity], folds: Sequence[int], run: Path
) -> None:
    """Leave the models in the run's folder; folds: of each object, the one whose model has not seen it."""
    _save(models, save_model, objects, folds, run / FOLDER)


def save_fold_judges(judges: Mapping[int, Judge], objects: Sequence[Identity], folds: Sequence[int], run: Path) -> None:
    """The same of judges."""
    _save(judges, save_judge, objects, folds, run / JUDGES)


def load_fold_models(run: Path, device: str = "cpu") -> FoldModels[GraspModel]:
    """The models that `save_fold_models` left. Raises InputError where there are none, or they are damaged."""
    novel = novel_by_fold(run)
    return FoldModels({fold: load_model(run / FOLDER / str(fold), device) for fold in _folds(novel)}, novel)


def load_fold_judges(run: Path) -> FoldModels[Judge]:
    """The judges that `save_fold_judges` left. Raises InputError as above."""
    novel = novel_by_fold(run, JUDGES)
    return FoldModels({fold: load_judge(run / JUDGES / str(fold)) for fold in _folds(novel)}, novel)


def novel_by_fold(run: Path, folder: str = FOLDER) -> dict[str, tuple[int, str]]:
    """Of each object of the run the fold whose model has not seen it, and its digest. Raises InputError as above.

    Args:
        folder: `FOLDER` or `JUDGES`.
    """
    path = run / folder / LIST
    if not path.is_file():
        raise InputError(
            f"{path}: expected the models of cross-validation ({_MADE_BY[folder]} leaves them), found no such file"
        )
    try:
        listed = json_values(path, "the folds of objects", sealed=True)
        return {name: (int(row["fold"]), str(row["digest"])) for name, row in listed.items() if name != SEAL}
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"{path}: expected fold and digest of each object, got something else") from None


def _save(
    models: Mapping[int, Learned],
    save: Callable[[Learned, Path], Any],
    objects: Sequence[Identity],
    folds: Sequence[int],
    folder: Path,
) -> None:
    for fold, model in models.items():
        (own := folder / str(fold)).mkdir(parents=True)
        save(model, own)
    about = {obj.name: {"fold": fold, "digest": obj.digest} for obj, fold in zip(objects, folds, strict=True)}
    write_bytes(folder / LIST, sealed_json(about, indent=1, sort_keys=True))


def _folds(novel: Mapping[str, tuple[int, str]]) -> list[int]:
    return sorted({fold for fold, _ in novel.values()})
