"""The sliced pineapple grid: neighbours in two rings of cells around the normal (paper, section 3.1.2).

A part of the operator `describe`.

Cell k of a ring is centred on alpha3 = k * 2 pi / N_g: it holds the neighbours with round(alpha3 / width) = k,
modulo N_g, so that turning the frame by whole cells moves the ring by whole cells. Rings are (N, 2, N_g, 2):
feature, layer (top, bottom), cell, angle (alpha1, alpha2, in radians).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import lean
from spgf_torch.ops.moving_average import averaged, averaged_in_torch
from spgf_torch.ops.pairwise_relations import SINGULAR


class Ring(NamedTuple):
    """Of a grid: cells around each ring, cells that the moving average reaches to each side, and layers (1 or 2)."""

    cells: int
    half_length: int
    layers: int


def rings(
    start: np.ndarray, angles: np.ndarray, ring: Ring, gaps: str, soft: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Steps 1 to 4 of section 3.1: the rings (N, 2, cells, 2) of N features, and (N,) whether they are not all gap.

    start: (N + 1,) int64, the first pair of each feature; angles: (3, P) of the pairs, as `relations` has them. `soft`
    as in `organised` and `averaged`.
    """
    return averaged(organised(start, angles, ring, soft), ring.half_length, gaps, soft)


def rings_in_torch(start: Tensor, angles: Tensor, ring: Ring, gaps: str, soft: bool) -> tuple[Tensor, Tensor]:
    """`rings` by torch's operations, on any device."""
    return averaged_in_torch(organised_in_torch(start, angles, ring, soft), ring.half_length, gaps, soft)


def organised(start: np.ndarray, angles: np.ndarray, ring: Ring, soft: bool = False) -> np.ndarray:
    """The grids (N, 2, 3, cells): how many neighbours a cell has, and the sums of their alpha1 and alpha2.

    Those without alpha3 are left out, and those of a layer beyond `ring.layers`. The layer is the top where alpha2
    <= 90 deg. With `soft` a neighbour is shared between the two cells whose centres enclose its alpha3, in proportion
    to its nearness: sums then change smoothly as the frame turns.
    """
    grid = np.zeros((len(start) - 1, 2, 3, ring.cells), angles.dtype)
    _organise(start, angles, ring.layers, soft, grid)
    return grid


def organised_in_torch(start: Tensor, angles: Tensor, ring: Ring, soft: bool) -> Tensor:
    """`organised` by torch's operations: neighbours of a cell are added up in their order."""
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
    return torch.segment_reduce(values, "sum", lengths=counts, axis=0, unsafe=True).view(N, 2, cells, 3).mT


@lean
def _organise(start: np.ndarray, angles: np.ndarray, layers: int, soft: bool, grid: np.ndarray) -> None:
    """In and out: grid (N, 2, 3, cells), to which the neighbours are added."""
    cells, number = grid.shape[3], grid.dtype.type
    scale, first = number(cells / (2 * math.pi)), number(cells if soft else cells + 0.5)  # places are positive
    perpendicular = number(math.pi / 2 + SINGULAR)
    for i in range(len(grid)):
        for pair in range(start[i], start[i + 1]):
            layer = 1 if angles[1, pair] > perpendicular else 0
            if layer >= layers or math.isnan(angles[2, pair]):
                continue
            place = angles[2, pair] * scale + first
            cell = int(place)
            nearness = number(place - cell)
            cell -= cells if cell >= cells else 0
            if soft:
                _add(grid[i, layer], cell, number(1) - nearness, angles[0, pair], angles[1, pair])
                _add(grid[i, layer], cell + 1 if cell + 1 < cells else 0, nearness, angles[0, pair], angles[1, pair])
            else:
                _add(grid[i, layer], cell, number(1), angles[0, pair], angles[1, pair])


@lean
def _add(layer: np.ndarray, cell: int, weight: float, alpha1: float, alpha2: float) -> None:
    layer[0, cell] += weight
    layer[1, cell] += weight * alpha1
    layer[2, cell] += weight * alpha2
