"""Where in a condensed shape-grasp space a cell is: partition and cell -> point.

Points are ordered by partition, then cell. A cell is rotation, x, y and z of a grid; the points of one partition,
rotation and x are a row, whose beginning a table tells. Within a row a binary search finds the cell: few points, and
next to each other in memory. All queries take each step of their searches together: no load from memory waits for
another's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.ops.registration import memory, operator
from spgf_torch.threads import in_parts

NO_POINT = -1

# On a CPU: queries that search side by side, and those of one part of the work.
QUERIES_TOGETHER, PART = 1024, 1 << 17


class Table(NamedTuple):
    """Points for the search.

    start: (S * rows + 1,) int32, where the points of each row begin; cell: (P,) int32, of each point.
    """

    start: Tensor
    cell: Tensor


@operator("look_up(Tensor[] table, int rows, int row_size, Tensor partition, Tensor cell) -> Tensor")
def look_up(table: Table, rows: int, row_size: int, partition: Tensor, cell: Tensor) -> Tensor:
    """(Q,) int64: the point of each partition (Q,) int32 and cell (Q,) int32; NO_POINT where there is none.

    rows: of a partition; row_size: cells of a row.
    """
    start, points = Table(*table)
    row = partition.long() * rows + cell // row_size
    low = start.index_select(0, row).long()
    left = start.index_select(0, row + 1) - low
    if len(points) == 0:
        return torch.full_like(low, NO_POINT)
    most = int(left.max()) if len(left) else 0
    empty = left == 0
    while most > 1:
        half = left >> 1
        before = points.index_select(0, (low + half - 1).clamp(min=0)) < cell
        low, left, most = low + half * before, left - half, most - (most >> 1)
    found = points.index_select(0, low.clamp(max=len(points) - 1)) == cell
    return torch.where(found & ~empty, low, NO_POINT)


@look_up.on_cpu
def _in_loops(table: Table, rows: int, row_size: int, partition: Tensor, cell: Tensor) -> Tensor:
    start, points = (memory(column) for column in table)
    partitions, cells, found = memory(partition), memory(cell), np.empty(len(cell), np.int64)

    def work(first: int) -> None:
        end = first + PART
        _find(start, points, rows, row_size, partitions[first:end], cells[first:end], found[first:end])

    list(in_parts(work, range(0, len(found), PART)))
    return torch.from_numpy(found)


@look_up.fake
def _shapes(table: Table, rows: int, row_size: int, partition: Tensor, cell: Tensor) -> Tensor:
    return cell.new_empty(cell.shape, dtype=torch.int64)


@compiled
def _find(
    start: np.ndarray,
    points: np.ndarray,
    rows: int,
    row_size: int,
    partition: np.ndarray,
    cell: np.ndarray,
    point: np.ndarray,
) -> None:
    """Out: point (Q,) int64 of each partition and cell (Q,)."""
    rows_of, left = np.empty(QUERIES_TOGETHER, np.int64), np.empty(QUERIES_TOGETHER, np.int64)
    for first in range(0, len(cell), QUERIES_TOGETHER):
        part = slice(first, min(first + QUERIES_TOGETHER, len(cell)))
        row = rows_of[: part.stop - first]
        for k in range(len(row)):
            row[k] = partition[first + k] * rows + cell[first + k] // row_size
        search(start, points, row, cell[part], left[: len(row)], point[part])


@lean
def search(
    start: np.ndarray, points: np.ndarray, row: np.ndarray, cell: np.ndarray, left: np.ndarray, low: np.ndarray
) -> None:
    """Out: low (Q,) int64, the point of each cell (Q,) in its row (Q,); NO_POINT without one. left (Q,) int64: scratch.

    start and points: of a `Table`.
    """
    most = 0
    for k in range(len(row)):
        low[k] = start[row[k]]
        left[k] = start[row[k] + 1] - start[row[k]]
        most = max(most, left[k])
    while most > 1:
        for k in range(len(row)):
            half = left[k] >> 1
            low[k] += half * (points[max(low[k] + half - 1, 0)] < cell[k])
            left[k] -= half
        most -= most >> 1
    for k in range(len(row)):
        if left[k] == 0 or points[low[k]] != cell[k]:
            low[k] = NO_POINT
