"""The shape-grasp space of some training objects, and what it says of grasps on others."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import kernel_of
from spgf_torch.affordance.neighbourhood import Counts, ShapeGraspSpace, analyse, base_rates, outcome_counts
from spgf_torch.affordance.pairs import grid_of, shape_grasp_particles
from spgf_torch.affordance.particles import Particles, concatenated
from spgf_torch.affordance.ranking import GraspScores, score_grasps
from spgf_torch.affordance.voting import counted_votes
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.prototypes.kmeans import assign


class TrainingSpace:
    """Prototypes (K, D) and the space of training objects, analysed only where somebody asks."""

    def __init__(self, objects: Sequence[DescribedObject], centres: Tensor, config: AffordanceConfig) -> None:
        self.centres, self.config = centres, config
        self.grid, self.kernel = grid_of(config), kernel_of(config)
        self.types = len(objects[0].grasp_types)
        parts = [shape_grasp_particles(obj.pairs, self.ids(obj), self.types, obj.outcomes) for obj in objects]
        self.space = ShapeGraspSpace.of(parts, len(centres), self.grid)
        self.base_rate = base_rates(torch.stack([outcome_counts(part, len(centres)) for part in parts]).sum(0))

    def ids(self, obj: DescribedObject) -> Tensor:
        """(F,) int64 prototypes of an object's features."""
        return assign(obj.relations, self.centres)

    def score_grasps(self, objects: Sequence[DescribedObject]) -> list[GraspScores]:
        """What the training objects say of the grasps on each object."""
        asked = [shape_grasp_particles(obj.pairs, self.ids(obj), self.types) for obj in objects]
        points = concatenated(asked)
        counts = analyse(self.space, points, self.grid, self.kernel).split([len(each.cell) for each in asked])
        return [self._scores(*row) for row in zip(counts, asked, objects, strict=True)]

    def _scores(self, counts: Counts, points: Particles, obj: DescribedObject) -> GraspScores:
        votes = counted_votes(counts, points, obj.pairs.grasp, self.config.min_support)
        return score_grasps(votes, self.base_rate, obj.grasp_type, obj.collides, self.config)
