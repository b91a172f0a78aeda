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

from spgf_torch.compiled import compiled, lean

# What a gap is encoded as: (alpha1, alpha2) of the top and of the bottom layer.
GAPS = {
    "saturated": ((math.pi / 2, math.pi / 2), (math.pi / 2, math.pi)),  # the paper's
    "flat": ((0.0, 0.0), (0.0, math.pi)),  # a plane, and the far side of a flat wall
}

Window = tuple[np.ndarray, np.ndarray]


def averaged(grid: np.ndarray, half_length: int, gaps: str, soft: bool) -> tuple[np.ndarray, np.ndarray]:
    """The rings (N, 2, cells, 2) of grids (N, 2, 3, cells), gaps encoded; (N,) whether they are not all gap.

    Weighted moving average around each ring, with the window of `triangle`: fills the holes that sampling leaves. An
    empty cell does not count. The paper averages the cells' means, one like another; with `soft` each neighbour counts
    for itself. A cell that nothing reached gets the value of a gap.

    Neighbours that count as perpendicular (`relations.SINGULAR`) do not raise a cell of the top layer above 90 deg, or
    rounding would decide between an edge and a gap.
    """
    N, _, _, cells = grid.shape
    rings, valid = np.empty((N, 2, cells, 2), grid.dtype), np.empty(N, np.bool_)
    ahead, weight = triangle(cells, half_length)
    reach = -int(ahead.min()), int(ahead.max())
    _averaged(grid, (ahead, weight.astype(grid.dtype)), reach, np.array(GAPS[gaps], grid.dtype), soft, rings, valid)
    return rings, valid


def averaged_in_torch(grid: Tensor, half_length: int, gaps: str, soft: bool) -> tuple[Tensor, Tensor]:
    """`averaged` by torch's operations, on any device."""
    number = grid[:, :, :1]
    values = grid if soft else grid * (1 / number.clamp(min=1))
    ahead, weight = triangle(grid.shape[3], half_length)
    sums = torch.zeros_like(values)
    for step in range(0, len(ahead), 4):
        a, b, c, d = (
            float(w) * values.roll(-int(k), dims=3)
            for k, w in zip(ahead[step : step + 4], weight[step : step + 4], strict=True)
        )
        sums = sums + ((a + b) + (c + d))
    gap = torch.tensor(GAPS[gaps], dtype=grid.dtype, device=grid.device)
    rings = torch.where(sums[:, :, :1] > 0, (1 / sums[:, :, :1]) * sums[:, :, 1:], gap[:, :, None]).mT.contiguous()
    rings[:, 0, :, 1].clamp_(max=math.pi / 2)
    return rings, (number > 0).flatten(1).any(1)


@lru_cache
def triangle(cells: int, half_length: int) -> Window:
    """The moving average's filter: how many cells ahead (behind: negative), and what a cell counts there, by fours.

    At distance |k| <= n = half_length that is (n + 1 - |k|) / (n + 1): the paper gives no formula, but the bars of its
    Fig. 4 fall with the distance. Of two ways round the ring the shorter counts.
    """
    ahead = np.arange(cells)
    ahead -= cells * (ahead > cells - ahead)
    weight = np.maximum(half_length + 1 - abs(ahead), 0) / (half_length + 1)
    ahead, weight = ahead[weight > 0], weight[weight > 0]
    missing = (0, -len(ahead) % 4)
    return np.pad(ahead, missing), np.pad(weight, missing)


@compiled
def _averaged(
    grid: np.ndarray,
    window: Window,
    reach: tuple[int, int],
    gap: np.ndarray,
    soft: bool,
    rings: np.ndarray,
    valid: np.ndarray,
) -> None:
    cells, behind = grid.shape[3], reach[0]
    row = behind + cells + reach[1]  # a ring, and before and after it the cells that the filter reaches
    values, sums = np.zeros(3 * row, grid.dtype), np.empty(2 * row + cells, grid.dtype)
    for i in range(len(grid)):
        valid[i] = False
        for layer in range(2):
            sums[:] = 0
            if _spread(grid[i, layer], soft, behind, values):
                valid[i] = True
                _add_weighted(values, behind, window, sums)
            _divide(sums, row, gap[layer], rings[i, layer])
        for cell in range(cells):
            rings[i, 0, cell, 1] = min(rings[i, 0, cell, 1], math.pi / 2)


@lean
def _spread(grid: np.ndarray, soft: bool, behind: int, values: np.ndarray) -> bool:
    """Out: values (3 row,), what each cell counts, and that times its alphas, of a layer (3, cells); false of none."""
    cells, row, one = grid.shape[1], len(values) // 3, grid.dtype.type(1)
    number, alpha1, alpha2, found = grid[0], grid[1], grid[2], False
    own, first, second = values[behind:], values[row + behind :], values[2 * row + behind :]
    for cell in range(cells):
        share = one if soft else one / max(number[cell], one)
        own[cell], first[cell], second[cell] = share * number[cell], share * alpha1[cell], share * alpha2[cell]
        found |= number[cell] > 0
    for k in range(0, 3 * row, row):
        for cell in range(behind):
            values[k + cell] = values[k + cells + cell]
        for cell in range(behind + cells, row):
            values[k + cell] = values[k + cell - cells]
    return found


@lean
def _add_weighted(values: np.ndarray, behind: int, window: Window, sums: np.ndarray) -> None:
    """In and out: sums. All three rows at once; what lies between two rows is not looked at."""
    for step in range(0, len(window[0]), 4):  # four at once: a quarter of the traffic
        place, weight = window[0][step : step + 4], window[1][step : step + 4]
        a, b = values[behind + place[0] :], values[behind + place[1] :]
        c, d = values[behind + place[2] :], values[behind + place[3] :]
        e, f, g, h = weight[0], weight[1], weight[2], weight[3]
        for k in range(len(sums)):
            sums[k] += (e * a[k] + f * b[k]) + (g * c[k] + h * d[k])


@lean
def _divide(sums: np.ndarray, row: int, gap: np.ndarray, ring: np.ndarray) -> None:
    """Out: ring (cells, 2), the means of a layer; a gap where nothing was added up."""
    alpha1, alpha2, one = sums[row:], sums[2 * row :], sums.dtype.type(1)
    for cell in range(len(ring)):
        share = one / sums[cell]
        first, second = share * alpha1[cell], share * alpha2[cell]
        ring[cell, 0] = first if sums[cell] > 0 else gap[0]
        ring[cell, 1] = second if sums[cell] > 0 else gap[1]
