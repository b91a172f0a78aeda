"""All pairs of points within a radius."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from spgf_torch.config import InputError

# Distances held at once by the dense search: 16 M float64 are 0.13 GB.
DENSE_BLOCK = 1 << 24


def radius_pairs(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Every ordered pair of different points at most `radius` (m) apart.

    points: (N, 3), any float type, on any device. Returns (centre, neighbour), each (P,) int64 on the device
    of the points, sorted by centre and then by neighbour; each pair occurs both ways round. Two points at the
    same place are neighbours of each other; a point is never its own. Distances are compared in float64.
    """
    if points.ndim != 2 or points.shape[1] != 3 or not torch.isfinite(points).all():
        raise InputError(f"points: expected finite coordinates of shape (N, 3), got {_what(points)}")
    return _tree_pairs(points, radius) if points.device.type == "cpu" else _dense_pairs(points, radius)


def _what(points: Tensor) -> str:
    return f"shape {tuple(points.shape)}" if points.shape[1:] != (3,) else "NaN or infinite values"


def _tree_pairs(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """By a k-d tree, time and memory in proportion to the number of pairs."""
    tree = cKDTree(points.detach().numpy())
    once = tree.query_pairs(radius, output_type="ndarray")
    # One sort of a combined key is faster than a lexicographic sort of two.
    N = len(points)
    key = np.concatenate([once[:, 0] * N + once[:, 1], once[:, 1] * N + once[:, 0]])
    key.sort()
    centre, neighbour = np.divmod(key, N) if N else (key, key)
    return torch.from_numpy(centre), torch.from_numpy(neighbour)


def _dense_pairs(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """By all distances, a block of rows at a time: what an accelerator is fast at."""
    exact = points.detach().double()
    N = len(exact)
    rows = max(1, DENSE_BLOCK // max(1, N))
    found = []
    for start in range(0, N, rows):
        block = exact[start : start + rows]
        distance = torch.cdist(block, exact, compute_mode="donot_use_mm_for_euclid_dist")
        pairs = (distance <= radius).nonzero()
        pairs[:, 0] += start
        found.append(pairs[pairs[:, 0] != pairs[:, 1]])
    centre, neighbour = torch.cat(found).unbind(1) if found else exact.new_empty((2, 0), dtype=torch.int64).unbind()
    return centre, neighbour
