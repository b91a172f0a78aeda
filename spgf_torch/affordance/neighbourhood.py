"""Neighbourhood analysis of the shape-grasp space and its condensation (paper, section 3.4).

"A neighbourhood analysis gives each point of the space its success probability (successes over all particles
near it in SE(3), same id) and its support (how many particles are near). The space is then condensed to the
points of significant support."

The points are the cells of the SE(3) grid that hold at least one particle; near is a Gaussian kernel over cells.
`analyse` answers for chosen points, which is all that a cross-validation needs; `condense` for the whole space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.particles import Particles, known_outcomes
from spgf_torch.geometry.se3_grid import Kernel, SE3Grid
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.ops.neighbourhood_analysis import Queries, Space, Weights, populate
from spgf_torch.ops.neighbourhood_analysis import analyse as counts_around
from spgf_torch.ops.neighbourhood_analysis import condense as significant_cells
from spgf_torch.ops.outcome_counts import outcome_counts as outcomes_of_partitions


@dataclass(frozen=True)
class ShapeGraspSpace:
    """The space as groups of objects populate it: what one group says can be left out.

    Attributes:
        particles: ordered for the analysis.
        groups: how many.
    """

    particles: Space
    groups: int

    @staticmethod
    def of(groups: Sequence[Sequence[Particles]], prototypes: int, grid: SE3Grid) -> ShapeGraspSpace:
        """The space of groups of objects, given the particles of each object."""
        parts = [part for group in groups for part in group]
        partition, cell = [part.partition for part in parts], [part.cell for part in parts]
        success = [known_outcomes(part.success) for part in parts]
        sizes, partitions = [len(group) for group in groups], prototypes * len(GRASP_TYPES)
        return ShapeGraspSpace(Space(*populate(partition, cell, success, sizes, partitions, grid.numbers)), len(groups))


@dataclass(frozen=True)
class Counts:
    """What the neighbourhood analysis found at points.

    Attributes:
        successes (Q,) f32, particles (Q,) f32: near the point, weighted by the kernel; 0 where `own_count` is 0.
        own_count (Q,) f32: particles in the point's own cell, not weighted. Without any there is no such point.
    """

    successes: Tensor
    particles: Tensor
    own_count: Tensor

    def split(self, sizes: list[int]) -> list[Counts]:
        """Counts of consecutive points, `sizes` of them each."""
        columns = (column.split(sizes) for column in (self.successes, self.particles, self.own_count))
        return [Counts(*part) for part in zip(*columns, strict=True)]


def analyse(space: ShapeGraspSpace, points: Particles, excluded_group: Tensor, grid: SE3Grid, kernel: Kernel) -> Counts:
    """The neighbourhood analysis at points (Q,), whatever their outcomes, in any order, repeats welcome.

    Args:
        excluded_group (Q,) int64: its particles are left out for this point; the number of groups for none.
    """
    queries, weights = Queries(points.partition, points.cell, excluded_group), Weights.of(kernel, points.cell.device)
    return Counts(*counts_around(space.particles, space.groups, queries, weights, grid.numbers).unbind(1))


@dataclass(frozen=True)
class Condensed:
    """Condensed shape-grasp particles: the points of significant support, ordered by partition, then cell.

    Attributes:
        partition_start (S + 1,) int64: points of partition s are partition_start[s] : partition_start[s + 1].
        cell (P,) int32: cell of the SE(3) grid.
        probability (P,) f32: successes over particles, both weighted by the kernel.
        support (P,) f32: weighted number of particles.
        base_rate (types,) f32: share of successes over all particles of a type.
    """

    partition_start: Tensor
    cell: Tensor
    probability: Tensor
    support: Tensor
    base_rate: Tensor

    def partition_of_point(self) -> Tensor:
        """(P,) int64 partition of each point."""
        counts = self.partition_start.diff()
        return torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)


def condense(
    parts: Sequence[Particles], prototypes: int, grid: SE3Grid, kernel: Kernel, min_support: float
) -> Condensed:
    """Neighbourhood analysis at every populated cell, then only cells with `support >= min_support` are kept.

    `parts` are the particles of one object each; their order does not matter.
    """
    space, weights = ShapeGraspSpace.of([parts], prototypes, grid), Weights.of(kernel, parts[0].cell.device)
    rates = base_rates(torch.stack([outcome_counts(part, prototypes) for part in parts]).sum(0))
    return Condensed(*significant_cells(space.particles, weights, grid.numbers, min_support), rates)


def outcome_counts(particles: Particles, prototypes: int) -> Tensor:
    """(types, 2) int64: successes and particles of each grasp type."""
    types, success = len(GRASP_TYPES), known_outcomes(particles.success)
    counts = outcomes_of_partitions(particles.partition, success, prototypes * types).view(prototypes, types, 2).sum(0)
    return torch.stack([counts[:, 1], counts.sum(1)], dim=1)


def base_rates(counts: Tensor) -> Tensor:
    """Successes over particles of each grasp type, from `outcome_counts`: (types, 2) -> (types,) f32; 0 for none."""
    return counts[:, 0].float() / counts[:, 1].clamp(min=1)
