"""All pairs of points within a radius."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from spgf_torch.config import InputError

# Points of one k-d tree. Two trees meet in at most BLOCK^2 pairs of 24 bytes: 0.4 GB however dense the cloud.
BLOCK = 4096

# Pairs that are kept for a second look: 0.3 GB.
KEPT = 1 << 24


def radius_pairs(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Every ordered pair of different points at most `radius` (m) apart.

    points: (N, 3), any float type, on any device. Returns (centre, neighbour), each (P,) int64 on the device
    of the points, sorted by centre and then by neighbour; each pair occurs both ways round. Two points at the
    same place are neighbours of each other; a point is never its own. Distances are compared in float64.

    Raises InputError for another shape and for NaN or infinite coordinates.
    """
    keys = [torch.cat([i << 32 | j, j << 32 | i]) for i, j in half_pairs(points, radius)]
    key = _sorted(torch.cat(keys)) if keys else torch.empty(0, dtype=torch.int64, device=points.device)
    return key >> 32, key & 0xFFFFFFFF


def _sorted(key: Tensor) -> Tensor:
    """One combined key sorts faster than two columns, and on a CPU numpy, which keeps no permutation, 5x faster."""
    return torch.from_numpy(np.sort(key.numpy())) if key.device.type == "cpu" else key.sort().values


class HalfPairs:
    """`half_pairs` to go through more than once: searched for once where they are at most `KEPT`."""

    def __init__(self, points: Tensor, radius: float) -> None:
        self.points, self.radius = points, radius
        self.kept: list[tuple[Tensor, Tensor]] | None = []
        count = 0
        for part in half_pairs(points, radius):
            self.kept.append(part)
            count += len(part[0])
            if count > KEPT:
                self.kept = None
                break

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        return half_pairs(self.points, self.radius) if self.kept is None else iter(self.kept)


def half_pairs(points: Tensor, radius: float) -> Iterator[tuple[Tensor, Tensor]]:
    """The unordered pairs {i, j} of `radius_pairs`, each once and in no order, in parts of bounded memory."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points: expected shape (N, 3), got {tuple(points.shape)}")
    if not torch.isfinite(points).all():
        raise InputError("points: expected finite coordinates, got NaN or infinite values")
    search = _by_trees if points.device.type == "cpu" else _by_distances
    return search(points.detach().double(), radius)


def _by_trees(points: Tensor, radius: float) -> Iterator[tuple[Tensor, Tensor]]:
    """By k-d trees of compact blocks of points, so that most pairs lie within one tree."""
    xyz = points.numpy()
    order = cKDTree(xyz).indices if len(xyz) > BLOCK else np.arange(len(xyz))
    blocks = [order[start : start + BLOCK] for start in range(0, len(xyz), BLOCK)]
    trees = [cKDTree(xyz[block]) for block in blocks]
    for a, tree in enumerate(trees):
        pairs = tree.query_pairs(radius, output_type="ndarray")
        ends = np.ascontiguousarray(pairs.T)
        yield torch.from_numpy(blocks[a][ends[0]]), torch.from_numpy(blocks[a][ends[1]])
        for b in range(a + 1, len(trees)):
            pairs = tree.sparse_distance_matrix(trees[b], radius, output_type="ndarray")
            if len(pairs):
                yield torch.from_numpy(blocks[a][pairs["i"]]), torch.from_numpy(blocks[b][pairs["j"]])


def _by_distances(points: Tensor, radius: float) -> Iterator[tuple[Tensor, Tensor]]:
    """By all distances, a band of rows at a time: what an accelerator is fast at."""
    rows = max(1, BLOCK**2 // max(1, len(points)))
    for start in range(0, len(points), rows):
        band, rest = points[start : start + rows], points[start:]
        distance = torch.cdist(band, rest, compute_mode="donot_use_mm_for_euclid_dist")
        i, j = (distance <= radius).nonzero().unbind(1)
        once = j > i
        yield i[once] + start, j[once] + start
