"""The shape-grasp space of some training objects, and what it says of grasps: on novel objects and on its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import kernel_of
from spgf_torch.affordance.neighbourhood import Counts, ShapeGraspSpace, analyse, base_rates, outcome_counts
from spgf_torch.affordance.pairs import lattice_of, points_of, shape_grasp_particles
from spgf_torch.affordance.particles import Points
from spgf_torch.affordance.ranking import Judged, judge
from spgf_torch.affordance.voting import counted_votes
from spgf_torch.experiment.describe import Described
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.prototypes.kmeans import assign


@dataclass(frozen=True)
class Example:
    """A training object: what was seen of it, and how its grasps ended (success (G,) bool)."""

    described: Described
    success: Tensor

    def of_grasps(self, chosen: Tensor) -> Example:
        """With the grasps `chosen` (C,) int64, ascending, alone."""
        if len(chosen) == len(self.success):
            return self
        return Example(self.described.of_grasps(chosen), self.success[chosen])

    def sample(self, count: int, generator: torch.Generator) -> Tensor:
        """At most `count` of its grasps, drawn at random: indices (C,) int64, ascending."""
        drawn = torch.randperm(len(self.success), generator=generator)[:count]
        return drawn.sort().values.to(self.success.device)

    def sample_of_each_type(self, count: int, generator: torch.Generator) -> Tensor:
        """At most `count` of its grasps of each type, drawn at random: indices (C,) int64, ascending."""
        order = torch.randperm(len(self.success), generator=generator).to(self.success.device)
        grasp_type = self.described.grasp_type[order]
        drawn = [order[grasp_type == code][:count] for code in range(len(GRASP_TYPES))]
        return torch.cat(drawn).sort().values


class TrainedSpace:
    """Prototypes (K, D) and the space of training objects in groups, analysed only where somebody asks."""

    def __init__(self, groups: Sequence[Sequence[Example]], centres: Tensor, config: AffordanceConfig) -> None:
        self.centres, self.config = centres, config
        self.lattice, self.kernel = lattice_of(config), kernel_of(config)
        parts = [
            [shape_grasp_particles(e.described.pairs, self.ids(e.described), e.success) for e in g] for g in groups
        ]
        self.space = ShapeGraspSpace.of(parts, len(centres), self.lattice)
        self.outcomes = torch.stack([torch.stack([outcome_counts(p) for p in group]).sum(0) for group in parts])

    def ids(self, obj: Described) -> Tensor:
        """(F,) int64 prototypes of an object's features."""
        return assign(obj.relations, self.centres)

    def judge(self, objects: Sequence[Described], without: Sequence[int | None]) -> list[Judged]:
        """What the training objects say of grasps, for each object without those of one group (None: of all)."""
        left_out = [self.space.groups if group is None else group for group in without]
        asked = [points_of(obj.pairs, self.ids(obj)) for obj in objects]
        sizes = [len(points.cell) for points in asked]
        view = torch.tensor(left_out).repeat_interleave(torch.tensor(sizes)).to(self.centres.device)
        counts = analyse(self.space, Points.together(asked), view, self.lattice, self.kernel).split(sizes)
        rates = [base_rates(self.outcomes.sum(0) - (0 if g is None else self.outcomes[g])) for g in without]
        return [self._judged(*row) for row in zip(counts, asked, objects, rates, strict=True)]

    def _judged(self, counts: Counts, points: Points, obj: Described, base_rate: Tensor) -> Judged:
        votes = counted_votes(counts, points, obj.pairs.grasp, self.config.min_support)
        return judge(votes, base_rate, obj.grasp_type, obj.collides, self.config)
