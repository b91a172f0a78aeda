"""How many votes of features each grasp gets and what they gain: cell pairs and look-up in one, none is listed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.look_up_points import NO_POINT, Table, look_up, search
from spgf_torch.ops.registration import memory, operator
from spgf_torch.ops.relative_cells import Features, Grasps, Grid, cells_from, pair_cells, scratch_for
from spgf_torch.threads import in_parts

# On a CPU: grasps that are voted on together.
GRASPS_TOGETHER = 512


class Voters(NamedTuple):
    """Features that vote: poses T (F, 4, 4); partition (F,) int64, of the feature's prototype and grasp type 0."""

    T: Tensor
    partition: Tensor


class Candidates(NamedTuple):
    """Grasps that are voted on: poses T (G, 4, 4); kind (G,) int64, the grasp type, which adds to the partition."""

    T: Tensor
    kind: Tensor


@operator(
    "accumulate_votes(Tensor[] voters, Tensor[] candidates, Tensor[] table, Tensor gain, float[] lattice) "
    "-> (Tensor votes, Tensor gain)"
)
def accumulate_votes(
    voters: Voters, candidates: Candidates, table: Table, gain: Tensor, lattice: list[float]
) -> tuple[Tensor, Tensor]:
    """Votes (G,) int64 on each grasp and the sum of their gains, (G,) f64.

    A voter has a vote for a grasp within reach if the table of the learned space has a point of its partition and cell;
    the vote adds that point's gain (P,) f32. lattice: reach, voxel and rotation_deg of a `SE3Grid`.
    """
    (T, partition), (T_grasp, kind), grid = Voters(*voters), Candidates(*candidates), SE3Grid(*lattice)
    votes, total = kind.new_zeros(len(kind)), gain.new_zeros(len(kind), dtype=torch.float64)
    for feature, grasp, cell in pair_cells(T, T_grasp, grid):
        of_pair = partition.index_select(0, feature) + kind.index_select(0, grasp)
        point = look_up.in_torch(Table(*table), grid.rows, grid.row_size, of_pair, cell)
        found = (point != NO_POINT).nonzero()[:, 0]
        grasp, point = grasp.index_select(0, found), point.index_select(0, found)
        votes.index_add_(0, grasp, torch.ones_like(grasp))
        total.index_add_(0, grasp, gain.index_select(0, point).double())
    return votes, total


@accumulate_votes.on_cpu
def _in_loops(
    voters: Voters, candidates: Candidates, table: Table, gain: Tensor, lattice: list[float]
) -> tuple[Tensor, Tensor]:
    (T, partition), (T_grasp, kind), space = Voters(*voters), Candidates(*candidates), SE3Grid(*lattice)
    order = torch.argsort(partition, stable=True)  # of one prototype after the other: their points stay in the cache
    features, partitions = Features.of(T[order]), memory(partition[order])
    grasps, kinds, grid = Grasps.of(T_grasp), memory(kind), Grid.of(space)
    start, cell = (memory(column) for column in table)
    index = Index(start, cell, space.rows, memory(gain))
    sums = np.zeros((2, len(kinds)))

    def work(first: int) -> None:
        part = slice(first, first + GRASPS_TOGETHER)
        found = np.zeros((2, len(kinds[part])))
        _accumulate(features, partitions, grasps.at(part), kinds[part], grid, index, found)
        sums[:, part] = found

    list(in_parts(work, range(0, len(kinds), GRASPS_TOGETHER)))
    votes, total = torch.from_numpy(sums)
    return votes.long(), total.clone()


@accumulate_votes.fake
def _shapes(
    voters: Voters, candidates: Candidates, table: Table, gain: Tensor, lattice: list[float]
) -> tuple[Tensor, Tensor]:
    grasps = candidates[1].shape
    return candidates[1].new_empty(grasps), gain.new_empty(grasps, dtype=torch.float64)


class Index(NamedTuple):
    """A `Table` for the compiled loop: start and cell, the rows of a partition, and the gain of each point."""

    start: np.ndarray
    cell: np.ndarray
    rows: int
    gain: np.ndarray


@compiled
def _accumulate(
    features: Features,
    partition: np.ndarray,
    grasps: Grasps,
    kind: np.ndarray,
    grid: Grid,
    index: Index,
    sums: np.ndarray,
) -> None:
    """In and out: sums (2, G) f64, to which votes of features and their gain are added."""
    size, row_size = len(kind), grid.side * grid.side
    scratch, cell, numbers = scratch_for(size), np.empty(size, np.int32), np.empty((4, size), np.int64)
    for i in range(len(partition)):
        cells_from(features, i, grasps, grid, scratch, cell)
        n = 0
        for j in range(size):
            if cell[j] >= 0:
                numbers[0, n] = j
                numbers[1, n] = (partition[i] + kind[j]) * index.rows + cell[j] // row_size
                cell[n] = cell[j]
                n += 1
        point = numbers[2, :n]
        search(index.start, index.cell, numbers[1, :n], cell[:n], numbers[3, :n], point)
        for k in range(n):
            if point[k] >= 0:
                sums[0, numbers[0, k]] += 1
                sums[1, numbers[0, k]] += index.gain[point[k]]
