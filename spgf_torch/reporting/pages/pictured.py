"""What Figs. 1 to 13 picture: the model of one fold, its prototypes, and the objects that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from spgf_torch.affordance.model import GraspModel, load_model
from spgf_torch.drawing.prototype_rings import rings
from spgf_torch.drawing.style import prototype_colours
from spgf_torch.errors import InputError
from spgf_torch.experiment.held_out import FOLDER, novel_by_fold
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import Features, spgf
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.prototypes.naming import gaps, mirror_twins, prototype_names
from spgf_torch.reporting.data.runs import Run
from spgf_torch.reporting.figures.learned import Members
from spgf_torch.reporting.figures.scenes import Inferred, Look
from spgf_torch.reporting.pages.context import Context, grippers_of_run
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import typed

PAPERS_K = 10  # of the model that the paper pictures


@dataclass(frozen=True)
class Eyes:
    """Objects as a run senses and describes them."""

    sensing: SensingConfig
    features: FeatureConfig
    seed: int

    @staticmethod
    def of(run: Run) -> Eyes:
        settings = run.settings
        return Eyes(typed(SensingConfig, settings["sensing"]), typed(FeatureConfig, settings["features"]), run.seed)

    def see(self, obj: GraspObject) -> tuple[Texlets, Features]:
        texlets = sense(obj, self.sensing, self.seed)
        generator = torch.Generator().manual_seed(self.seed)
        return texlets, spgf(texlets.positions, texlets.normals, self.features, generator)


@dataclass(frozen=True)
class Pictured:
    """A model and how it is drawn.

    Attributes:
        fold: the one whose objects the model has not seen; None of a model of all objects.
        novel: those objects; of a model of all objects none.
        degrees: (K, 2, cells, 2) the prototypes' rings.
        members: of the training objects' features; None where the objects cannot be read.
        grippers: grasp type -> the open hand.
    """

    run: Run
    eyes: Eyes
    model: GraspModel
    fold: int | None
    novel: list[GraspObject]
    degrees: np.ndarray
    members: Members | None
    looks: list[Look]
    grippers: dict[str, Gripper]

    @property
    def whose(self) -> str:
        """The model in words, for captions."""
        if self.fold is None:
            return f"the model of all objects, K = {self.run.K}"
        return f"the model of fold {self.fold}, K = {self.run.K}"

    def inferred(self, obj: GraspObject) -> Inferred:
        """An object's texlets with the ids of their prototypes (Eqs. 7, 8)."""
        texlets, found = self.eyes.see(obj)
        ids = assign(found.relations(), self.model.centres)
        return Inferred(obj.name, texlets.positions.numpy(), texlets.normals.numpy(), ids.numpy())


def check_asked(context: Context) -> None:
    """Raises InputError where `pictured` or `fold` was given, and no run keeps such a model."""
    K, fold = context.config.pictured, context.config.fold
    kept = [row.K for row in context.sweep.rows if any(run.has_model or run.keeps_folds for run in row.runs)]
    if K is not None and K not in kept:
        raise InputError(
            f"pictured: expected a K of runs with a model ({', '.join(map(str, kept)) or 'none'}), got {K}"
        )
    if fold is None:
        return
    if (run := _with_folds(context)) is None:
        raise InputError(
            f"fold: expected a run of K = {_wanted(context)[0]} (pictured) that keeps the models of its folds "
            f"(train fold_models=true), got none that could show fold {fold}"
        )
    _fold(context, run)


def pictured(context: Context, library: Mapping[str, GraspObject]) -> Pictured:
    """The model of the wanted fold and K; where no run kept it, a line is told and the model of all objects shown.

    Raises InputError where there is neither, or no such fold.
    """
    run, model, fold, unseen = _model(context)
    degrees, eyes = model.rings_deg(), Eyes.of(run)
    taught = model.settings.get("taught", {})
    teachers = [obj for name, obj in sorted(library.items()) if taught.get(name) == obj.digest]
    novel = [obj for name, obj in sorted(library.items()) if unseen.get(name) == obj.digest]
    members = _members(teachers, eyes, model, degrees) if teachers else None
    shown_as = looks(degrees, members, eyes.features.radius)
    return Pictured(run, eyes, model, fold, novel, degrees, members, shown_as, grippers_of_run(run))


