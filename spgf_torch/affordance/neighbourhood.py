"""Neighbourhood analysis of the shape-grasp space and its condensation (paper, section 3.4).

"A neighbourhood analysis gives each point of the space its success probability (successes over all particles
near it in SE(3), same id) and its support (how many particles are near). The space is then condensed to the
points of significant support."

The points are the lattice cells that hold at least one particle; near is a Gaussian kernel over cells. `analyse`
answers for chosen points, which is all that a cross-validation needs; `condense` for the whole space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.particles import Particles, Points
from spgf_torch.geometry.lattice import Kernel, Lattice
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.ops.neighbourhood_analysis import Queries, Space, Weights, populate
from spgf_torch.ops.neighbourhood_analysis import analyse as counts_around
from spgf_torch.ops.neighbourhood_analysis import condense as significant_cells


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
    def of(groups: Sequence[Sequence[Particles]], prototypes: int, lattice: Lattice) -> ShapeGraspSpace:
        """The space of groups of objects, given the particles of each object."""
        parts = [part for group in groups for part in group]
        slice_, cell, success = ([getattr(part, name) for part in parts] for name in ("slice", "cell", "success"))
        sizes, slices = [len(group) for group in groups], prototypes * len(GRASP_TYPES)
        return ShapeGraspSpace(Space(*populate(slice_, cell, success, sizes, slices, lattice.numbers)), len(groups))


@dataclass(frozen=True)
class Counts:
    """What the neighbourhood analysis found at points.

    Attributes:
        successes (Q,) f32, particles (Q,) f32: near the point, weighted by the kernel; 0 where `here` is 0.
        here (Q,) f32: particles in the point's own cell, not weighted. Without any there is no such point.
    """

    successes: Tensor
    particles: Tensor
    here: Tensor

    def split(self, sizes: list[int]) -> list[Counts]:
        """Counts of consecutive points, `sizes` of them each."""
        columns = (column.split(sizes) for column in (self.successes, self.particles, self.here))
        return [Counts(*part) for part in zip(*columns, strict=True)]


def analyse(space: ShapeGraspSpace, points: Points, without: Tensor, lattice: Lattice, kernel: Kernel) -> Counts:
    """The neighbourhood analysis at points (Q,), in any order, repeats welcome.

    Args:
        without (Q,) int64: the group whose particles are left out for this point; the number of groups for none.
    """
    queries, weights = Queries(points.slice, points.cell, without), Weights.of(kernel, points.cell.device)
    return Counts(*counts_around(space.particles, space.groups, queries, weights, lattice.numbers).unbind(1))


@dataclass(frozen=True)
class Condensed:
    """Condensed shape-grasp particles: the points of significant support, ordered by slice, then cell.

    Attributes:
        slice_start (S + 1,) int64: points of slice s are slice_start[s] : slice_start[s + 1].
        cell (P,) int32: lattice cell of the point.
        probability (P,) f32: successes over particles, both weighted by the kernel.
        support (P,) f32: weighted number of particles.
        base_rate (types,) f32: share of successes over all particles of a type.
    """

    slice_start: Tensor
    cell: Tensor
    probability: Tensor
    support: Tensor
    base_rate: Tensor

    def slice_of_point(self) -> Tensor:
        """(P,) int64 slice of each point."""
        counts = self.slice_start.diff()
        return torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)


def condense(
    parts: Sequence[Particles], prototypes: int, lattice: Lattice, kernel: Kernel, min_support: float
) -> Condensed:
    """Neighbourhood analysis at every populated cell, then only cells with `support >= min_support` are kept.

    `parts` are the particles of one object each; their order does not matter.
    """
    space, weights = ShapeGraspSpace.of([parts], prototypes, lattice), Weights.of(kernel, parts[0].cell.device)
    rates = base_rates(torch.stack([outcome_counts(part) for part in parts]).sum(0))
    return Condensed(*significant_cells(space.particles, weights, lattice.numbers, min_support), rates)


def outcome_counts(particles: Particles) -> Tensor:
    """(types, 2) int64: successes and particles of each grasp type."""
    types = len(GRASP_TYPES)
    outcome = particles.slice % types * 2 + particles.success
    failures, successes = torch.bincount(outcome, minlength=2 * types).view(types, 2).unbind(1)
    return torch.stack([successes, failures + successes], dim=1)


def base_rates(counts: Tensor) -> Tensor:
    """Successes over particles of each grasp type, from `outcome_counts`: (types, 2) -> (types,) f32; 0 for none."""
    return counts[:, 0].float() / counts[:, 1].clamp(min=1)
