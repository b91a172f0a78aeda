"""Compiled loops of k-means: distances and sums in one pass over the points (numba, see `compiled.py`).

Distances are float32 like the points; sums over points are float64, so that steps that add and take away do not drift.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from spgf_torch.compiled import compiled

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Ids = NDArray[np.int64]

# Points whose distances to a centre are summed up at once: they stay in the first cache.
BLOCK = 512


@compiled
def nearest(columns: Floats, centres: Floats, distance: Floats, second: Floats, ids: Ids) -> None:
    """Squared distance and id of each point's nearest centre; if `second` is not empty, the next distance too.

    columns (D, N), centres (K, D); distance, ids and second (N,) are written. Of equals the first centre counts.
    """
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
def lloyd(
    columns: Floats,
    rows: Floats,
    weights: Floats,
    centres: Floats,
    steps: int,
    tolerance: float,
    distance: Floats,
    second: Floats,
    ids: Ids,
) -> float:
    """Lloyd steps on weighted points, `centres` in place; their inertia. distance, second, ids: of the end's centres.

    Ends after `steps` or when a step lowers the inertia by no more than the share `tolerance`. A centre without points
    moves to the point that is farthest from its own.
    """
    K, D = centres.shape
    sums, sizes = np.empty((K, D), np.float64), np.empty(K, np.float64)
    last = np.inf
    for _ in range(steps):
        nearest(columns, centres, distance, second[:0], ids)
        sums[:], sizes[:], now = 0, 0, 0.0
        for i in range(len(rows)):
            k, weight = ids[i], weights[i]
            now += weight * distance[i]
            sizes[k] += weight
            for j in range(D):
                sums[k, j] += weight * rows[i, j]
        if last - now <= tolerance * now:
            break
        last = now
        for k in range(K):
            if sizes[k] > 0:
                for j in range(D):
                    centres[k, j] = sums[k, j] / sizes[k]
            else:
                far = distance.argmax()
                centres[k], distance[far] = rows[far], -1
    nearest(columns, centres, distance, second, ids)
    now = 0.0
    for i in range(len(rows)):
        now += weights[i] * distance[i]
    return now


@compiled
def plusplus(columns: Floats, points: Floats, weights: Floats, draws: Doubles, starts: Floats) -> None:
    """Greedy k-means++: starts (R, K, D) from points (N, D), also as columns, by draws (R, K, tries) in [0, 1)."""
    tried, best, share = np.empty_like(weights), np.empty_like(weights), np.empty_like(weights)
    for r in range(len(draws)):
        share[:] = weights
        for k in range(draws.shape[1]):
            total, least = 0.0, np.inf
            for i in range(len(share)):
                total += share[i]
            for t in range(draws.shape[2] if k > 0 else 1):
                chosen, height, error = -1, draws[r, k, t] * total, 0.0
                while height >= 0 and chosen < len(share) - 1:
                    chosen += 1
                    height -= share[chosen]
                tried[:] = 0
                for j in range(len(columns)):
                    place = points[chosen, j]
                    for i in range(len(tried)):
                        tried[i] += (columns[j, i] - place) ** 2
                for i in range(len(tried)):
                    tried[i] = min(tried[i] * weights[i], share[i]) if k > 0 else tried[i] * weights[i]
                    error += tried[i]
                if t == 0 or error < least:
                    least, starts[r, k], best[:] = error, points[chosen], tried
            share[:] = best


@compiled
def spread(rows: Floats, order: Ids, first: int, end: int) -> tuple[float, int, float]:
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
def split(rows: Floats, most: int, order: Ids) -> Ids:
    """Parts of rows (N, D) that are alike: bounds (parts + 1,) in `order` (N,), which is rearranged.

    The part of largest squared error is halved at its mean across its widest axis, until there are `most` or no part
    has any error.
    """
    error, axis, mean = spread(rows, order, 0, len(order))
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
            error, axis, mean = spread(rows, order, lower, upper)
            heapq.heappush(parts, (-error, lower, upper, axis, mean))
    bounds = np.empty(len(parts) + 1, np.int64)
    for p in range(len(parts)):
        bounds[p] = parts[p][1]
    bounds[-1] = len(order)
    bounds.sort()
    return bounds


def flat(points: Tensor) -> tuple[Floats, int]:
    """The memory of points (N, D) and the numbers from row to row: rows may lie apart, and loops stay fast."""
    points = points if points.stride(1) == 1 else points.contiguous()
    step = points.stride(0)
    return points.as_strided(((len(points) - 1) * step + points.shape[1],), (1,)).numpy(), step


@compiled
def add_members(points: Floats, step: int, ids: Ids, sums: Doubles, counts: Ids) -> None:
    """The points (`flat`) of the clusters ids (N,) are added to their sums (K, D), and counted."""
    for i in range(len(ids)):
        own, row = ids[i], points[i * step : i * step + sums.shape[1]]
        counts[own] += 1
        for j in range(len(row)):
            sums[own, j] += row[j]


@compiled
def add_nearest(relative: Floats, points: Floats, step: int, ids: Ids, sums: Doubles, counts: Ids) -> None:
    """ids (N,): column of the least of `relative` (N, K), the first of equals; the points are added to its sum."""
    N, K = relative.shape
    for i in range(N):
        least, own = relative[i, 0], 0
        for k in range(1, K):
            if relative[i, k] < least:
                least, own = relative[i, k], k
        ids[i] = own
    add_members(points, step, ids, sums, counts)


@compiled
def bound(
    relative: Floats, norms: Floats, moved: Floats, ids: Ids, upper: Floats, other: Floats, lower: Floats, which: Ids
) -> None:
    """Bounds from distances: relative (n, K) squared distances less |x|^2 of the points `which` (n,), ids of all (N,).

    upper (N,): distance to the own centre; other (N,): to the nearest of the others; lower (N, K): to each centre, plus
    how far it had `moved` (K,) in all.
    """
    for row in range(len(which)):
        i, least = which[row], np.float32(np.inf)
        for k in range(relative.shape[1]):
            distance = np.sqrt(max(relative[row, k] + norms[i], np.float32(0)))
            lower[i, k] = distance + moved[k]
            if k == ids[i]:
                upper[i] = distance
            else:
                least = min(least, distance)
        other[i] = least


@compiled
def doubtful(
    step: Floats, moved: Floats, half: Floats, ids: Ids, upper: Floats, other: Floats, lower: Floats, which: Ids
) -> int:
    """How many points, written to `which`, may have another nearest centre after each centre went `step` (K,).

    half (K,): half the distance from each centre to the next one; points within that are safe.
    """
    count, most = 0, step.max()
    for i in range(len(ids)):
        own = ids[i]
        upper[i] += step[own]
        other[i] -= most
        if upper[i] > half[own] and upper[i] > other[i]:
            least = np.float32(np.inf)
            for k in range(len(step)):
                if k != own:
                    least = min(least, lower[i, k] - moved[k])
            other[i] = least
            if upper[i] > least:
                which[count] = i
                count += 1
    return count


@compiled
def reassign(relative: Floats, points: Floats, which: Ids, ids: Ids, sums: Doubles, counts: Ids) -> None:
    """The points `which` (n,) go to the least of `relative` (n, K); from sum to sum, where that is another."""
    for row in range(len(which)):
        i, new = which[row], relative[row].argmin()
        old = ids[i]
        if new != old:
            ids[i] = new
            counts[old] -= 1
            counts[new] += 1
            for j in range(points.shape[1]):
                sums[old, j] -= points[i, j]
                sums[new, j] += points[i, j]
