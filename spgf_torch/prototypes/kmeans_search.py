"""A start for k-means close to the global optimum: restarts on a summary of the points, the best improved by breathing.

Restarts alone leave 1 % of inertia between seeds and other prototypes with it. The summary is the means of small parts
of the points in their first principal components: less than a hundredth of the arithmetic, and unlike a sample as
small it loses next to nothing of where the optimum lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from spgf_torch.ops.kmeans import Doubles, Floats, Ids, member_sums
from spgf_torch.ops.kmeans_partition import partition
from spgf_torch.ops.kmeans_start import Weighted, settle
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import kmeans_plusplus

# Points that are enough to know the principal axes from.
AXES_FROM = 3000

# Lloyd steps that tell a good restart from a bad one.
RESTART_STEPS = 5

# Lloyd steps after a breath, at most, and the drop of inertia below which they end.
BREATH_STEPS, BREATH_TOLERANCE = 30, 1e-4

# A better start must be better by this share of the inertia, else breathing never ends.
GAIN = 1e-4

# Fritzke's theta: centres closer than this times the mean distance to the nearest centre do not go together.
CLOSE = 1.1


@dataclass
class Settled:
    """Centres (K, D) after Lloyd steps.

    Attributes:
        inertia: the weighted sum of squared distances.
        distance, second: (M,) squared distances to the nearest and the next centre.
        ids: (M,) of the nearest.
    """

    centres: Floats
    inertia: float
    distance: Floats
    second: Floats
    ids: Ids


class Summary:
    """Points (N, D) as the means of at most `parts` parts: rows (M, D), weights (M,); `part` (N,) is each point's."""

    def __init__(self, points: Tensor, parts: int) -> None:
        self.part = partition(points, parts)
        sums, counts = member_sums(points, self.part, int(self.part.max()) + 1)
        self.points = Weighted.of((sums / counts[:, None]).float(), counts.float())

    def settle(self, centres: Floats, steps: int = BREATH_STEPS, tolerance: float = BREATH_TOLERANCE) -> Settled:
        found = settle(self.points, torch.from_numpy(centres), steps, tolerance)
        moved, inertia, distance, second, ids = (column.numpy() for column in found)
        return Settled(moved, float(inertia), distance, second, ids)

    def by_cluster(self, settled: Settled, values: Floats) -> Doubles:
        """Weighted sums (K,) of values (M,)."""
        weights = self.points.weights.numpy()
        return np.bincount(settled.ids, weights * values, len(settled.centres)).astype(np.float64)


def initial_centres(points: Tensor, config: PrototypeConfig, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Centres (K, D), means of a sample of points (N, D), and how many points of the sample each stands for (K,).

    The sample is every n-th point: where neighbours in the order are alike, it is better than a drawn one.
    """
    K, members = config.num_clusters, points[:: -(-len(points) // config.subsample)]
    summary = Summary(principal_components(members, config.components), config.parts)
    _, rows, weights = summary.points
    drawn = kmeans_plusplus(rows, K, config.restarts, generator, weights=weights)
    starts = [summary.settle(start.numpy(), RESTART_STEPS, 0.0) for start in drawn]
    finalists = sorted(starts, key=lambda start: start.inertia)[: config.finalists]
    finalists = [breathe(summary, start, config.breath, generator) for start in finalists]
    best = min(finalists, key=lambda start: start.inertia)
    sums, counts = member_sums(members, torch.from_numpy(best.ids)[summary.part], K)
    centres = torch.where(counts[:, None] > 0, sums / counts.clamp(min=1)[:, None], members[:1].double())
    return centres.to(points), counts.to(points)


def principal_components(points: Tensor, components: int) -> Tensor:
    """Points (N, D) about their mean, along their first principal axes: (N, min(components, D))."""
    some = points[:: -(-len(points) // AXES_FROM)]
    mean = some.mean(0)
    if components >= points.shape[1]:
        return points - mean
    centred = some - mean
    spread = centred.T @ centred
    try:
        axes = torch.linalg.eigh(spread).eigenvectors[:, -components:]
    except torch.linalg.LinAlgError:  # of fewer points than dimensions, most eigenvalues are 0 but for rounding
        axes = torch.linalg.eigh(spread.double()).eigenvectors[:, -components:].to(spread)
    return torch.addmm(-(mean @ axes), points, axes)


def breathe(summary: Summary, start: Settled, breath: int, generator: torch.Generator) -> Settled:
    """Breathing k-means (Fritzke 2020, arXiv:2006.15666): add centres where the error is, drop the least useful.

    Moves between local optima that Lloyd steps alone cannot: as long as `breath` centres in and out lower the
    inertia it goes on, then with one fewer.
    """
    best = summary.settle(start.centres)
    breath = min(breath, len(best.centres) - 1)
    while breath > 0:
        inhaled = summary.settle(np.concatenate([best.centres, _added(summary, best, breath, generator)]))
        exhaled = summary.settle(inhaled.centres[_kept(summary, inhaled, breath)])
        if exhaled.inertia < (1 - GAIN) * best.inertia:
            best = exhaled
        else:
            breath -= 1
    return best


def _added(summary: Summary, settled: Settled, count: int, generator: torch.Generator) -> Floats:
    """New centres (count, D) within the clusters of largest error: half a standard deviation off their centres."""
    errors = summary.by_cluster(settled, settled.distance)
    sizes = summary.by_cluster(settled, np.ones_like(settled.distance))
    worst = np.argsort(-errors, kind="stable")[:count]
    D = settled.centres.shape[1]
    deviation = np.sqrt(errors[worst] / (np.maximum(sizes[worst], 1) * D))
    noise = torch.randn(count, D, generator=generator).numpy()
    added: Floats = (settled.centres[worst] + 0.5 * deviation[:, None] * noise).astype(np.float32)
    return added


def _kept(summary: Summary, settled: Settled, dropped: int) -> NDArray[np.bool_]:
    """(K,): False for the `dropped` centres whose loss raises the inertia least, no two of them close."""
    centres = settled.centres
    cost = summary.by_cluster(settled, settled.second - settled.distance)
    apart = np.sqrt(((centres[:, None] - centres) ** 2).sum(2))
    np.fill_diagonal(apart, np.inf)
    close = apart < CLOSE * apart.min(1).mean()
    kept, penalty = np.ones(len(centres), bool), cost.sum() + 1
    for _ in range(dropped):
        cheapest = cost.argmin()
        kept[cheapest] = False
        cost += penalty * close[cheapest]
        cost[cheapest] = np.inf
    return kept
