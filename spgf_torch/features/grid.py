"""The sliced pineapple grid: neighbours in two rings of cells, smoothed, gaps encoded (paper, section 3.1.2).

Cell k of a ring is centred on alpha3 = k * 2 pi / N_g: it holds the neighbours with round(alpha3 / width) = k,
modulo N_g, so that turning the frame by whole cells moves the ring by whole cells. While they are made, rings
are (2, N, 2, N_g): angle (alpha1, alpha2, in radians), feature, layer (top, bottom), cell.
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
    """An accumulator (3, N, 2, cells): the number of neighbours, the sum of alpha1 and the sum of alpha2."""
    return like.new_zeros((3, N, 2, cells))


def layer_of(alpha2: Tensor) -> Tensor:
    """False where the neighbour belongs to the top layer, alpha2 <= 90 deg, and True where to the bottom."""
    return alpha2 > math.pi / 2 + SINGULAR


def organise(grid: Tensor, ring: Tensor, local: Tensor, alpha2: Tensor, soft: bool = False) -> None:
    """Add neighbours to the cells of their centre's rings, in place.

    ring: (P,) which ring of the grid's N * 2, centre * 2 + layer; local: (3, P) in the centre's frame; alpha2:
    (P,). With `soft` a neighbour is shared between the two cells whose centres enclose its alpha3, in proportion
    to its nearness: sums then change smoothly as the frame turns.
    """
    cells = grid.shape[3]
    known = (in_plane(local) > SINGULAR * local[2].abs()).to(grid.dtype)
    place = alpha3(local) * (cells / (2 * math.pi))
    angles = (alpha1(local), alpha2)
    if soft:
        lower = place.floor()
        share = place - lower
        _add(grid, ring, lower, known * (1 - share), angles)
        _add(grid, ring, lower + 1, known * share, angles)
    else:
        _add(grid, ring, (place + 0.5).floor(), known, angles)


def _add(grid: Tensor, ring: Tensor, cell: Tensor, weight: Tensor, angles: tuple[Tensor, Tensor]) -> None:
    cells = grid.shape[3]
    index = ring * cells + cell.remainder(cells).long()
    count, *sums = grid.view(3, -1)
    count.scatter_add_(0, index, weight)
    for total, angle in zip(sums, angles, strict=True):
        total.scatter_add_(0, index, weight * angle)


def cell_means(grid: Tensor) -> tuple[Tensor, Tensor]:
    """The mean (alpha1, alpha2) of each cell, (2, N, 2, cells), 0 where empty; and where it is filled."""
    filled = grid[0] > 0
    return grid[1:] / torch.where(filled, grid[0], 1), filled


def moving_average(sums: Tensor, weight: Tensor, half_length: int) -> tuple[Tensor, Tensor]:
    """Weighted moving average around each ring: fills the holes that sampling leaves.

    sums (2, N, 2, cells): the cells' values times their weight; weight (N, 2, cells): 0 where a cell is empty,
    so that it does not contribute, and 1 elsewhere. At distance |k| <= n = half_length a cell counts with
    (n + 1 - |k|) / (n + 1) of that (the paper: "weight falling with distance"). Returns the averages
    (2, N, 2, cells) and which cells something reached (N, 2, cells).
    """
    kernel = triangle(weight.shape[-1], half_length, sums)
    reached = weight @ kernel
    filled = reached > 0
    return (sums @ kernel) / torch.where(filled, reached, 1), filled


def triangle(cells: int, half_length: int, like: Tensor) -> Tensor:
    """The filter as a circulant matrix (cells, cells); of two ways round the ring the shorter counts."""
    k = torch.arange(cells, device=like.device)
    ahead = (k[:, None] - k) % cells
    distance = torch.minimum(ahead, (-ahead) % cells)
    return (half_length + 1 - distance).clamp(min=0).to(like.dtype) / (half_length + 1)


def encode_gaps(rings: Tensor, filled: Tensor, gaps: str = "saturated") -> Tensor:
    """The rings (2, N, 2, cells) with every cell that is still empty set to the value of a gap (`GAPS`).

    Neighbours that count as perpendicular (`SINGULAR`) do not raise a cell of the top layer above 90 deg, or
    rounding would decide between an edge and a gap.
    """
    value = torch.tensor(GAPS[gaps], dtype=rings.dtype, device=rings.device)  # layer, angle
    encoded = torch.where(filled, rings, value.T[:, None, :, None])
    encoded[1, :, 0].clamp_(max=math.pi / 2)
    return encoded
