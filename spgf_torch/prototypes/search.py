"""A start for k-means close to the global optimum: restarts on a sample, the best of them improved by breathing.

Restarts alone leave 1 % of inertia between seeds and other prototypes with it. What a sample of the points says in
their first principal components is enough to compare starts, at a tenth of the arithmetic.
"""

from __future__ import annotations

import torch
from torch import Tensor

from spgf_torch.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import (
    assign,
    cluster_sums,
    inertia,
    kmeans_plusplus,
    lloyd,
    nearest,
    reassign_empty,
    squared_distances,
)

# Lloyd steps that tell a good restart from a bad one.
RESTART_STEPS = 5

# Lloyd steps after a breath, at most, and the drop of inertia below which they end.
BREATH_STEPS, BREATH_TOLERANCE = 8, 1e-3

# A better start must be better by this share of the inertia, else breathing never ends.
GAIN = 1e-4

# Fritzke's theta: centres closer than this times the mean distance to the nearest centre do not go together.
CLOSE = 1.1


def initial_centres(points: Tensor, config: PrototypeConfig, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Centres (K, D), means of a sample of points (N, D), and how many points of the sample each stands for (K,)."""
    K = config.num_clusters
    sample = torch.randperm(len(points), generator=generator)[: config.subsample].to(points.device)
    projected = principal_components(points, config.components)
    thinned = projected[sample]
    drawn = kmeans_plusplus(thinned, K, config.restarts, generator)
    starts = [lloyd(thinned, start, RESTART_STEPS, 0.0) for start in drawn]
    finalists = sorted(starts, key=lambda start: inertia(thinned, start))[: config.finalists]
    finalists = [breathe(thinned, start, config.breath, generator) for start in finalists]
    best = breathe(projected, min(finalists, key=lambda start: inertia(projected, start)), config.breath, generator)
    members, ids = points[sample], assign(thinned, best)
    sums, counts = cluster_sums(members, ids, K)
    centres = sums / counts.clamp(min=1)[:, None]
    return reassign_empty(members, centres, counts, (members - centres[ids]).square().sum(1)), counts


def principal_components(points: Tensor, components: int) -> Tensor:
    """Points (N, D) about their mean, along their first principal axes: (N, min(components, D))."""
    centred = points - points.mean(0)
    if components >= points.shape[1]:
        return centred
    axes = torch.linalg.eigh(centred.T @ centred).eigenvectors
    return centred @ axes[:, -components:]


def breathe(points: Tensor, centres: Tensor, breath: int, generator: torch.Generator) -> Tensor:
    """Breathing k-means (Fritzke 2020, arXiv:2006.15666): add centres where the error is, drop the least useful.

    Moves between local optima that Lloyd steps alone cannot: as long as `breath` centres in and out lower the
    inertia it goes on, then with one fewer.
    """
    best = _settle(points, centres)
    reached, breath = inertia(points, best), min(breath, len(best) - 1)
    while breath > 0:
        inhaled = _settle(points, torch.cat([best, _added(points, best, breath, generator)]))
        exhaled = _settle(points, inhaled[_kept(points, inhaled, breath)])
        now = inertia(points, exhaled)
        if now < (1 - GAIN) * reached:
            best, reached = exhaled, now
        else:
            breath -= 1
    return best


def _settle(points: Tensor, centres: Tensor) -> Tensor:
    return lloyd(points, centres, BREATH_STEPS, BREATH_TOLERANCE)


def _added(points: Tensor, centres: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """New centres (count, D) within the clusters of largest error: half a standard deviation off their centres."""
    distance, ids = nearest(points, centres)
    sums, sizes = cluster_sums(distance[:, None], ids, len(centres))
    worst = sums[:, 0].topk(count).indices
    deviation = (sums[worst] / (sizes[worst, None].clamp(min=1) * points.shape[1])).sqrt()
    noise = torch.randn(count, points.shape[1], generator=generator, dtype=points.dtype).to(points.device)
    return centres[worst] + 0.5 * deviation * noise


def _kept(points: Tensor, centres: Tensor, dropped: int) -> Tensor:
    """(K,) bool: False for the `dropped` centres whose loss raises the inertia least, no two of them close."""
    distances = squared_distances(points, centres)
    first = distances.min(1)
    second = distances.scatter_(1, first.indices[:, None], float("inf")).amin(1)
    cost = cluster_sums((second - first.values)[:, None], first.indices, len(centres))[0][:, 0]
    apart = squared_distances(centres, centres).sqrt().fill_diagonal_(float("inf"))
    close = apart < CLOSE * apart.amin(1).mean()
    kept, penalty = torch.ones(len(centres), dtype=torch.bool, device=centres.device), cost.sum() + 1
    for _ in range(dropped):
        cheapest = int(cost.argmin())
        kept[cheapest] = False
        cost = cost + penalty * close[cheapest]
        cost[cheapest] = float("inf")
    return kept
