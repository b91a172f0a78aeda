"""k-means (Lloyd 1982) in single steps: pure functions of torch tensors, on any device.

`points` (N, D) and `centres` (K, D) are of one floating type. Work goes in chunks of points, so that memory
does not grow with N * K. Sums over clusters are products with a 0/1 matrix: as fast as `index_add_` and, unlike it,
the same in every run on an accelerator too.
"""

from __future__ import annotations

import torch
from torch import Tensor

# Distances in memory at once; 4 MB of float32.
CHUNK = 1 << 20


def squared_distances(points: Tensor, centres: Tensor) -> Tensor:
    """(N, K) squared Euclidean distances, |x|^2 - 2 x.c + |c|^2: never negative, off by about 1e-6 (|x|^2 + |c|^2)."""
    return _relative_distances(points, centres).add_(points.square().sum(1, keepdim=True)).clamp_(min=0)


def nearest(points: Tensor, centres: Tensor, norms: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Squared distance to (N,) and id of (N,) int64 the nearest centre; `norms` (N,): |x|^2, if it is known."""
    found = [_relative_distances(part, centres).min(1) for part in _chunks(points, len(centres))]
    norms = points.square().sum(1) if norms is None else norms
    return torch.cat([f.values for f in found]).add_(norms).clamp_(min=0), torch.cat([f.indices for f in found])


def assign(relations: Tensor, centres: Tensor) -> Tensor:
    """Id of the nearest prototype (Eqs. 7, 8): relations (L, D), centres (K, D) -> (L,) int64."""
    return torch.cat([_relative_distances(part, centres).argmin(1) for part in _chunks(relations, len(centres))])


def inertia(points: Tensor, centres: Tensor) -> float:
    """What k-means minimises: the sum of the points' squared distances to their nearest centre."""
    return float(nearest(points, centres)[0].double().sum())


def cluster_sums(points: Tensor, ids: Tensor, num_clusters: int) -> tuple[Tensor, Tensor]:
    """Sum (K, D) and number (K,), of the points' type, of each cluster's points."""
    sums = points.new_zeros(num_clusters, points.shape[1])
    for part, members in zip(_chunks(points, num_clusters), _chunks(ids, num_clusters), strict=True):
        belongs = points.new_zeros(num_clusters, len(part)).scatter_(0, members[None], 1.0)
        sums.addmm_(belongs, part)
    return sums, torch.bincount(ids, minlength=num_clusters).to(points)


def kmeans_plusplus(
    points: Tensor, num_clusters: int, restarts: int, generator: torch.Generator, tries: int = 2
) -> Tensor:
    """Starts (R, K, D) by greedy k-means++ (Arthur, Vassilvitskii 2007): of `tries` points the one that helps most.

    A point is drawn in proportion to its squared distance to the centres so far, so a copy of a centre is never
    drawn while points away from the centres are left.
    """
    rows = torch.arange(restarts, device=points.device)
    chosen = torch.randint(len(points), (restarts,), generator=generator).to(points.device)
    centres = [points[chosen]]
    distance = _exact_distances(points, centres[0])
    for _ in range(1, num_clusters):
        drawn = _draw(distance, tries, generator)
        reached = _exact_distances(points, points[drawn]).minimum(distance[:, None])
        best = reached.sum(2).argmin(1)
        centres.append(points[drawn[rows, best]])
        distance = reached[rows, best]
    return torch.stack(centres, dim=1)


def lloyd_step(points: Tensor, centres: Tensor, norms: Tensor | None = None) -> tuple[Tensor, float]:
    """Every centre moves to the mean of its points; the new centres (K, D) and the inertia of the old ones.

    A centre without points moves to a point far from its own centre. `norms` as in `nearest`.
    """
    distance, ids = nearest(points, centres, norms)
    sums, counts = cluster_sums(points, ids, len(centres))
    moved = torch.where(counts[:, None] > 0, sums / counts.clamp(min=1)[:, None], centres)
    return reassign_empty(points, moved, counts, distance), float(distance.double().sum())


def lloyd(points: Tensor, centres: Tensor, steps: int, tolerance: float) -> Tensor:
    """Lloyd steps until one lowers the inertia by no more than the share `tolerance`, or `steps` are done."""
    norms, last = points.square().sum(1), float("inf")
    for _ in range(steps):
        centres, now = lloyd_step(points, centres, norms)
        if last - now <= tolerance * now:
            break
        last = now
    return centres


def minibatch_step(batch: Tensor, centres: Tensor, counts: Tensor) -> tuple[Tensor, Tensor]:
    """Every centre becomes the mean of all the points that it was ever given (Sculley 2010).

    batch (B, D); counts (K,) of the points' type: how many points the centres stand for. Returns both anew.
    """
    sums, seen = cluster_sums(batch, assign(batch, centres), len(centres))
    total = counts + seen
    step = (sums - seen[:, None] * centres) / total.clamp(min=1)[:, None]
    return centres + step, total


def reassign_empty(points: Tensor, centres: Tensor, counts: Tensor, distance: Tensor) -> Tensor:
    """Centres with count 0 (K,) move to the points with the largest `distance` (N,) to their own centre."""
    empty = torch.nonzero(counts == 0).flatten()[: len(points)]
    if len(empty) == 0:
        return centres
    return centres.index_copy(0, empty, points[distance.topk(len(empty)).indices])


def canonical_order(centres: Tensor, counts: Tensor) -> Tensor:
    """The order (K,) of descending count, equals by their coordinates: equal clusterings get equal ids."""
    keys = [(-count, *row) for count, row in zip(counts.tolist(), centres.tolist(), strict=True)]
    return torch.tensor(sorted(range(len(keys)), key=keys.__getitem__), device=centres.device)


def _relative_distances(points: Tensor, centres: Tensor) -> Tensor:
    """(N, K) squared distances less |x|^2, which does not change which centre is nearest."""
    return torch.addmm(centres.square().sum(1), points, centres.T, alpha=-2)


def _exact_distances(points: Tensor, origins: Tensor) -> Tensor:
    """(..., N) squared distances of points (N, D) to origins (..., D), 0 for a point itself: no |x|^2 that cancels."""
    flat = origins.reshape(-1, origins.shape[-1])
    distances = torch.cdist(flat, points, compute_mode="donot_use_mm_for_euclid_dist").square_()
    return distances.view(*origins.shape[:-1], len(points))


def _draw(weight: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """(R, count) int64 columns of `weight` (R, N), drawn with replacement in proportion to it."""
    ladder = weight.double().cumsum(1)
    height = torch.rand(len(weight), count, generator=generator, dtype=torch.float64).to(weight.device)
    return torch.searchsorted(ladder, height * ladder[:, -1:], right=True).clamp(max=weight.shape[1] - 1)


def _chunks(rows: Tensor, num_clusters: int) -> tuple[Tensor, ...]:
    """The rows in parts (one empty part of no rows) whose distances to the centres fit in `CHUNK`."""
    return rows.split(max(1, CHUNK // num_clusters))
