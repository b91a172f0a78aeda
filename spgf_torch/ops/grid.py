"""The sliced pineapple grid: neighbours in two rings of cells, smoothed, gaps encoded (paper, section 3.1.2).

A part of the operator `describe`.

Cell k of a ring is centred on alpha3 = k * 2 pi / N_g: it holds the neighbours with round(alpha3 / width) = k,
modulo N_g, so that turning the frame by whole cells moves the ring by whole cells. Rings are (N, 2, N_g, 2):
feature, layer (top, bottom), cell, angle (alpha1, alpha2, in radians).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from spgf_torch.compiled import compiled
from spgf_torch.ops.relations import SINGULAR

# What a gap is encoded as: (alpha1, alpha2) of the top and of the bottom layer.
GAPS = {
    "saturated": ((math.pi / 2, math.pi / 2), (math.pi / 2, math.pi)),  # the paper's
    "flat": ((0.0, 0.0), (0.0, math.pi)),  # a plane, and the far side of a flat wall
}


class Ring(NamedTuple):
    """Of a grid: cells around each ring, cells that the moving average reaches to each side, and layers (1 or 2)."""

    cells: int
    half_length: int
    layers: int


def rings(start: Tensor, angles: Tensor, ring: Ring, gaps: str, soft: bool = False) -> tuple[Tensor, Tensor]:
    """Steps 1 to 4 of section 3.1: the rings (N, 2, cells, 2) of N features, and (N,) whether they are not all gap.

    start: (N + 1,) int64, the first pair of each feature; angles: (3, P) of the pairs, as `relations` has them. `soft`
    as in `organise` and `smooth`.
    """
    found = angles.new_empty((len(start) - 1, 2, ring.cells, 2))
    valid = torch.empty(len(found), dtype=torch.bool)
    gap = torch.tensor(GAPS[gaps], dtype=angles.dtype)
    window = triangle(ring.cells, ring.half_length, angles.dtype)
    _rings(start.numpy(), angles.numpy(), ring.layers, soft, window, gap.numpy(), found.numpy(), valid.numpy())
    return found, valid


def rings_in_torch(start: Tensor, angles: Tensor, ring: Ring, gaps: str, soft: bool) -> tuple[Tensor, Tensor]:
    """`rings` by torch's operations, on any device."""
    grid = _organised(start, angles, ring, soft)
    reached = (grid[..., 0] > 0).any(2)
    values = grid if soft else grid * (1 / grid[..., :1].clamp(min=1))
    ahead, weight = triangle(ring.cells, ring.half_length, angles.dtype)
    sums = torch.zeros_like(values)
    for step in range(0, len(ahead), 4):
        a, b, c, d = (
            float(w) * values.roll(-int(k), dims=2)
            for k, w in zip(ahead[step : step + 4], weight[step : step + 4], strict=True)
        )
        sums = sums + ((a + b) + (c + d))
    gap = torch.tensor(GAPS[gaps], dtype=angles.dtype, device=angles.device)
    found = torch.where(sums[..., :1] > 0, (1 / sums[..., :1]) * sums[..., 1:], gap[:, None])
    found[:, 0, :, 1].clamp_(max=math.pi / 2)
    return found, reached.any(1)


