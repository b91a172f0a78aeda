"""The sliced pineapple grid: neighbours in two rings of cells, smoothed, gaps encoded (paper, section 3.1.2).

Cell k of a ring is centred on alpha3 = k * 2 pi / N_g: it holds the neighbours with round(alpha3 / width) = k,
modulo N_g, so that turning the frame by whole cells moves the ring by whole cells. In this module rings are
(N, layer, angle, cell): the layers are top and bottom, the angles alpha1 and alpha2 in radians.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from spgf_torch.features.relations import alpha1, alpha3, in_plane

# rad; a normal this close to perpendicular counts as perpendicular (top layer, alpha2 = pi/2), and a neighbour
# this close to the centre's normal has no alpha3: both would otherwise be decided by rounding (FEATURES.md).
SINGULAR = 1e-3

# What a gap is encoded as: (alpha1, alpha2) of the top and of the bottom layer.
GAPS = {
    "saturated": ((math.pi / 2, math.pi / 2), (math.pi / 2, math.pi)),  # the paper's
    "flat": ((0.0, 0.0), (0.0, math.pi)),  # a plane, and the far side of a flat wall
}


def empty_grid(N: int, cells: int, like: Tensor) -> Tensor:
    """An accumulator (N, 2, 3, cells): the number of neighbours, the sum of alpha1 and the sum of alpha2."""
    return like.new_zeros((N, 2, 3, cells))


def organise(grid: Tensor, centre: Tensor, local: Tensor, alpha2: Tensor, soft: bool = False) -> None:
    """Add neighbours to their centre's layer and cell, in place.

    centre: (P,) rows of the grid; local: (3, P) in the centre's frame; alpha2: (P,). The neighbour belongs to
    the top layer where alpha2 <= 90 deg, else to the bottom. With `soft` it is shared between the two cells
    whose centres enclose its alpha3, in proportion to its nearness: sums then change smoothly as the frame turns.
    """
    cells = grid.shape[3]
    bottom = alpha2 > math.pi / 2 + SINGULAR
    angles = (alpha1(local), alpha2)
    known = (in_plane(local) > SINGULAR * local[2].abs()).to(grid.dtype)
    place = alpha3(local) * (cells / (2 * math.pi))
    row = (centre * 2 + bottom) * 3
    if soft:
        lower = place.floor()
        share = place - lower
        _add(grid, row, lower, known * (1 - share), angles)
        _add(grid, row, lower + 1, known * share, angles)
    else:
        _add(grid, row, (place + 0.5).floor(), known, angles)


def _add(grid: Tensor, row: Tensor, cell: Tensor, weight: Tensor, angles: tuple[Tensor, Tensor]) -> None:
    cells = grid.shape[3]
    index = row * cells + cell.remainder(cells).long()
    flat = grid.view(-1)
    flat.scatter_add_(0, index, weight)
    for step, angle in enumerate(angles, start=1):
        flat.scatter_add_(0, index + step * cells, weight * angle)


def cell_means(grid: Tensor) -> tuple[Tensor, Tensor]:
    """The mean (alpha1, alpha2) of each cell, (N, 2, 2, cells), 0 where empty; and its count, (N, 2, cells)."""
    count = grid[:, :, 0]
    means = grid[:, :, 1:] / torch.where(count > 0, count, 1)[:, :, None]
    means[:, 0, 1].clamp_(max=math.pi / 2)  # what counts as perpendicular is not above it, nor above a gap
    return means, count


def moving_average(means: Tensor, weight: Tensor, half_length: int) -> tuple[Tensor, Tensor]:
    """Weighted moving average around each ring: fills the holes that sampling leaves.

    Cell k counts with (n + 1 - |k|) / (n + 1) at distance |k| <= n = half_length (the paper: "weight falling
    with distance"), times its own weight (N, 2, cells): 0 where it is empty, so that it does not contribute.
    Returns the averages (N, 2, 2, cells) and which cells something reached (N, 2, cells).
    """
    kernel = triangle(means.shape[-1], half_length, means)
    reached = weight @ kernel
    filled = reached > 0
    return (means * weight[:, :, None]) @ kernel / torch.where(filled, reached, 1)[:, :, None], filled


def triangle(cells: int, half_length: int, like: Tensor) -> Tensor:
    """The filter as a circulant matrix (cells, cells); of two ways round the ring the shorter counts."""
    k = torch.arange(cells, device=like.device)
    ahead = (k[:, None] - k) % cells
    distance = torch.minimum(ahead, (-ahead) % cells)
    return ((half_length + 1 - distance).clamp(min=0) / (half_length + 1)).to(like.dtype)


def encode_gaps(rings: Tensor, filled: Tensor, gaps: str = "saturated") -> Tensor:
    """The rings (N, 2, 2, cells) with every cell that is still empty set to the value of a gap (`GAPS`)."""
    value = torch.tensor(GAPS[gaps], dtype=rings.dtype, device=rings.device)
    return torch.where(filled[:, :, None], rings, value[:, :, None])
