"""The shape-grasp space of some training objects, and what it says of grasps: on novel objects and on its own."""

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
    """Prototypes (K, D) and the space of training objects in groups, analysed only where somebody asks."""

    def __init__(self, groups: Sequence[Sequence[DescribedObject]], centres: Tensor, config: AffordanceConfig) -> None:
        self.centres, self.config = centres, config
        self.grid, self.kernel = grid_of(config), kernel_of(config)
        parts = [[shape_grasp_particles(obj.pairs, self.ids(obj), obj.outcomes) for obj in group] for group in groups]
        self.space = ShapeGraspSpace.of(parts, len(centres), self.grid)
        self.outcomes = torch.stack(
            [torch.stack([outcome_counts(p, len(centres)) for p in group]).sum(0) for group in parts]
        )

    def ids(self, obj: DescribedObject) -> Tensor:
        """(F,) int64 prototypes of an object's features."""
        return assign(obj.relations, self.centres)

    def score_grasps(
        self, objects: Sequence[DescribedObject], excluded_groups: Sequence[int | None]
    ) -> list[GraspScores]:
        """What the training objects say of grasps, for each object without those of one group (None: of all)."""
        excluded = [self.space.groups if group is None else group for group in excluded_groups]
        asked = [shape_grasp_particles(obj.pairs, self.ids(obj)) for obj in objects]
        sizes = [len(points.cell) for points in asked]
        group = torch.tensor(excluded).repeat_interleave(torch.tensor(sizes)).to(self.centres.device)
        counts = analyse(self.space, concatenated(asked), group, self.grid, self.kernel).split(sizes)
        rates = [base_rates(self.outcomes.sum(0) - (0 if g is None else self.outcomes[g])) for g in excluded_groups]
        return [self._scores(*row) for row in zip(counts, asked, objects, rates, strict=True)]

    def _scores(self, counts: Counts, points: Particles, obj: DescribedObject, base_rate: Tensor) -> GraspScores:
        votes = counted_votes(counts, points, obj.pairs.grasp, self.config.min_support)
        return score_grasps(votes, base_rate, obj.grasp_type, obj.collides, self.config)
