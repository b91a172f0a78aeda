"""Space around a target that no camera saw free, as points that a hand must not reach into.

What lies a little behind a surface is the thing itself, which the sensed points stand for; from `unseen_from` on it may
be anything, such as a neighbour that it hides. Far behind a surface there is rather nothing (`unseen_depth`): with one
view, taking all of it for solid leaves no way to most things.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from spgf_torch.proposing.clearance import Plane
from spgf_torch.proposing.config import NeighboursConfig
from spgf_torch.sensing.unseen import DepthView, behind_at


def hidden_places(points: Tensor, views: Sequence[DepthView], table: Plane | None, config: NeighboursConfig) -> Tensor:
    """(K, 3) f32, m: middles of the outer cells of the space about sensed points (N, 3) that no view saw free.

    None without points, views or `unseen_depth`. Places that no image shows are none: nothing is known of them. Outer
    are cells beside one that was seen free or of which nothing is said: a hand is larger than what lies within, so it
    passes through them.
    """
    if not len(points) or not views or not config.unseen_depth:
        return torch.zeros(0, 3)
    low, high = points.amin(0) - config.unseen_depth, points.amax(0) + config.unseen_depth
    axes = [torch.arange(float(a), float(b), config.unseen_cell) for a, b in zip(low, high, strict=True)]
    cells = torch.cartesian_prod(*axes) + config.unseen_cell / 2
    above = torch.ones(len(cells), dtype=torch.bool)
    if table is not None:
        above = cells @ table.normal > table.offset + config.unseen_from
    behind = torch.zeros(len(cells))
    behind[above] = behind_at(torch.eye(4)[None], cells[above], views, 0.0)[0]
    deep = behind <= config.unseen_depth
    hidden = above & (behind > config.unseen_from) & deep
    solid = ~above | ((behind > 0) & deep)
    return cells[hidden & ~_within(solid.view([len(axis) for axis in axes])).flatten()].contiguous()


def _within(solid: Tensor) -> Tensor:
    """Which cells of a grid (X, Y, Z) have solid ones on all six sides; none at its border."""
    within = torch.zeros_like(solid)
    inner = within[1:-1, 1:-1, 1:-1]
    inner.fill_(True)
    for axis in range(3):
        for first in (0, 2):
            beside = [slice(1, -1)] * 3
            beside[axis] = slice(first, first + solid.shape[axis] - 2)
            inner &= solid[tuple(beside)]
    return within
