"""Neighbourhood analysis of the shape-grasp space and its condensation (paper, section 3.4).

In the paper's words "a neighbourhood analysis is performed to compute the success probability of a given point in the
space as well as the amount of similar points (called support)", and the space "is condensed to only consist of points
that have a significant support". It leaves open what is near: here particles of the same prototype and grasp type, near
in SE(3); the probability is successes over these particles, the support how many they are.

The points are the cells of the SE(3) grid that hold at least one particle; near is a Gaussian kernel over cells.
`analyse` answers for chosen points, which is all that a cross-validation needs; `condense` for the whole space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from spgf_torch.affordance.particles import Particles, known_outcomes
from spgf_torch.geometry.se3_grid import Kernel, SE3Grid
from spgf_torch.ops.neighbourhood_analysis import Queries, Space, Weights, populate
from spgf_torch.ops.neighbourhood_analysis import analyse as counts_around
from spgf_torch.ops.neighbourhood_analysis import condense as significant_cells
from spgf_torch.ops.outcome_counts import outcome_counts as outcomes_of_partitions


@dataclass(frozen=True)
class ShapeGraspSpace:
    """The space as the particles of objects populate it.

    Attributes:
        particles: ordered for the analysis.
    """

    particles: Space

    @staticmethod
    def of(parts: Sequence[Particles], prototypes: int, grid: SE3Grid) -> ShapeGraspSpace:
        """The space of objects, given the particles of each."""
        partition, cell = [part.partition for part in parts], [part.cell for part in parts]
        success, partitions = [known_outcomes(part.success) for part in parts], prototypes * parts[0].types
        return ShapeGraspSpace(Space(*populate(partition, cell, success, partitions, grid.numbers)))


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

    @staticmethod
    def gathered(parts: Sequence[Counts], part_of: Tensor) -> Counts:
        """Counts of points (Q,) in their order, given those of each part's points; part_of (Q,): the part of each."""
        if len(parts) == 1:
            return parts[0]
        place = torch.cat([(part_of == number).nonzero()[:, 0] for number in range(len(parts))])

        def column(name: str) -> Tensor:
            values = torch.cat([getattr(part, name) for part in parts])
            return torch.empty_like(values).index_copy_(0, place, values)

        return Counts(column("successes"), column("particles"), column("own_count"))


def analyse(space: ShapeGraspSpace, points: Particles, grid: SE3Grid, kernel: Kernel) -> Counts:
    """The neighbourhood analysis at points (Q,), whatever their outcomes, in any order, repeats welcome."""
    queries, weights = Queries(points.partition, points.cell), Weights.of(kernel, points.cell.device)
    return Counts(*counts_around(space.particles, queries, weights, grid.numbers).unbind(1))


class Points(NamedTuple):
    """The points of significant support of a space, as `Condensed` has them."""

    partition_start: Tensor
    cell: Tensor
    probability: Tensor
    support: Tensor


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

    @staticmethod
    def of(parts: Sequence[Points], base_rate: Tensor) -> Condensed:
        """Those of spaces that share no partition, and whose partitions follow one another."""
        start, cell, probability, support = zip(*parts, strict=True)
        return Condensed(sum(start), torch.cat(cell), torch.cat(probability), torch.cat(support), base_rate)

    @property
    def types(self) -> int:
        """How many grasp types."""
        return len(self.base_rate)

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
    counts = torch.stack([partition_counts(part, prototypes) for part in parts]).sum(0)
    points = significant_points(ShapeGraspSpace.of(parts, prototypes, grid), grid, kernel, min_support)
    return Condensed.of([points], base_rates(counts, parts[0].types))


def significant_points(space: ShapeGraspSpace, grid: SE3Grid, kernel: Kernel, min_support: float) -> Points:
    """The same of a space, or a part of one."""
    weights = Weights.of(kernel, space.particles.key.device)
    return Points(*significant_cells(space.particles, weights, grid.numbers, min_support))


def partition_counts(particles: Particles, prototypes: int) -> Tensor:
    """(prototypes * types, 2) int64: failures and successes in each partition. Those of objects add up."""
    success = known_outcomes(particles.success)
    return outcomes_of_partitions(particles.partition, success, prototypes * particles.types)


def base_rates(counts: Tensor, types: int) -> Tensor:
    """Successes over particles of each grasp type, from `partition_counts`: (types,) f32; 0 for none."""
    of_type = counts.view(-1, types, 2).sum(0)
    return of_type[:, 1].float() / of_type.sum(1).clamp(min=1)
