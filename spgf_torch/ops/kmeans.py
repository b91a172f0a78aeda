"""The steps that k-means takes on all points: the sums of what belongs to each centre.

`points` (N, D) and `centres` (K, D) are of one floating type; distances are those of `assignment`. Sums over points are
float64: steps that add and take away do not drift.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from spgf_torch.compiled import lean
from spgf_torch.ops.assignment import chunks, relative_distances
from spgf_torch.ops.registration import operator

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Ids = NDArray[np.int64]


@operator("lloyd_step(Tensor points, Tensor centres) -> (Tensor sums, Tensor counts)")
def lloyd_step(points: Tensor, centres: Tensor) -> tuple[Tensor, Tensor]:
    """Sums (K, D) f64 and number (K,) int64 of the points that are nearest to each centre."""
    sums, counts = no_members(centres)
    for part in chunks(points, len(centres)):
        ids = relative_distances(part, centres).argmin(1)
        sums.index_add_(0, ids, part.double())
        counts += torch.bincount(ids, minlength=len(centres))
    return sums, counts


@lloyd_step.on_cpu
def _lloyd_step_in_loops(points: Tensor, centres: Tensor) -> tuple[Tensor, Tensor]:
    sums, counts = no_members(centres)
    for part in chunks(points.detach(), len(centres)):
        ids = np.empty(len(part), np.int64)
        add_nearest(relative_distances(part, centres.detach()).numpy(), *flat(part), ids, sums.numpy(), counts.numpy())
    return sums, counts


@lloyd_step.fake
def _lloyd_step_shapes(points: Tensor, centres: Tensor) -> tuple[Tensor, Tensor]:
    return no_members(centres)


@operator("member_sums(Tensor points, Tensor ids, int clusters) -> (Tensor sums, Tensor counts)")
def member_sums(points: Tensor, ids: Tensor, clusters: int) -> tuple[Tensor, Tensor]:
    """Sums (K, D) f64 and number (K,) int64 of the points (N, D) of each cluster; ids (N,) int64: each point's."""
    sums = points.new_zeros((clusters, points.shape[1]), dtype=torch.float64)
    return sums.index_add_(0, ids, points.double()), torch.bincount(ids, minlength=clusters)


@member_sums.on_cpu
def _member_sums_in_loops(points: Tensor, ids: Tensor, clusters: int) -> tuple[Tensor, Tensor]:
    sums, counts = (
        torch.zeros((clusters, points.shape[1]), dtype=torch.float64),
        torch.zeros(clusters, dtype=torch.int64),
    )
    add_members(*flat(points.detach()), ids.numpy(), sums.numpy(), counts.numpy())
    return sums, counts


@member_sums.fake
def _member_sums_shapes(points: Tensor, ids: Tensor, clusters: int) -> tuple[Tensor, Tensor]:
    return points.new_empty((clusters, points.shape[1]), dtype=torch.float64), ids.new_empty(clusters)


def no_members(centres: Tensor) -> tuple[Tensor, Tensor]:
    """Sums (K, D) f64 and counts (K,) int64 of no points."""
    return torch.zeros_like(centres, dtype=torch.float64), centres.new_zeros(centres.shape[0], dtype=torch.int64)


def flat(points: Tensor) -> tuple[Floats, int]:
    """The memory of points (N, D) and the numbers from row to row: rows may lie apart, and loops stay fast."""
    points = points if points.stride(1) == 1 else points.contiguous()
    step = points.stride(0)
    return points.as_strided(((len(points) - 1) * step + points.shape[1],), (1,)).numpy(), step


@lean
def add_members(points: Floats, step: int, ids: Ids, sums: Doubles, counts: Ids) -> None:
    """In and out: sums (K, D) and counts (K,), to which the points (`flat`) of the clusters ids (N,) are added."""
    for i in range(len(ids)):
        own, row = ids[i], points[i * step : i * step + sums.shape[1]]
        counts[own] += 1
        for j in range(len(row)):
            sums[own, j] += row[j]


@lean
def add_nearest(relative: Floats, points: Floats, step: int, ids: Ids, sums: Doubles, counts: Ids) -> None:
    """Out: ids (N,), the column of the least of `relative` (N, K). In and out: as `add_members`."""
    N, K = relative.shape
    for i in range(N):
        least, own = relative[i, 0], 0
        for k in range(1, K):
            if relative[i, k] < least:
                least, own = relative[i, k], k
        ids[i] = own
    add_members(points, step, ids, sums, counts)
