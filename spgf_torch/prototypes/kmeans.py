"""k-means: pure functions of torch tensors, on any device (`spgf_torch.ops`: `assignment`, `kmeans`, `lloyd`).

`points` (N, D) and `centres` (K, D) are of one floating type.
"""

from __future__ import annotations

import torch
from torch import Tensor

from spgf_torch.ops.assignment import assign
from spgf_torch.ops.kmeans import lloyd_step
from spgf_torch.ops.kmeans_start import plusplus
from spgf_torch.ops.lloyd import lloyd, nearest_of

__all__ = ["assign", "canonical_order", "inertia", "kmeans_plusplus", "lloyd", "minibatch_step"]


def inertia(points: Tensor, centres: Tensor) -> float:
    """What k-means minimises: the sum of the points' squared distances to their nearest centre."""
    return float(nearest_of(points, centres)[0].double().sum())


def kmeans_plusplus(
    points: Tensor,
    num_clusters: int,
    restarts: int,
    generator: torch.Generator,
    tries: int = 2,
    weights: Tensor | None = None,
) -> Tensor:
    """Starts (R, K, D) by greedy k-means++ (Arthur, Vassilvitskii 2007): of `tries` points the one that helps most.

    A point is drawn in proportion to its squared distance to the centres so far, so a copy of a centre is never
    drawn while points away from the centres are left. `weights` (N,): how many points each stands for.
    """
    weights = points.new_ones(len(points)) if weights is None else weights
    draws = torch.rand(restarts, num_clusters, tries, generator=generator, dtype=torch.float64)
    return plusplus(points, weights, draws.to(points.device))


def minibatch_step(batch: Tensor, centres: Tensor, counts: Tensor) -> tuple[Tensor, Tensor]:
    """Every centre becomes the mean of all the points that it was ever given (Sculley 2010).

    batch (B, D); counts (K,) of the points' type: how many points the centres stand for. Returns both anew.
    """
    sums, seen = lloyd_step(batch, centres)
    total = counts + seen
    step = (sums - seen[:, None] * centres.double()) / total.clamp(min=1)[:, None]
    return centres + step.to(centres), total


def canonical_order(centres: Tensor, counts: Tensor) -> Tensor:
    """The order (K,) of descending count, equals by their coordinates: equal clusterings get equal ids."""
    keys = [(-count, *row) for count, row in zip(counts.tolist(), centres.tolist(), strict=True)]
    return torch.tensor(sorted(range(len(keys)), key=keys.__getitem__), device=centres.device)
