"""Lloyd steps on all points until they no longer help.

On a CPU bounds on the distances (Elkan 2003) tell which points may have another nearest centre than before: soon few of
them, and only these are measured again. The ids are those of measuring all, but where two centres are as near up to
rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.ops.assignment import chunks, relative_distances
from spgf_torch.ops.kmeans import Doubles, Floats, Ids, add_nearest, flat, lloyd_step
from spgf_torch.ops.registration import operator
from spgf_torch.threads import in_parts, one_thread

# Points that a thread takes at once; sums over points are added up by these parts, whatever the number of threads.
PART = 1 << 13


@operator("lloyd(Tensor points, Tensor centres, int steps, float tolerance) -> (Tensor centres, Tensor counts)")
def lloyd(points: Tensor, centres: Tensor, steps: int, tolerance: float) -> tuple[Tensor, Tensor]:
    """Lloyd steps until one lowers the inertia by no more than the share `tolerance`, or `steps` are done.

    In a step every centre moves to the mean of its points; a centre without points moves to a point far from its own
    centre. Returns the centres (K, D) and how many points each of them is nearest to (K,) int64.
    """
    centres, last = centres.clone(), float("inf")
    norm = float(torch.linalg.vector_norm(points, dim=1).square().sum(dtype=torch.float64))
    sums, counts = lloyd_step.in_torch(points, centres)
    for _ in range(steps):
        centres, now = _means(points, centres, sums, counts, norm)
        sums, counts = lloyd_step.in_torch(points, centres)
        if last - now <= tolerance * now:
            break
        last = now
    return centres, counts


@lloyd.on_cpu
def _in_loops(points: Tensor, centres: Tensor, steps: int, tolerance: float) -> tuple[Tensor, Tensor]:
    nearest, last = _Nearest(points.detach(), centres.detach()), float("inf")
    with one_thread():
        for _ in range(steps):
            centres, now = nearest.means()
            nearest.follow(centres)
            if last - now <= tolerance * now:
                break
            last = now
    return nearest.centres.clone(), nearest.counts


@lloyd.fake
def _shapes(points: Tensor, centres: Tensor, steps: int, tolerance: float) -> tuple[Tensor, Tensor]:
    return torch.empty_like(centres), centres.new_empty(centres.shape[0], dtype=torch.int64)


def nearest_of(points: Tensor, centres: Tensor, norms: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Squared distance to (N,) and id of (N,) int64 the nearest centre; `norms` (N,): |x|^2, if it is known."""
    found = [relative_distances(part, centres).min(1) for part in chunks(points, len(centres))]
    norms = points.square().sum(1) if norms is None else norms
    return torch.cat([f.values for f in found]).add_(norms).clamp_(min=0), torch.cat([f.indices for f in found])


def reassign_empty(points: Tensor, centres: Tensor, counts: Tensor, distance: Tensor) -> Tensor:
    """Centres with count 0 (K,) move to the points with the largest `distance` (N,) to their own centre."""
    empty = torch.nonzero(counts == 0).flatten()[: len(points)]
    if len(empty) == 0:
        return centres
    return centres.index_copy(0, empty, points[distance.topk(len(empty)).indices])


def _means(points: Tensor, centres: Tensor, sums: Tensor, counts: Tensor, norm: float) -> tuple[Tensor, float]:
    """The centres' next places (K, D), and the inertia if no point changes its centre; norm: of all points, |x|^2."""
    means = sums / counts.clamp(min=1)[:, None]
    inertia = norm - float((counts * means.square().sum(1)).sum())
    moved = torch.where(counts[:, None] > 0, means.to(centres), centres)
    if not counts.all():
        moved = reassign_empty(points, moved, counts, nearest_of(points, centres)[0])
    return moved, max(inertia, 0.0)


class Bounds(NamedTuple):
    """Of each point's distances, for compiled loops.

    upper (N,): to the own centre; other (N,): to the nearest of the others; lower (N, K): to each centre, plus how far
    that had moved in all; ids (N,) int64: the own centre.
    """

    upper: Floats
    other: Floats
    lower: Floats
    ids: Ids


class Movement(NamedTuple):
    """Of the centres (K,): the last step, all steps together, and half the distance to the next centre."""

    step: Floats
    total: Floats
    half: Floats


class _Nearest:
    """The centre nearest to each point, kept up to date while the centres move."""

    def __init__(self, points: Tensor, centres: Tensor) -> None:
        kind, (N, K) = points.numpy().dtype, (len(points), len(centres))
        self.points, self.centres, self.norms = points, centres, np.empty(N, kind)
        self.bounds = Bounds(np.empty(N, kind), np.empty(N, kind), np.empty((N, K), kind), np.empty(N, np.int64))
        self.doubtful, self.moved = np.arange(N), np.zeros(K, kind)
        sums, counts = np.zeros(tuple(centres.shape)), np.zeros(K, np.int64)
        for part_sums, part_counts in in_parts(self._measure, range(0, N, PART)):
            sums += part_sums
            counts += part_counts
        self.sums, self.counts = torch.from_numpy(sums), torch.from_numpy(counts)
        self.norm = float(self.norms.sum(dtype=np.float64))

    def _measure(self, start: int) -> tuple[Doubles, Ids]:
        """All bounds of a part of the points; its sums and counts."""
        part = slice(start, start + PART)
        points, sums, counts = self.points[part], np.zeros(tuple(self.centres.shape)), np.zeros(len(self.centres), int)
        self.norms[part] = torch.linalg.vector_norm(points, dim=1).square_().numpy()
        relative = relative_distances(points, self.centres).numpy()
        add_nearest(relative, *flat(points), self.bounds.ids[part], sums, counts)
        _bound(relative, self.norms, self.moved, self.doubtful[part], self.bounds)
        return sums, counts

    def means(self) -> tuple[Tensor, float]:
        return _means(self.points, self.centres, self.sums, self.counts, self.norm)

    def follow(self, centres: Tensor) -> None:
        step = torch.linalg.vector_norm(centres - self.centres, dim=1).numpy()
        half = torch.cdist(centres, centres).fill_diagonal_(float("inf")).amin(1).div_(2).numpy()
        self.centres = centres
        self.moved += step
        which = self.doubtful[: _doubtful(Movement(step, self.moved, half), self.bounds, self.doubtful)]
        relative = relative_distances(self.points[torch.from_numpy(which)], centres).numpy()
        _reassign(relative, self.points.numpy(), which, self.bounds.ids, self.sums.numpy(), self.counts.numpy())
        _bound(relative, self.norms, self.moved, which, self.bounds)


@lean
def _bound(relative: Floats, norms: Floats, moved: Floats, which: Ids, bounds: Bounds) -> None:
    """In and out: bounds of the points `which` (n,), from relative (n, K) squared distances less norms (N,)."""
    upper, other, lower, ids = bounds
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
def _doubtful(movement: Movement, bounds: Bounds, which: Ids) -> int:
    """How many points, out: `which`, may have another nearest centre now. In and out: bounds.

    Points within half the distance from their own centre to the next one are safe.
    """
    step, moved, half = movement
    upper, other, lower, ids = bounds
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


@lean
def _reassign(relative: Floats, points: Floats, which: Ids, ids: Ids, sums: Doubles, counts: Ids) -> None:
    """In and out: ids, sums, counts. The points `which` (n,) go to the least of `relative` (n, K), if it is another."""
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
