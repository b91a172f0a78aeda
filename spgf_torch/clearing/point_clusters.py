"""What Contact-GraspNet calls of `torch_cluster`, which has no wheel for current torch; compiled by numba.

It imports nothing of ours, since it runs in the peer's environment too (`cgn_worker`). Order and ties are those of the
sources of torch_cluster 1.6: `fps_cpu.cpp`, and of the ball query `radius_cuda.cu`, with which the network was trained.
All points are of one example: the batches that torch_geometric hands on are zeros.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor


def fps(
    src: Tensor,
    batch: Tensor | None = None,
    ratio: float | Tensor | None = None,
    random_start: bool = True,
    batch_size: int | None = None,
) -> Tensor:
    """Furthest point sampling of points (N, 3): indices (ceil(ratio N)) int64.

    Each is the point furthest from those before it, the first of equals. The first is drawn from torch's generator,
    or is point 0. The count is taken in float32, as there: 2048 / 20000 of 20000 are 2048.
    """
    _one_example(batch)
    count = math.ceil(float(torch.tensor(float(len(src))) * torch.tensor(0.5 if ratio is None else float(ratio))))
    start = int(torch.randint(len(src), (1,))) if random_start else 0
    return torch.from_numpy(_furthest(_plain(src), count, start))


def radius(
    x: Tensor,
    y: Tensor,
    r: float,
    batch_x: Tensor | None = None,
    batch_y: Tensor | None = None,
    max_num_neighbors: int = 32,
    num_workers: int = 1,
    batch_size: int | None = None,
) -> Tensor:
    """Ball query: pairs (2, E) int64, row 0 into y (M, 3) and ascending, row 1 into x (N, 3), nearer than r.

    Of each ball the points of lowest index, at most `max_num_neighbors`, ascending.
    """
    _one_example(batch_x, batch_y)
    squared: Any = np.float32(r) * np.float32(r)
    return torch.from_numpy(_balls(_plain(x), _plain(y), squared, max_num_neighbors))


def knn(
    x: Tensor,
    y: Tensor,
    k: int,
    batch_x: Tensor | None = None,
    batch_y: Tensor | None = None,
    cosine: bool = False,
    num_workers: int = 1,
    batch_size: int | None = None,
) -> Tensor:
    """Pairs (2, M min(k, N)) int64: for each of y (M, 3) the nearest of x (N, 3), the nearest first.

    torch_geometric looks for the word batch_size here.
    """
    _one_example(batch_x, batch_y)
    if cosine:
        raise NotImplementedError("knn: cosine is not called by the network")
    k = min(k, len(x))
    nearest = np.asarray(KDTree(_plain(x)).query(_plain(y), k)[1], np.int64).reshape(-1)
    return torch.stack([torch.arange(len(y)).repeat_interleave(k), torch.from_numpy(nearest)])


def _one_example(*batches: Tensor | None) -> None:
    if any(batch is not None and bool(batch.any()) for batch in batches):
        raise NotImplementedError("batch: expected one example")


def _plain(points: Tensor) -> np.ndarray:
    return np.ascontiguousarray(points.detach().cpu().numpy(), np.float32)


@numba.njit
def _furthest(points: np.ndarray, count: int, start: int) -> np.ndarray:
    chosen = np.empty(count, np.int64)
    nearest = np.full(len(points), np.inf, np.float32)  # squared distance to the chosen
    last = start
    for i in range(count):
        chosen[i] = last
        furthest = 0
        for j in range(len(points)):
            dx, dy, dz = points[j, 0] - points[last, 0], points[j, 1] - points[last, 1], points[j, 2] - points[last, 2]
            nearest[j] = min(nearest[j], dx * dx + dy * dy + dz * dz)
            if nearest[j] > nearest[furthest]:
                furthest = j
        last = furthest
    return chosen


@numba.njit
def _balls(x: np.ndarray, y: np.ndarray, squared: float, most: int) -> np.ndarray:
    pairs = np.empty((2, len(y) * most), np.int64)
    found = 0
    for i in range(len(y)):
        full = found + most
        for j in range(len(x)):
            dx, dy, dz = x[j, 0] - y[i, 0], x[j, 1] - y[i, 1], x[j, 2] - y[i, 2]
            if dx * dx + dy * dy + dz * dz < squared:
                pairs[0, found], pairs[1, found] = i, j
                found += 1
                if found == full:
                    break
    return pairs[:, :found].copy()
