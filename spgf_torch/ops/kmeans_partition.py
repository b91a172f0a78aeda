"""Parts of points that are alike: their means stand for the points in the search for a start of k-means."""

from __future__ import annotations

import heapq

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.kmeans import Floats, Ids
from spgf_torch.ops.registration import memory, operator


@operator("partition(Tensor points, int most) -> Tensor")
def partition(points: Tensor, most: int) -> Tensor:
    """(N,) int64: parts of points (N, D) that are alike, numbered from 0.

    The part of largest squared error is halved at its mean across its widest axis, until there are `most` or no part
    has any error.
    """
    members = torch.arange(len(points), device=points.device)
    parts = [_part(points, members, 0)]
    while len(parts) < most and parts[0][0] < 0:
        _, first, members, axis, mean = heapq.heappop(parts)
        below = points[members, axis] < mean
        lower, upper = members[below], members[~below]
        if not len(lower) or not len(upper):  # all alike but for rounding
            heapq.heappush(parts, (0.0, first, members, axis, mean))
            continue
        heapq.heappush(parts, _part(points, lower, first))
        heapq.heappush(parts, _part(points, upper, first + len(lower)))
    part = torch.empty(len(points), dtype=torch.int64, device=points.device)
    for number, (_, _, members, _, _) in enumerate(sorted(parts, key=lambda part: part[1])):
        part[members] = number
    return part


def _part(points: Tensor, members: Tensor, first: int) -> tuple[float, int, Tensor, int, float]:
    """What the heap holds: less the squared error of the members (n,), their place, they, and where to halve them."""
    rows = points[members].double()
    sums = rows.sum(0)
    errors = (rows.square().sum(0) - sums * sums / len(rows)).clamp(min=0)
    axis = int(errors.argmax())
    return -float(errors.sum()), first, members, axis, float(sums[axis] / len(rows))


@partition.on_cpu
def _partition_in_loops(points: Tensor, most: int) -> Tensor:
    order = np.arange(len(points))
    sizes = np.diff(_split(memory(points), most, order))
    part = np.empty(len(points), np.int64)
    part[order] = np.repeat(np.arange(len(sizes)), sizes)
    return torch.from_numpy(part)


@partition.fake
def _partition_shapes(points: Tensor, most: int) -> Tensor:
    return points.new_empty(points.shape[0], dtype=torch.int64)


@compiled
def _spread(rows: Floats, order: Ids, first: int, end: int) -> tuple[float, int, float]:
    """Squared error of the rows order[first:end] about their mean, the axis of most of it, and the mean there."""
    D = rows.shape[1]
    sums, squares = np.zeros(D, np.float64), np.zeros(D, np.float64)
    for p in range(first, end):
        row = rows[order[p]]
        for j in range(D):
            value = np.float64(row[j])
            sums[j] += value
            squares[j] += value * value
    errors = np.maximum(squares - sums * sums / (end - first), 0)
    axis = int(errors.argmax())
    return errors.sum(), axis, sums[axis] / (end - first)


@compiled
def _split(rows: Floats, most: int, order: Ids) -> Ids:
    """Bounds (parts + 1,) of the parts of rows (N, D). In and out: order (N,), in which they lie."""
    error, axis, mean = _spread(rows, order, 0, len(order))
    parts = [(-error, 0, len(order), axis, mean)]
    while len(parts) < most and parts[0][0] < 0:
        _, first, end, axis, mean = heapq.heappop(parts)
        middle = first
        for p in range(first, end):
            if rows[order[p], axis] < mean:
                order[middle], order[p] = order[p], order[middle]
                middle += 1
        if middle in (first, end):  # all alike but for rounding
            heapq.heappush(parts, (0.0, first, end, axis, mean))
            continue
        for lower, upper in ((first, middle), (middle, end)):
            error, axis, mean = _spread(rows, order, lower, upper)
            heapq.heappush(parts, (-error, lower, upper, axis, mean))
    bounds = np.empty(len(parts) + 1, np.int64)
    for p in range(len(parts)):
        bounds[p] = parts[p][1]
    bounds[-1] = len(order)
    bounds.sort()
    return bounds
