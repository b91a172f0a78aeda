"""The widest gap between surfaces that face each other: points between the fingers of hands -> one gap a hand."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.registration import memory, operator

# Cosine with the closing axis from which on a surface faces along it.
FACING = 0.5


@operator("facing_gap(Tensor x, Tensor facing, Tensor between) -> Tensor")
def facing_gap(x: Tensor, facing: Tensor, between: Tensor) -> Tensor:
    """(G,) f32, of points at x (G, N), m, that are `between` the fingers the widest step to the next facing back.

    facing (G, N): the cosine of their normals with x. A point that faces along x has the nearest behind it, along x,
    that faces the other way. 0 without such a pair.
    """
    gap = x.new_zeros(len(x))
    for g, on in enumerate(between):
        along, cosine = x[g, on], facing[g, on]
        step = along[cosine < -FACING] - along[cosine > FACING].unsqueeze(1)
        nearest = torch.where(step > 0, step, torch.inf)
        if nearest.numel() and bool((found := nearest.amin(1)).isfinite().any()):
            gap[g] = found[found.isfinite()].amax()
    return gap


@facing_gap.on_cpu
def _in_loops(x: Tensor, facing: Tensor, between: Tensor) -> Tensor:
    gap = np.zeros(len(x), np.float32)
    _widen(memory(x), memory(facing), memory(between), gap)
    return torch.from_numpy(gap)


@facing_gap.fake
def _shapes(x: Tensor, facing: Tensor, between: Tensor) -> Tensor:
    return x.new_empty(x.shape[0])


@compiled
def _widen(x: np.ndarray, facing: np.ndarray, between: np.ndarray, gap: np.ndarray) -> None:
    """Raise gap (G,)."""
    for g in range(len(x)):
        on = np.flatnonzero(between[g])
        for i in on:
            if facing[g, i] > FACING:
                nearest = np.float32(np.inf)
                for j in on:
                    if facing[g, j] < -FACING and x[g, j] > x[g, i]:
                        nearest = min(nearest, x[g, j] - x[g, i])
                if nearest < np.inf:
                    gap[g] = max(gap[g], nearest)
