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
    """(K, 3) f32, m: middles of the cells about the sensed points (N, 3), above a table, that no view saw free.

    None without points, views or `unseen_depth`. Places that no image shows are none: nothing is known of them.
    """
    if not len(points) or not views or not config.unseen_depth:
        return torch.zeros(0, 3)
    low, high = points.amin(0) - config.unseen_depth, points.amax(0) + config.unseen_depth
    axes = [torch.arange(float(a), float(b), config.unseen_cell) for a, b in zip(low, high, strict=True)]
    cells = torch.cartesian_prod(*axes) + config.unseen_cell / 2
    if table is not None:
        cells = cells[cells @ table.normal > table.offset + config.unseen_from]
    behind = behind_at(torch.eye(4)[None], cells, views, config.unseen_from)[0]
    return cells[(behind > config.unseen_from) & (behind <= config.unseen_depth)].contiguous()