def looks(degrees: np.ndarray, members: Members | None, radius: float) -> list[Look]:
    """Names, colours and shapes of prototypes (K, 2, cells, 2); without members as the mean over them has it."""
    names, twins = prototype_names(degrees), mirror_twins(degrees)
    shapes = zip(members.degrees, members.seen, strict=True) if members else zip(degrees, ~gaps(degrees), strict=True)
    shares = [f"{100 * share:.0f} % of features" for share in members.share] if members else [""] * len(names)
    notes = [
        ", ".join(filter(None, [share, f"mirror twin of {twins[k]}" if k in twins else ""]))
        for k, share in enumerate(shares)
    ]
    layers = [rings(ring, seen.astype(float), radius) for ring, seen in shapes]
    return [Look(*row) for row in zip(names, prototype_colours(len(names)), layers, notes, strict=True)]


def some_objects(objects: Sequence[GraspObject], each: int) -> list[GraspObject]:
    """`each` objects of every class, evenly spaced in the order of names."""
    chosen = []
    for category in CLASSES:
        members = sorted((obj for obj in objects if obj.category == category), key=lambda obj: obj.name)
        places = np.unique(np.linspace(0, len(members) - 1, min(each, len(members))).round().astype(int))
        chosen += [members[i] for i in places]
    return chosen


def _model(context: Context) -> tuple[Run, GraspModel, int | None, dict[str, str]]:
    """The run, its model, the fold, and the objects that are novel there: name -> digest."""
    K, wanted = _wanted(context)
    if (run := _with_folds(context)) is not None:
        fold, novel = _fold(context, run)
        return run, load_model(run.folder / FOLDER / str(fold)), fold, novel
    run = next((run for run in wanted if run.has_model), context.shown)
    model = load_model(run.folder)
    context.tell(
        f"Figs. 1 and 10 to 13 show the model of all objects, K = {run.K}: no run of K = {K} "
        f"keeps those of its folds (train +K={K} fold_models=true leaves them)"
    )
    return run, model, None, {}


def _wanted(context: Context) -> tuple[int, list[Run]]:
    """The K whose model is to be shown, and its runs."""
    K = PAPERS_K if context.config.pictured is None else context.config.pictured
    row = context.sweep.of(K)
    return K, list(row.runs) if row else []


def _with_folds(context: Context) -> Run | None:
    """The run whose models of folds are shown: of the wanted K, or, where that was not asked for, the shown one."""
    others = [context.shown] if context.config.pictured is None else []
    return next((run for run in (*_wanted(context)[1], *others) if run.keeps_folds), None)


def _fold(context: Context, run: Run) -> tuple[int, dict[str, str]]:
    """The fold that is shown of a run that keeps its models, and the objects that are novel there: name -> digest."""
    listed = novel_by_fold(run.folder)
    folds = sorted({of for of, _ in listed.values()})
    fold = context.config.fold
    if fold is None:
        fold = next(iter(folds), 0)
    if fold not in folds:
        raise InputError(f"fold: expected one of {', '.join(map(str, folds))}, got {fold}")
    return fold, {name: digest for name, (of, digest) in listed.items() if of == fold}


def _members(teachers: Sequence[GraspObject], eyes: Eyes, model: GraspModel, degrees: np.ndarray) -> Members:
    found = torch.cat([eyes.see(obj)[1].relations() for obj in teachers])
    features = np.degrees(found.double().numpy()).reshape(len(found), *degrees.shape[1:])
    return Members.of(features, assign(found, model.centres).numpy(), degrees)
