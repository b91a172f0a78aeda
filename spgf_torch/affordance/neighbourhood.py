"""Neighbourhood analysis of the shape-grasp space and its condensation (paper, section 3.4).

"A neighbourhood analysis gives each point of the space its success probability (successes over all particles
near it in SE(3), same id) and its support (how many particles are near). The space is then condensed to the
points of significant support."

The points are the lattice cells that hold at least one particle; near is a Gaussian kernel over cells. `analyse`
answers for chosen points, which is all that a cross-validation needs; `condense` for the whole space. Both run on the
CPU, whatever the device of what they are given, and answer there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.particles import Particles, Points
from spgf_torch.affordance.smoothing import hand_back, into_slices, ordered, outcomes, populated, weigh
from spgf_torch.config import GRASP_TYPES
from spgf_torch.geometry.lattice import Kernel, Lattice
from spgf_torch.threads import in_parts


@dataclass(frozen=True)
class ShapeGraspSpace:
    """The space as groups of objects populate it: what one group says can be left out.

    Attributes:
        start (S + 1,) int64: particles of slice s are start[s] : start[s + 1].
        key (P,): of each particle (`smoothing`), ascending within a slice.
        groups: how many.
    """

    start: np.ndarray
    key: np.ndarray
    groups: int

    @staticmethod
    def of(groups: Sequence[Sequence[Particles]], prototypes: int, lattice: Lattice) -> ShapeGraspSpace:
        """The space of groups of objects, given the particles of each object."""
        slices, parts = prototypes * len(GRASP_TYPES), [(g, part) for g, group in enumerate(groups) for part in group]
        counts = np.zeros((slices, 2), np.int64)
        for _, part in parts:
            outcomes(_array(part.slice), _array(part.success), counts)
        start = np.append(0, counts.sum(1).cumsum())
        small = lattice.cells * len(groups) * 2 < np.iinfo(np.int32).max
        key, at = np.empty(start[-1], np.int32 if small else np.int64), start[:-1].copy()
        for g, part in parts:
            slice_, cell, success = _array(part.slice), _array(part.cell), _array(part.success)
            into_slices(slice_, cell, success, lattice.voxels, g, len(groups), at, key)
        list(in_parts(lambda s: key[start[s] : start[s + 1]].sort(), range(slices)))
        return ShapeGraspSpace(start, key, len(groups))

    @property
    def slices(self) -> int:
        return len(self.start) - 1

    def populated(self, s: int, lattice: Lattice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The populated cells of one slice, by rotation and group: start, voxel and counts of `smoothing.populated`."""
        key = self.key[self.start[s] : self.start[s + 1]]
        start = np.zeros(lattice.rotations * self.groups + 1, np.int64)
        voxel, counts = np.empty(len(key), np.int32), np.zeros((len(key), 2), np.float32)
        populated(key, lattice.voxels, start, voxel, counts)
        return start, voxel[: start[-1]], counts[: start[-1]]


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
    cell, view = _array(points.cell), _array(without)
    start, of_slice = _in_order(_array(points.slice), space.slices)
    counts, views = np.zeros((len(cell), 3), np.float32), space.groups + 1

    def work(s: int) -> None:
        asking = of_slice[start[s] : start[s + 1]]
        rotation, voxel = np.divmod(cell[asking], np.int32(lattice.voxels))
        first, order = _in_order(rotation * views + view[asking], lattice.rotations * views)
        found = _weighed(space.populated(s, lattice), space.groups, lattice, kernel, first, voxel[order])
        hand_back(found, asking[order], counts)

    list(in_parts(work, np.flatnonzero(np.diff(start)).tolist()))
    return Counts(*torch.from_numpy(counts).to(points.cell.device).unbind(1))


def _in_order(bucket: np.ndarray, buckets: int) -> tuple[np.ndarray, np.ndarray]:
    """Start (buckets + 1,) of each bucket in the order (N,) of the numbers of buckets (N,)."""
    start, order = np.zeros(buckets + 1, np.int64), np.empty(len(bucket), np.int64)
    ordered(bucket, start, np.empty(buckets, np.int64), order)
    return start, order


def _weighed(
    here: tuple[np.ndarray, np.ndarray, np.ndarray],
    groups: int,
    lattice: Lattice,
    kernel: Kernel,
    start: np.ndarray,
    asked: np.ndarray,
) -> np.ndarray:
    """(Q, 3) f32: what `smoothing.weigh` finds for the voxels asked (Q,), those of view w from start[w] on."""
    steps, turns = (_array(kernel.offset), _array(kernel.weight)), (_array(kernel.turn), _array(kernel.turn_weight))
    table, own = np.zeros((lattice.voxels, 2)), np.zeros(lattice.voxels, np.float32)
    found = np.zeros((len(asked), 3), np.float32)
    weigh(*here, groups, *steps, *turns, start, asked, table, own, found)
    return found


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
    space = ShapeGraspSpace.of([parts], prototypes, lattice)

    def work(s: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        here = space.populated(s, lattice)
        start, voxel, _ = here
        everyone = np.repeat(start, 2)[:-1]  # all ask, in the views that leave no group out
        success, support, _ = _weighed(here, 1, lattice, kernel, everyone, voxel).T
        cell = voxel + np.repeat(np.arange(lattice.rotations, dtype=np.int32) * lattice.voxels, np.diff(start))
        significant = support >= min_support
        return cell[significant], (success / support)[significant], support[significant]

    cells, probabilities, supports = zip(*in_parts(work, range(space.slices)), strict=True)
    slice_start = torch.tensor([0, *map(len, cells)]).cumsum(0)
    rates = base_rates(torch.stack([outcome_counts(part) for part in parts]).sum(0))
    columns = (torch.from_numpy(np.concatenate(column)) for column in (cells, probabilities, supports))
    device = parts[0].cell.device
    return Condensed(*(column.to(device) for column in (slice_start, *columns, rates)))


def outcome_counts(particles: Particles) -> Tensor:
    """(types, 2) int64: successes and particles of each grasp type."""
    slice_, success = _array(particles.slice), _array(particles.success)
    counts = np.zeros((slice_.max(initial=-1) + 1, 2), np.int64)
    outcomes(slice_, success, counts)
    by_type = torch.from_numpy(np.stack([counts[code :: len(GRASP_TYPES)].sum(0) for code in range(len(GRASP_TYPES))]))
    return torch.stack([by_type[:, 1], by_type.sum(1)], dim=1).to(particles.cell.device)


def base_rates(counts: Tensor) -> Tensor:
    """Successes over particles of each grasp type, from `outcome_counts`: (types, 2) -> (types,) f32; 0 for none."""
    return counts[:, 0].float() / counts[:, 1].clamp(min=1)


def _array(column: Tensor) -> np.ndarray:
    return column.cpu().numpy()
