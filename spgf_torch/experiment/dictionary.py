"""Prototypes that another model was learned with, in place of own ones: `train prototypes_from=FOLDER`.

Prototypes know shapes, neither grasps nor hands (paper, section 3.2), so those of one hand, or of one set of objects,
can serve another. A model of all objects has seen the shapes of the novel ones, though not how grasps on them end.
Where its run left models of the same folds, each fold gets its own prototypes, which have not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from spgf_torch.affordance.model import GraspModel, load_model
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.held_out import FOLDER, LIST, FoldModels, load_fold_models
from spgf_torch.experiment.named import Identity
from spgf_torch.files.given_paths import model_folder
from spgf_torch.settings import plain


@dataclass(frozen=True)
class Dictionary:
    """Prototypes of another model.

    Attributes:
        centres: (K, D), for the model of all objects and for the folds that have none of their own.
        of_fold: fold -> prototypes (K, D) learned without the objects that are novel there.
        about: what the results say of it.
    """

    centres: Tensor
    of_fold: Mapping[int, Tensor]
    about: Mapping[str, Any]

    def __call__(self, test: int | None) -> Tensor:
        """The prototypes for the fold `test` (None: for all objects)."""
        return self.centres if test is None else self.of_fold.get(test, self.centres)

    @property
    def told(self) -> str:
        """In words: whose it is, and what it has seen."""
        whose, seen = f"of a model of {self.about['hand']} ({self.about['sha256'][:16]})", self.about["seen"]
        if seen is None:
            return f"prototypes {whose}, which does not say what objects it knows"
        if seen:
            return f"prototypes {whose}, which knows the shapes of {seen} of the novel objects, not their outcomes"
        return f"prototypes {whose}, which has seen none of the novel objects"


def check_dictionary(config: TrainConfig) -> None:
    """Raise InputError where the model in `config.prototypes_from` is damaged, or of other features or another K."""
    if config.prototypes_from is not None:
        _check(config, load_model(model_folder(config.prototypes_from, "prototypes_from"), config.device))


def load_dictionary(config: TrainConfig, design: Design, objects: Sequence[Identity]) -> Dictionary | None:
    """The prototypes of the model in `config.prototypes_from`; None where it is not set.

    Raises InputError where there is none or it is damaged; `check_dictionary` says before whether it fits.
    """
    if config.prototypes_from is None:
        return None
    folder = model_folder(config.prototypes_from, "prototypes_from")
    model = load_model(folder, config.device)
    same = _same_folds(folder, config, design, objects)
    of_fold = {fold: each.centres for fold, each in same.items()}
    taught = model.settings.get("taught")  # older models do not say
    seen = None if taught is None else sum(taught.get(obj.name) == obj.digest for obj in objects)
    seen = 0 if of_fold else seen
    digest = hashlib.sha256()
    for centres in (model.centres, *(of_fold[fold] for fold in sorted(of_fold))):
        digest.update(centres.cpu().contiguous().numpy().tobytes())
    hand = model.settings["hand"]["name"]
    about = {"sha256": digest.hexdigest(), "hand": hand, "by_fold": bool(of_fold), "seen": seen}
    return Dictionary(model.centres, of_fold, about)


def _check(config: TrainConfig, model: GraspModel) -> None:
    own, theirs = plain(config.features), model.settings["features"]
    for name, value in own.items():
        if (got := theirs.get(name, value)) != value:
            raise InputError(
                f"features.{name}: expected {got}, as the prototypes of {config.prototypes_from} have it, got {value}"
            )
    K = len(model.centres)
    if config.K != K:
        raise InputError(f"K: expected {K}, the number of prototypes of {config.prototypes_from}, got {config.K}")


def _same_folds(
    folder: Path, config: TrainConfig, design: Design, objects: Sequence[Identity]
) -> dict[int, GraspModel]:
    """For each fold the model of `folder` that has seen none of the objects novel there; empty unless all have one."""
    if not (folder / FOLDER / LIST).is_file():
        return {}
    theirs: FoldModels[GraspModel] = load_fold_models(folder, config.device)
    found: dict[int, GraspModel] = {}
    for test in design.tests:
        novel = [objects[i] for i in design.novel(test)]
        folds = {theirs.novel[o.name][0] if theirs.novel.get(o.name, (0, ""))[1] == o.digest else -1 for o in novel}
        if len(folds) != 1 or -1 in folds:
            return {}
        found[test] = theirs.models[folds.pop()]
    return found
