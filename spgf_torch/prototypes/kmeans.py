"""k-means: pure functions of torch tensors; those that move centres on the CPU, the others on any device.

`points` (N, D) and `centres` (K, D) are of one floating type. Distances are |x|^2 - 2 x.c + |c|^2, off by about
1e-6 (|x|^2 + |c|^2), and go in chunks of points.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.prototypes import kernels
from spgf_torch.threads import in_parts, one_thread

# Distances in memory at once; 4 MB of float32.
CHUNK = 1 << 20

# Points that a thread takes at once; sums over points are added up by these parts, whatever the number of threads.
PART = 1 << 13


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
    starts = points.new_empty(restarts, num_clusters, points.shape[1])
    columns = points.T.contiguous()
    kernels.plusplus(columns.numpy(), points.numpy(), weights.numpy(), draws.numpy(), starts.numpy())
    return starts


def lloyd(points: Tensor, centres: Tensor, steps: int, tolerance: float) -> tuple[Tensor, Tensor]:
    """Lloyd steps until one lowers the inertia by no more than the share `tolerance`, or `steps` are done.

    In a step every centre moves to the mean of its points; a centre without points moves to a point far from its own
    centre. Returns the centres (K, D) and how many points each of them is nearest to (K,). Memory: N * K numbers.
    """
    nearest_centres, last = _Nearest(points, centres), float("inf")
    with one_thread():
        for _ in range(steps):
            centres, now = nearest_centres.means()
            nearest_centres.follow(centres)
            if last - now <= tolerance * now:
                break
            last = now
    return nearest_centres.centres, torch.from_numpy(nearest_centres.counts)


def minibatch_step(batch: Tensor, centres: Tensor, counts: Tensor) -> tuple[Tensor, Tensor]:
    """Every centre becomes the mean of all the points that it was ever given (Sculley 2010).

    batch (B, D); counts (K,) of the points' type: how many points the centres stand for. Returns both anew.
    """
    sums, members = _no_members(centres)
    for part in _chunks(batch, len(centres)):
        ids = np.empty(len(part), np.int64)
        kernels.add_nearest(_relative_distances(part, centres).numpy(), *kernels.flat(part), ids, sums, members)
    seen = torch.from_numpy(members)
    total = counts + seen
    step = (torch.from_numpy(sums) - seen[:, None] * centres.double()) / total.clamp(min=1)[:, None]
    return centres + step.to(centres), total


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


class _Nearest:
    """The centre nearest to each point, kept up to date while the centres move.

    Bounds on the distances (Elkan 2003) tell which points may have changed: soon few of them, and only these are
    measured again. The ids are those of measuring all of them, but where two centres are as near up to rounding.
    """

    def __init__(self, points: Tensor, centres: Tensor) -> None:
        kind, (N, K) = points.numpy().dtype, (len(points), len(centres))
        self.points, self.centres = points, centres
        self.norms, self.upper, self.other, self.lower = (np.empty(shape, kind) for shape in (N, N, N, (N, K)))
        self.ids, self.doubtful, self.moved = np.empty(N, np.int64), np.arange(N), np.zeros(K, kind)
        self.sums, self.counts = _no_members(centres)
        for sums, counts in in_parts(self._measure, range(0, N, PART)):
            self.sums += sums
            self.counts += counts
        self.norm = float(self.norms.sum(dtype=np.float64))

    def _measure(self, start: int) -> tuple[kernels.Doubles, kernels.Ids]:
        """All bounds of a part of the points; its sums and counts."""
        part = slice(start, start + PART)
        points, (sums, counts) = self.points[part], _no_members(self.centres)
        self.norms[part] = torch.linalg.vector_norm(points, dim=1).square_().numpy()
        relative = _relative_distances(points, self.centres).numpy()
        kernels.add_nearest(relative, *kernels.flat(points), self.ids[part], sums, counts)
        self._bound(relative, self.doubtful[part])
        return sums, counts

    def _bound(self, relative: kernels.Floats, which: kernels.Ids) -> None:
        bounds = self.upper, self.other, self.lower
        kernels.bound(relative, self.norms, self.moved, self.ids, *bounds, which)

    def means(self) -> tuple[Tensor, float]:
        """The centres' next places (K, D), and the inertia if no point changes its centre."""
        counts = torch.from_numpy(self.counts)
        means = torch.from_numpy(self.sums / np.maximum(self.counts, 1)[:, None])
        inertia = self.norm - float((counts * means.square().sum(1)).sum())
        centres = torch.where(counts[:, None] > 0, means.to(self.centres), self.centres)
        if not counts.all():
            centres = reassign_empty(self.points, centres, counts, nearest(self.points, self.centres)[0])
        return centres, max(inertia, 0.0)

    def follow(self, centres: Tensor) -> None:
        step = torch.linalg.vector_norm(centres - self.centres, dim=1).numpy()
        half = torch.cdist(centres, centres).fill_diagonal_(float("inf")).amin(1).div_(2).numpy()
        self.centres = centres
        self.moved += step
        bounds = self.upper, self.other, self.lower
        which = self.doubtful[: kernels.doubtful(step, self.moved, half, self.ids, *bounds, self.doubtful)]
        relative = _relative_distances(self.points[torch.from_numpy(which)], centres).numpy()
        kernels.reassign(relative, self.points.numpy(), which, self.ids, self.sums, self.counts)
        self._bound(relative, which)


def _no_members(centres: Tensor) -> tuple[kernels.Doubles, kernels.Ids]:
    """Sums (K, D) and counts (K,) of no points."""
    return np.zeros(tuple(centres.shape)), np.zeros(len(centres), np.int64)


def _relative_distances(points: Tensor, centres: Tensor) -> Tensor:
    """(N, K) squared distances less |x|^2, which does not change which centre is nearest."""
    return torch.addmm(centres.square().sum(1), points, centres.T, alpha=-2)


def _chunks(rows: Tensor, num_clusters: int) -> tuple[Tensor, ...]:
    """The rows in parts (one empty part of no rows) whose distances to the centres fit in `CHUNK`."""
    return rows.split(max(1, CHUNK // num_clusters))
