"""The steps of the search for a start of k-means, on a summary of the points: float32 rows with weights.

Distances are float32 like the points; sums over points are float64.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.ops.kmeans import Doubles, Floats, Ids
from spgf_torch.ops.registration import memory, operator

# Points whose distances to a centre are summed up at once: they stay in the first cache.
BLOCK = 512

Settled = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]


class Weighted(NamedTuple):
    """Points with weights (N,): as columns (D, N), which the compiled loops take, and as rows (N, D)."""

    columns: Tensor
    rows: Tensor
    weights: Tensor

    @staticmethod
    def of(rows: Tensor, weights: Tensor) -> Weighted:
        return Weighted(rows.T.contiguous(), rows, weights)


@operator("plusplus(Tensor points, Tensor weights, Tensor draws) -> Tensor")
def plusplus(points: Tensor, weights: Tensor, draws: Tensor) -> Tensor:
    """Greedy k-means++: starts (R, K, D) from points (N, D) with weights (N,), by draws (R, K, tries) in [0, 1)."""
    starts = points.new_empty((*draws.shape[:2], points.shape[1]))
    for r in range(len(draws)):
        share = weights
        for k in range(draws.shape[1]):
            heights, errors = share.double().cumsum(0), []
            for t in range(draws.shape[2] if k > 0 else 1):
                chosen = int(torch.searchsorted(heights, draws[r, k, t] * heights[-1], right=True))
                chosen = min(chosen, len(points) - 1)
                tried = (points - points[chosen]).square().cumsum(1)[:, -1] * weights
                tried = torch.minimum(tried, share) if k > 0 else tried
                errors.append((float(tried.sum(dtype=torch.float64)), chosen, tried))
            _, chosen, share = min(errors, key=lambda error: error[0])
            starts[r, k] = points[chosen]
    return starts


@plusplus.on_cpu
def _plusplus_in_loops(points: Tensor, weights: Tensor, draws: Tensor) -> Tensor:
    starts = points.new_empty((*draws.shape[:2], points.shape[1]))
    _plusplus(memory(points.T), memory(points), memory(weights), memory(draws), starts.numpy())
    return starts


@plusplus.fake
def _plusplus_shapes(points: Tensor, weights: Tensor, draws: Tensor) -> Tensor:
    return points.new_empty((*draws.shape[:2], points.shape[1]))


@operator(
    "settle(Tensor[] points, Tensor centres, int steps, float tolerance) "
    "-> (Tensor centres, Tensor inertia, Tensor distance, Tensor second, Tensor ids)"
)
def settle(points: Weighted, centres: Tensor, steps: int, tolerance: float) -> Settled:
    """Lloyd steps on N points with weights, from centres (K, D).

    Ends after `steps` or when a step lowers the inertia by no more than the share `tolerance`. A centre without points
    moves to the point that is farthest from its own. Returns the centres; their inertia, a scalar f64; squared
    distances (N,) to the nearest and the next centre; and the nearest (N,) int64, of equals the first.
    """
    (_, rows, weights), centres, last = Weighted(*points), centres.clone(), float("inf")
    for _ in range(steps):
        distance, _, ids = _distances(rows, centres)
        now = float((weights * distance).sum(dtype=torch.float64))
        if last - now <= tolerance * now:
            break
        last = now
        sums = torch.zeros_like(centres, dtype=torch.float64).index_add_(0, ids, (weights[:, None] * rows).double())
        sizes = torch.zeros_like(centres[:, 0], dtype=torch.float64).index_add_(0, ids, weights.double())
        means = (sums / sizes[:, None]).to(centres)
        for k in (sizes == 0).nonzero()[:, 0].tolist():
            far = distance.argmax()
            means[k], distance[far] = rows[far], -1
        centres = means
    distance, second, ids = _distances(rows, centres)
    return centres, (weights * distance).sum(dtype=torch.float64), distance, second, ids


def _distances(points: Tensor, centres: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Squared distance to the nearest and the next centre, and the nearest, by the sums of the compiled loop."""
    squares = (points[:, None] - centres).square()
    fours, rest = squares.shape[2] // 4 * 4, squares.shape[2] % 4
    total = squares.new_zeros(squares.shape[:2])
    for j in range(0, fours, 4):
        total = total + ((squares[..., j] + squares[..., j + 1]) + (squares[..., j + 2] + squares[..., j + 3]))
    for j in range(fours, fours + rest):
        total = total + squares[..., j]
    distance, ids = total.gather(1, total.argmin(1, keepdim=True))[:, 0], total.argmin(1)
    others = total.scatter(1, ids[:, None], float("inf"))
    return distance, others.amin(1), ids


@settle.on_cpu
def _settle_in_loops(points: Weighted, centres: Tensor, steps: int, tolerance: float) -> Settled:
    moved, N = centres.detach().clone(memory_format=torch.contiguous_format), len(points[1])
    nearest = Nearest(np.empty(N, np.float32), np.empty(N, np.float32), np.empty(N, np.int64))
    inertia = _settle(Columns(*(memory(part) for part in points)), steps, tolerance, moved.numpy(), nearest)
    distance, second, ids = (torch.from_numpy(column) for column in nearest)
    return moved, torch.tensor(inertia, dtype=torch.float64), distance, second, ids


