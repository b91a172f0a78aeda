"""Neighbourhood analysis of the shape-grasp space: particles -> kernel-weighted counts of success around cells.

`populate` orders particles for the analysis, `analyse` answers at chosen cells, `condense` at every populated one. Sums
in translation are float64 sums of float32 weights times whole numbers: exact, so that none depends on the order of
particles. Sums over rotations are float32, in the order of the rotations.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.geometry.se3_grid import Kernel, SE3Grid
from spgf_torch.ops.neighbourhood_loops import (
    Asked,
    Near,
    Populated,
    hand_back,
    into_partitions,
    ordered,
    outcomes,
    populated,
    weigh,
)
from spgf_torch.ops.registration import memory, operator, unknown_size
from spgf_torch.threads import in_parts


class Space(NamedTuple):
    """Particles of partition s are key[start[s] : start[s + 1]], ascending; start (S + 1,) int64, key (P,).

    A key is cell * 2 + success.
    """

    start: Tensor
    key: Tensor


class Queries(NamedTuple):
    """Points that are asked for: partition, cell (Q,) int32."""

    partition: Tensor
    cell: Tensor


class Weights(NamedTuple):
    """A `Kernel` as operators take it."""

    offset: Tensor
    weight: Tensor
    turn: Tensor
    turn_weight: Tensor

    @staticmethod
    def of(kernel: Kernel, device: torch.device) -> Weights:
        columns = (kernel.offset, kernel.weight, kernel.turn, kernel.turn_weight)
        return Weights(*(column.to(device) for column in columns))


Condensed = tuple[Tensor, Tensor, Tensor, Tensor]


@operator(
    "populate(Tensor[] partition, Tensor[] cell, Tensor[] success, int partitions, float[] lattice) "
    "-> (Tensor start, Tensor key)"
)
def populate(
    partition: list[Tensor], cell: list[Tensor], success: list[Tensor], partitions: int, lattice: list[float]
) -> tuple[Tensor, Tensor]:
    """The `Space` of particles: partition, cell int32 and success bool of each part."""
    of_partition, key = torch.cat(partition).long(), torch.cat(cell).long() * 2 + torch.cat(success)
    span = 2 * SE3Grid(*lattice).cells
    key = (of_partition * span + key).sort().values % span
    counts = torch.bincount(of_partition, minlength=partitions)
    return torch.cat([counts.new_zeros(1), counts.cumsum(0)]), key.to(_key_type(lattice))


@populate.on_cpu
def _populate_in_loops(
    partition: list[Tensor], cell: list[Tensor], success: list[Tensor], partitions: int, lattice: list[float]
) -> tuple[Tensor, Tensor]:
    columns = [(memory(s), memory(c), memory(held)) for s, c, held in zip(partition, cell, success, strict=True)]
    counts = np.zeros((partitions, 2), np.int64)
    for of_partition, _, held in columns:
        outcomes(of_partition, held, counts)
    start = np.append(0, counts.sum(1).cumsum())
    found = torch.empty(start[-1], dtype=_key_type(lattice))
    key, at = found.numpy(), start[:-1].copy()
    for column in columns:
        into_partitions(*column, at, key)
    list(in_parts(lambda s: key[start[s] : start[s + 1]].sort(), range(partitions)))
    return torch.from_numpy(start), found


@populate.fake
def _populate_shapes(
    partition: list[Tensor], cell: list[Tensor], success: list[Tensor], partitions: int, lattice: list[float]
) -> tuple[Tensor, Tensor]:
    particles = sum(column.shape[0] for column in cell)
    start = cell[0].new_empty(partitions + 1, dtype=torch.int64)
    return start, cell[0].new_empty(particles, dtype=_key_type(lattice))


def _key_type(lattice: list[float]) -> torch.dtype:
    return torch.int32 if SE3Grid(*lattice).cells * 2 < torch.iinfo(torch.int32).max else torch.int64


@operator("analyse(Tensor[] space, Tensor[] queries, Tensor[] weights, float[] lattice) -> Tensor")
def analyse(space: Space, queries: Queries, weights: Weights, lattice: list[float]) -> Tensor:
    """(Q, 3) f32: successes and particles near each point, weighted, and particles in its cell; 0 without any there.

    Repeats are welcome.
    """
    (start, key), queries = Space(*space), Queries(*queries)
    counts = torch.zeros((len(queries.cell), 3), device=key.device)
    for s, (first, end) in enumerate(pairwise(start.tolist())):
        asking = (queries.partition == s).nonzero()[:, 0]
        if len(asking) and end > first:
            particles = _Particles.of(key[first:end], SE3Grid(*lattice).voxels, Weights(*weights))
            counts[asking] = particles.around(queries.cell[asking], Weights(*weights))
    return counts


@analyse.on_cpu
def _analyse_in_loops(space: Space, queries: Queries, weights: Weights, lattice: list[float]) -> Tensor:
    grid, near = SE3Grid(*lattice), Near(*(memory(column) for column in weights))
    first, key = (memory(column) for column in space)
    of_partition, cell = (memory(column) for column in queries)
    start, order = _in_order(of_partition, len(first) - 1)
    counts = np.zeros((len(cell), 3), np.float32)

    def work(s: int) -> None:
        asking = order[start[s] : start[s + 1]]
        rotation, voxel = np.divmod(cell[asking], np.int32(grid.voxels))
        begin, by_rotation = _in_order(rotation, grid.rotations)
        cells = _populated(key[first[s] : first[s + 1]], grid)
        found = _weighed(cells, near, Asked(begin, voxel[by_rotation]), grid.voxels)
        hand_back(found, asking[by_rotation], counts)

    list(in_parts(work, np.flatnonzero(np.diff(start)).tolist()))
    return torch.from_numpy(counts)


@analyse.fake
def _analyse_shapes(space: Space, queries: Queries, weights: Weights, lattice: list[float]) -> Tensor:
    return space[1].new_empty((queries[1].shape[0], 3), dtype=torch.float32)


@operator(
    "condense(Tensor[] space, Tensor[] weights, float[] lattice, float min_support) "
    "-> (Tensor slice_start, Tensor cell, Tensor probability, Tensor support)"
)
def condense(space: Space, weights: Weights, lattice: list[float], min_support: float) -> Condensed:
    """Cells (N,) int32 of significant support, by partition, then cell; of partition s from partition_start[s] on.

    probability, support (N,) f32: share of successes, and weighted particles.
    """
    start, key = Space(*space)
    columns = [_no_points(key)]
    for first, end in pairwise(start.tolist()):
        particles = _Particles.of(key[first:end], SE3Grid(*lattice).voxels, Weights(*weights))
        cell = particles.own.cell
        success, support, _ = particles.around(cell, Weights(*weights)).unbind(1)
        kept = (support >= min_support).nonzero()[:, 0]
        columns.append((cell[kept].int(), (success / support)[kept], support[kept]))
    sizes = torch.tensor([len(cell) for cell, _, _ in columns], device=key.device)
    cell, probability, support = (torch.cat(column) for column in zip(*columns, strict=True))
    return sizes.cumsum(0), cell, probability, support


@condense.on_cpu
def _condense_in_loops(space: Space, weights: Weights, lattice: list[float], min_support: float) -> Condensed:
    grid, near = SE3Grid(*lattice), Near(*(memory(column) for column in weights))
    first, key = (memory(column) for column in space)

    def work(s: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        cells = _populated(key[first[s] : first[s + 1]], grid)
        success, support, _ = _weighed(cells, near, Asked(cells.start, cells.voxel), grid.voxels).T
        rotation = np.repeat(np.arange(grid.rotations, dtype=np.int32), np.diff(cells.start))
        cell, kept = cells.voxel + rotation * np.int32(grid.voxels), support >= min_support
        return cell[kept], (success / support)[kept], support[kept]

    columns = [(np.empty(0, np.int32), *np.empty((2, 0), np.float32)), *in_parts(work, range(len(first) - 1))]
    partition_start = torch.tensor([len(cell) for cell, _, _ in columns]).cumsum(0)
    cell, probability, support = (torch.from_numpy(np.concatenate(c)) for c in zip(*columns, strict=True))
    return partition_start, cell, probability, support


@condense.fake
def _condense_shapes(space: Space, weights: Weights, lattice: list[float], min_support: float) -> Condensed:
    N, (start, key) = unknown_size(), space
    cell, probability, support = key.new_empty(N, dtype=torch.int32), weights[1].new_empty(N), weights[1].new_empty(N)
    return torch.empty_like(start), cell, probability, support


class _Table(NamedTuple):
    """What cells hold, of some cells (n,), ascending: (n, 2) f64. Others hold nothing."""

    cell: Tensor
    held: Tensor

    @staticmethod
    def of(cell: Tensor, held: Tensor) -> _Table:
        """Of cells (n,) in any order, repeats added up: exact, whatever the order."""
        cell, place = cell.unique(return_inverse=True)
        return _Table(cell, held.new_zeros((len(cell), 2)).index_add_(0, place, held))

    def at(self, cell: Tensor) -> Tensor:
        if not len(self.cell):
            return self.held.new_zeros((len(cell), 2))
        place = torch.searchsorted(self.cell, cell).clamp_(max=len(self.cell) - 1)
        return self.held[place] * (self.cell[place] == cell)[:, None]


class _Particles(NamedTuple):
    """What the cells of one partition hold: successes and particles in them, and smoothed in translation."""

    own: _Table
    smooth: _Table
    voxels: int

    @staticmethod
    def of(key: Tensor, voxels: int, weights: Weights) -> _Particles:
        success = (key & 1).double()
        own = _Table.of(key.long() >> 1, torch.stack([success, torch.ones_like(success)], dim=1))
        cell = (own.cell[:, None] + weights.offset).flatten()
        smooth = _Table.of(cell, (weights.weight.double()[:, None] * own.held[:, None]).flatten(0, 1))
        return _Particles(own, smooth, voxels)

    def around(self, cell: Tensor, weights: Weights) -> Tensor:
        """(Q, 3) f32 for cells (Q,), as `analyse` has them."""
        cells, place = cell.long().unique(return_inverse=True)  # ascending: neighbours lie together in memory
        found = self._gathered(cells, weights)[place]
        return found * (found[:, 2:] > 0)

    def _gathered(self, cell: Tensor, weights: Weights) -> Tensor:
        """(Q, 3) f32: over the rotations near that of each cell."""
        rotation, voxel = cell // self.voxels, cell % self.voxels
        turn, order = weights.turn.long().sort(dim=1)
        near, share = turn[rotation], weights.turn_weight.double().gather(1, order)[rotation]
        found = torch.zeros((len(cell), 2), device=cell.device)
        for n in range(near.shape[1]):
            held = self.smooth.at(near[:, n] * self.voxels + voxel)
            found = (found + share[:, n, None] * held).float()
        return torch.cat([found, self.own.at(cell)[:, 1:].float()], dim=1)


def _no_points(key: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    none = torch.zeros(0, device=key.device)
    return none.int(), none, none


def _in_order(bucket: np.ndarray, buckets: int) -> tuple[np.ndarray, np.ndarray]:
    """Start (buckets + 1,) of each bucket in the order (N,) of the numbers of buckets (N,)."""
    start, order = np.zeros(buckets + 1, np.int64), np.empty(len(bucket), np.int64)
    ordered(bucket, start, order)
    return start, order


def _populated(key: np.ndarray, lattice: SE3Grid) -> Populated:
    """The populated cells of one partition, by rotation."""
    start = np.zeros(lattice.rotations + 1, np.int64)
    voxel, counts = np.empty(len(key), np.int32), np.zeros((len(key), 2), np.float32)
    populated(key, lattice.voxels, start, voxel, counts)
    return Populated(start, voxel[: start[-1]], counts[: start[-1]])


def _weighed(cells: Populated, near: Near, asked: Asked, voxels: int) -> np.ndarray:
    """(Q, 3) f32: what `neighbourhood_loops.weigh` finds for the voxels asked."""
    found = np.zeros((len(asked.voxel), 3), np.float32)
    weigh(cells, near, asked, voxels, found)
    return found
