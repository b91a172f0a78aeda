"""Six objects of forty features and sixty grasps, made of random numbers: an experiment that takes a moment.

An object's features fall into three kinds; a grasp is paired with four of them, each in one of a few cells that
are far apart. What a grasp's outcome has to do with that is the caller's to say.
"""

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.pairs import CellPairs, grid_of
from spgf_torch.cache import Cache
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.experiment import Experiment, Learned
from spgf_torch.progress import ProgressReporter
from spgf_torch.prototypes.estimator import Prototypes
from spgf_torch.settings import settings

KINDS, FEATURES, GRASPS, EACH = 3, 40, 60, 4
FOLD = np.array([0, 1, 2, 0, 1, 2])
AFFORDANCE = settings(
    AffordanceConfig, reach=0.03, rotation_deg=60, kernel=0, kernel_deg=0, min_support=1, vote_shrinkage=0, shrinkage=0
)


def world(cells: int, lawful: bool = True, types: tuple[str, ...] = ("NPG", "WPG")) -> list[DescribedObject]:
    """The objects. Lawful: kind, cell and type of a grasp's pairs decide how often it succeeds; else it is chance."""
    generator = torch.Generator().manual_seed(0)
    places = torch.randperm(grid_of(AFFORDANCE).cells, generator=generator)[:cells].int()
    law = torch.randn(KINDS, cells, len(types), generator=generator)
    return [_object(places, law if lawful else torch.zeros_like(law), types, generator) for _ in FOLD]


def _object(places: Tensor, law: Tensor, types: tuple[str, ...], generator: torch.Generator) -> DescribedObject:
    kind = torch.randint(KINDS, (FEATURES,), generator=generator)
    relations = 4 * torch.eye(KINDS)[kind] + 0.3 * torch.randn(FEATURES, KINDS, generator=generator)
    grasp, grasp_type = torch.arange(GRASPS).repeat_interleave(EACH), torch.arange(GRASPS) % len(types)
    feature = torch.randint(FEATURES, (GRASPS * EACH,), generator=generator)
    place = torch.randint(len(places), (GRASPS * EACH,), generator=generator)
    chance = law[kind[feature], place, grasp_type[grasp]].view(GRASPS, EACH).sum(1).sigmoid()
    pairs = CellPairs(feature.int(), grasp.int(), places[place], grasp_type)
    collides = torch.rand(GRASPS, generator=generator) < 0.2
    return DescribedObject(relations, pairs, collides, types, torch.rand(GRASPS, generator=generator) < chance)


def experiment(examples: list[DescribedObject], **changes: Any) -> Experiment:
    """Three folds, K = 3."""
    config = TrainConfig(K=KINDS, N=10, folds=3, seed=0, inner_grasps=40, trials_per_object=1000, training_objects=1000)
    config.final_model, config.fold_models, config.affordance = False, True, AFFORDANCE
    for name, value in changes.items():
        setattr(config, name, value)
    objects: Any = [SimpleNamespace(name=f"object {i}", category="boxes", digest=str(i)) for i in range(len(examples))]
    design = Design(FOLD, np.arange(len(FOLD)), config.training_objects)
    return replace(Experiment.of(config, design, objects, examples, Cache(None)), fit=fitted)


def fitted(relations: Tensor) -> Tensor:
    """Prototypes as train finds them, but for Lightning."""
    return Prototypes(KINDS, restarts=2, finalists=1, breath=0).fit(relations).centres_


def run(examples: list[DescribedObject], **changes: Any) -> Learned:
    """What the experiment leaves."""
    return experiment(examples, **changes).run(ProgressReporter())


def bits(value: Any) -> Any:
    """The tensors of a record, at any depth, as bytes."""
    if isinstance(value, torch.Tensor):
        return value.numpy().tobytes()
    if isinstance(value, dict):
        return {key: bits(each) for key, each in value.items()}
    if isinstance(value, list):
        return [bits(each) for each in value]
    return (
        {f.name: bits(getattr(value, f.name)) for f in fields(value)}
        if hasattr(value, "__dataclass_fields__")
        else value
    )


def everything(learned: Learned) -> Any:
    """All that an experiment leaves, as bytes."""
    return bits([learned.scores, learned.of_fold, learned.model])
