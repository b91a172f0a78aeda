"""Farthest-point sampling: a few points that are spread over all of them."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import lean
from spgf_torch.ops.registration import memory, operator


@operator("farthest_first(Tensor points, Tensor distance, int count) -> Tensor")
def farthest_first(points: Tensor, distance: Tensor, count: int) -> Tensor:
    """(count,) int64: the point (N, D) of the greatest distance (N,), then always the one farthest from all before.

    Of equals the first. float64; count: N at most.
    """
    order = torch.empty(count, dtype=torch.int64, device=points.device)
    for k in range(count):
        order[k] = distance.argmax()
        apart = torch.zeros_like(distance)
        for column in points.unbind(1):
            apart = apart + (column - column[order[k]]).square()
        distance = apart if k == 0 else torch.minimum(distance, apart)
    return order


@farthest_first.on_cpu
def _in_loops(points: Tensor, distance: Tensor, count: int) -> Tensor:
    order = np.empty(count, np.int64)
    _farthest_first(memory(points), memory(distance).copy(), order)
    return torch.from_numpy(order)


@farthest_first.fake
def _shapes(points: Tensor, distance: Tensor, count: int) -> Tensor:
    return points.new_empty(count, dtype=torch.int64)


@lean
def _farthest_first(points: np.ndarray, distance: np.ndarray, order: np.ndarray) -> None:
    """Out: order. Scratch: distance, to the points so far."""
    for k in range(len(order)):
        farthest = 0
        for i in range(1, len(distance)):
            if distance[i] > distance[farthest]:
                farthest = i
        order[k] = farthest
        for i in range(len(points)):
            apart = 0.0
            for d in range(points.shape[1]):
                apart += (points[i, d] - points[order[k], d]) ** 2
            distance[i] = apart if k == 0 else min(distance[i], apart)