def _organised(start: Tensor, angles: Tensor, ring: Ring, soft: bool) -> Tensor:
    """The grid (N, 2, cells, 3) that `organise` fills: neighbours of a cell are added up in their order."""
    N, cells = len(start) - 1, ring.cells
    feature = torch.arange(N, device=start.device).repeat_interleave(start.diff(), output_size=angles.shape[1])
    layer = (angles[1] > math.pi / 2 + SINGULAR).long()
    known = ((layer < ring.layers) & ~angles[2].isnan()).nonzero()[:, 0]
    (alpha1, alpha2, alpha3), row = angles[:, known], (2 * feature + layer)[known] * cells
    place = alpha3 * (cells / (2 * math.pi)) + (cells if soft else cells + 0.5)
    cell = place.long()
    nearness, cell = place - cell, cell % cells
    if soft:
        index = torch.stack([row + cell, row + (cell + 1) % cells], dim=1).flatten()
        weight = torch.stack([1 - nearness, nearness], dim=1).flatten()
        alpha1, alpha2 = alpha1.repeat_interleave(2), alpha2.repeat_interleave(2)
    else:
        index, weight = row + cell, torch.ones_like(place)
    order = index.argsort(stable=True)
    values = torch.stack([weight, weight * alpha1, weight * alpha2], dim=1)[order]
    counts = torch.bincount(index, minlength=2 * N * cells)
    return torch.segment_reduce(values, "sum", lengths=counts, axis=0, unsafe=True).view(N, 2, cells, 3)


@lru_cache
def triangle(cells: int, half_length: int, dtype: torch.dtype) -> tuple[np.ndarray, np.ndarray]:
    """The moving average's filter: how many cells ahead, going round, and what a cell counts there, by fours.

    At distance |k| <= n = half_length that is (n + 1 - |k|) / (n + 1): the paper gives no formula, but the bars of its
    Fig. 4 fall with the distance. Of two ways round the ring the shorter counts.
    """
    ahead = torch.arange(cells, device="cpu")
    weight = (half_length + 1 - torch.minimum(ahead, cells - ahead)).clamp(min=0).to(dtype) / (half_length + 1)
    ahead, weight = ahead[weight > 0], weight[weight > 0]
    missing = (0, -len(ahead) % 4)
    return pad(ahead, missing).numpy(), pad(weight, missing).numpy()


@compiled
def _rings(
    start: np.ndarray,
    angles: np.ndarray,
    layers: int,
    soft: bool,
    window: tuple[np.ndarray, np.ndarray],
    gap: np.ndarray,
    found: np.ndarray,
    valid: np.ndarray,
) -> None:
    grid = np.empty((2, found.shape[2], 3), found.dtype)
    for i in range(len(found)):
        grid[:] = 0
        organise(angles[:, start[i] : start[i + 1]], soft, grid[:layers])
        valid[i] = smooth(grid, window, gap, soft, found[i])


@compiled
def organise(angles: np.ndarray, soft: bool, grid: np.ndarray) -> None:
    """Add neighbours, angles (3, P), to the grid (layers, cells, 3): to their cell's number and sums of alpha1, alpha2.

    Those without alpha3 are left out, and those of a layer that the grid does not have. The layer is the top where
    alpha2 <= 90 deg. With `soft` a neighbour is shared between the two cells whose centres enclose its alpha3, in
    proportion to its nearness: sums then change smoothly as the frame turns.
    """
    layers, cells = grid.shape[:2]
    number = grid.dtype.type
    scale, first = number(cells / (2 * math.pi)), number(cells if soft else cells + 0.5)  # places are positive
    perpendicular = number(math.pi / 2 + SINGULAR)
    for pair in range(angles.shape[1]):
        layer = 1 if angles[1, pair] > perpendicular else 0
        if layer >= layers or math.isnan(angles[2, pair]):
            continue
        place = angles[2, pair] * scale + first
        cell = int(place)
        nearness = number(place - cell)
        cell -= cells if cell >= cells else 0
        if soft:
            _add(grid[layer, cell], number(1) - nearness, angles[0, pair], angles[1, pair])
            _add(grid[layer, cell + 1 if cell + 1 < cells else 0], nearness, angles[0, pair], angles[1, pair])
        else:
            _add(grid[layer, cell], number(1), angles[0, pair], angles[1, pair])


@compiled
def _add(cell: np.ndarray, weight: float, alpha1: float, alpha2: float) -> None:
    cell[0] += weight
    cell[1] += weight * alpha1
    cell[2] += weight * alpha2


@compiled
def smooth(
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
