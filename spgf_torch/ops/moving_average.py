"""The weighted moving average around each ring, and what is still a gap after it (paper, section 3.1.2, Fig. 4).

A part of the operator `describe`: grids of `ring_grid` in, rings (N, 2, N_g, 2) out: feature, layer (top, bottom),
cell, angle (alpha1, alpha2, in radians).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from spgf_torch.compiled import compiled

# What a gap is encoded as: (alpha1, alpha2) of the top and of the bottom layer.
GAPS = {
    "saturated": ((math.pi / 2, math.pi / 2), (math.pi / 2, math.pi)),  # the paper's
    "flat": ((0.0, 0.0), (0.0, math.pi)),  # a plane, and the far side of a flat wall
}


def averaged_in_torch(grid: Tensor, half_length: int, gaps: str, soft: bool) -> Tensor:
    """`averaged` by torch's operations, on any device: the rings (N, 2, cells, 2) of grids (N, 2, cells, 3)."""
    values = grid if soft else grid * (1 / grid[..., :1].clamp(min=1))
    ahead, weight = triangle(grid.shape[2], half_length, grid.dtype)
    sums = torch.zeros_like(values)
    for step in range(0, len(ahead), 4):
        a, b, c, d = (
            float(w) * values.roll(-int(k), dims=2)
            for k, w in zip(ahead[step : step + 4], weight[step : step + 4], strict=True)
        )
        sums = sums + ((a + b) + (c + d))
    gap = torch.tensor(GAPS[gaps], dtype=grid.dtype, device=grid.device)
    found = torch.where(sums[..., :1] > 0, (1 / sums[..., :1]) * sums[..., 1:], gap[:, None])
    found[:, 0, :, 1].clamp_(max=math.pi / 2)
    return found


@lru_cache
def triangle(cells: int, half_length: int, dtype: torch.dtype) -> tuple[np.ndarray, np.ndarray]:
    """The moving average's filter: how many cells ahead, going round, and what a cell counts there, by fours.

    At distance |k| <= n = half_length that is (n + 1 - |k|) / (n + 1) (the paper: "weight falling with distance"); of
    two ways round the ring the shorter counts.
    """
    ahead = torch.arange(cells, device="cpu")
    weight = (half_length + 1 - torch.minimum(ahead, cells - ahead)).clamp(min=0).to(dtype) / (half_length + 1)
    ahead, weight = ahead[weight > 0], weight[weight > 0]
    missing = (0, -len(ahead) % 4)
    return pad(ahead, missing).numpy(), pad(weight, missing).numpy()


@compiled
def averaged(
    grid: np.ndarray, window: tuple[np.ndarray, np.ndarray], gap: np.ndarray, soft: bool, rings: np.ndarray
) -> bool:
    """The rings (2, cells, 2) of a grid (2, cells, 3): averaged and gap-encoded; whether they are not all gap.

    Weighted moving average around each ring, with the window of `triangle`: fills the holes that sampling leaves. An
    empty cell does not count. The paper averages the cells' means, one like another; with `soft` each neighbour counts
    for itself. A cell that nothing reached gets the value of a gap.

    Neighbours that count as perpendicular (`SINGULAR`) do not raise a cell of the top layer above 90 deg, or rounding
    would decide between an edge and a gap.
    """
    cells, one, valid = grid.shape[1], grid.dtype.type(1), False
    values = np.empty(6 * cells, grid.dtype)  # weight, and weight times alpha1 and alpha2, of each cell: the ring twice
    sums = np.empty(3 * cells, grid.dtype)
    for layer in range(2):
        if not (grid[layer, :, 0] > 0).any():
            for cell in range(cells):
                rings[layer, cell, 0], rings[layer, cell, 1] = gap[layer, 0], gap[layer, 1]
            continue
        valid = True
        for cell in range(cells):
            share = one if soft else one / max(grid[layer, cell, 0], one)
            for k in range(3):
                values[3 * cell + k] = share * grid[layer, cell, k]
        for k in range(3 * cells):
            values[3 * cells + k], sums[k] = values[k], 0
        for step in range(0, len(window[0]), 4):  # four at once: a quarter of the traffic
            ahead, weight = window[0][step : step + 4], window[1][step : step + 4]
            a, b = values[3 * ahead[0] :], values[3 * ahead[1] :]
            c, d = values[3 * ahead[2] :], values[3 * ahead[3] :]
            e, f, g, h = weight[0], weight[1], weight[2], weight[3]
            for k in range(3 * cells):
                sums[k] += (e * a[k] + f * b[k]) + (g * c[k] + h * d[k])
        for cell in range(cells):
            reached = sums[3 * cell]
            share = one / reached
            rings[layer, cell, 0] = share * sums[3 * cell + 1] if reached > 0 else gap[layer, 0]
            rings[layer, cell, 1] = share * sums[3 * cell + 2] if reached > 0 else gap[layer, 1]
    for cell in range(cells):
        rings[0, cell, 1] = min(rings[0, cell, 1], math.pi / 2)
    return valid