@settle.fake
def _settle_shapes(points: Weighted, centres: Tensor, steps: int, tolerance: float) -> Settled:
    rows = points[1]
    distance, second = rows.new_empty(rows.shape[0]), rows.new_empty(rows.shape[0])
    inertia, ids = rows.new_empty((), dtype=torch.float64), rows.new_empty(rows.shape[0], dtype=torch.int64)
    return torch.empty_like(centres), inertia, distance, second, ids


class Columns(NamedTuple):
    """`Weighted` for compiled loops."""

    columns: Floats
    rows: Floats
    weights: Floats


class Nearest(NamedTuple):
    """Of each point (N,): squared distance to the nearest and the next centre, and the nearest."""

    distance: Floats
    second: Floats
    ids: Ids


@compiled
def find_nearest(columns: Floats, centres: Floats, second: Floats, distance: Floats, ids: Ids) -> None:
    """Out: distance and ids (N,), and second (N,) if it is not empty, of points as columns (D, N), centres (K, D)."""
    D, N = columns.shape
    sums = np.empty(BLOCK, np.float32)
    distance[:], second[:], ids[:] = np.inf, np.inf, 0
    for start in range(0, N, BLOCK):
        part = slice(start, min(start + BLOCK, N))
        least, found, other = distance[part], ids[part], second[part]
        total = sums[: len(least)]
        for k in range(len(centres)):
            total[:] = 0
            for j in range(0, D - 3, 4):  # four at once: a quarter of the traffic
                a, b, c, d = columns[j, part], columns[j + 1, part], columns[j + 2, part], columns[j + 3, part]
                p, q, r, s = centres[k, j], centres[k, j + 1], centres[k, j + 2], centres[k, j + 3]
                for i in range(len(total)):
                    total[i] += ((a[i] - p) ** 2 + (b[i] - q) ** 2) + ((c[i] - r) ** 2 + (d[i] - s) ** 2)
            for j in range(D - D % 4, D):
                a, p = columns[j, part], centres[k, j]
                for i in range(len(total)):
                    total[i] += (a[i] - p) ** 2
            for i in range(len(other)):
                other[i] = min(other[i], max(total[i], least[i]))
            for i in range(len(total)):
                found[i] = k if total[i] < least[i] else found[i]
                least[i] = min(least[i], total[i])


@compiled
def _settle(points: Columns, steps: int, tolerance: float, centres: Floats, found: Nearest) -> float:
    """The inertia. In and out: centres (K, D). Out: found."""
    rows, weights = points.rows, points.weights
    sums, sizes = np.empty(centres.shape, np.float64), np.empty(len(centres), np.float64)
    last = np.inf
    for _ in range(steps):
        find_nearest(points.columns, centres, found.second[:0], found.distance, found.ids)
        sums[:], sizes[:], now = 0, 0, 0.0
        for i in range(len(rows)):
            k, weight = found.ids[i], weights[i]
            now += weight * found.distance[i]
            sizes[k] += weight
            for j in range(rows.shape[1]):
                sums[k, j] += weight * rows[i, j]
        if last - now <= tolerance * now:
            break
        last = now
        for k in range(len(centres)):
            if sizes[k] > 0:
                for j in range(rows.shape[1]):
                    centres[k, j] = sums[k, j] / sizes[k]
            else:
                far = found.distance.argmax()
                centres[k], found.distance[far] = rows[far], -1
    find_nearest(points.columns, centres, found.second, found.distance, found.ids)
    now = 0.0
    for i in range(len(rows)):
        now += weights[i] * found.distance[i]
    return now


@compiled
def _plusplus(columns: Floats, points: Floats, weights: Floats, draws: Doubles, starts: Floats) -> None:
    """Out: starts (R, K, D)."""
    tried, best, share = np.empty_like(weights), np.empty_like(weights), np.empty_like(weights)
    for r in range(len(draws)):
        share[:] = weights
        for k in range(draws.shape[1]):
            total, least = 0.0, np.inf
            for i in range(len(share)):
                total += share[i]
            for t in range(draws.shape[2] if k > 0 else 1):
                chosen = _drawn(share, draws[r, k, t] * total)
                error = _try(columns, points[chosen], weights, share, k == 0, tried)
                if t == 0 or error < least:
                    least, starts[r, k], best[:] = error, points[chosen], tried
            share[:] = best


@lean
def _drawn(share: Floats, height: float) -> int:
    """The point at this height, where points are as high as their share (N,) and lie on each other."""
    chosen = -1
    while height >= 0 and chosen < len(share) - 1:
        chosen += 1
        height -= share[chosen]
    return chosen


@lean
def _try(columns: Floats, place: Floats, weights: Floats, share: Floats, alone: bool, tried: Floats) -> float:
    """The error with one more centre at `place` (D,), the first or not. Out: tried (N,), each point's part of it."""
    tried[:] = 0
    for j in range(len(columns)):
        for i in range(len(tried)):
            tried[i] += (columns[j, i] - place[j]) ** 2
    error = 0.0
    for i in range(len(tried)):
        tried[i] = tried[i] * weights[i] if alone else min(tried[i] * weights[i], share[i])
        error += tried[i]
    return error
