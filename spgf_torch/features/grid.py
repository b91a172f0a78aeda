"""The sliced pineapple grid: neighbours in two rings of cells, smoothed, gaps encoded (paper, section 3.1.2).

Cell k of a ring is centred on alpha3 = k * 2 pi / N_g: it holds the neighbours with round(alpha3 / width) = k,
modulo N_g, so that turning the frame by whole cells moves the ring by whole cells. While they are made, rings
are (2, N, 2, N_g): angle (alpha1, alpha2, in radians), feature, layer (top, bottom), cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Shares:
    """What neighbours add to cells: index (P,) int64, centre * 2 cells + layer * cells + cell; and to their sums,
    weight, weight * alpha1, weight * alpha2 (P,)."""

    index: Tensor
    values: tuple[Tensor, Tensor, Tensor]

    def add_to(self, grid: Tensor) -> None:
        """Add them to a grid (3, N, 2, cells), in place and in order: the sums are the same in every run."""
        for sums, values in zip(grid.view(3, -1), self.values, strict=True):
            sums.scatter_add_(0, self.index, values)


def shares(cells: int, ring: Tensor, local: Tensor, alpha2: Tensor, soft: bool = False) -> list[Shares]:
    """What P neighbours add to the rings of their centres.

    ring: (P,) which ring of the grid's N * 2, centre * 2 + layer; local: (3, P) in the centre's frame; alpha2:
    (P,). With `soft` a neighbour is shared between the two cells whose centres enclose its alpha3, in proportion
    to its nearness: sums then change smoothly as the frame turns.
    """
    flat = in_plane(local)
    known = (SINGULAR * local[2].abs()).lt_(flat)  # 1 or 0: a comparison in place spares a slow change of type
    place = alpha3(local).mul_(cells / (2 * math.pi))
    elevation = alpha1(local, flat)

    def share(cell: Tensor, weight: Tensor) -> Shares:
        turns = (cell / cells).floor_()  # `remainder` takes four times as long
        index = cell.sub(turns, alpha=cells).long().add_(ring, alpha=cells)
        return Shares(index, (weight, weight * elevation, weight * alpha2))

    if not soft:
        return [share(place.add_(0.5).floor_(), known)]
    lower = place.floor()
    nearness = place - lower
    return [share(lower, known * (1 - nearness)), share(lower + 1, known * nearness)]


def cell_means(grid: Tensor) -> tuple[Tensor, Tensor]:
    """The mean (alpha1, alpha2) of each cell, (2, N, 2, cells), 0 where empty; and where it is filled."""
    filled = grid[0] > 0
    return grid[1:] / grid[0].clamp(min=1), filled


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
    nothing = reached.clone().eq_(0)  # 1 or 0
    return (sums @ kernel).div_(reached.add_(nothing)), filled


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
