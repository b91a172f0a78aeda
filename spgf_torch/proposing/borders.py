"""Where what was looked at ends, but the thing does not: borders of an image, a mask, a crop box. They are no edges.

A surface that a border cuts looks like a sheet with an edge, which hands love. Such texlets carry the direction in
which the surface goes on (`scene.borders`), and no hand may have one between its fingers, unless the border lies ahead
of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from spgf_torch.proposing.hand_geometry import ClosingRegion

# m behind the TCP as far as fingers reach: a border between them is passed on the way.
FINGERS = 0.05
# Cosine of the angle between the approach and the way over a border, from which on it lies ahead: within 60 deg.
_AHEAD = 0.5
# Pairs of a grasp and a point looked at together: bounds the memory.
_PAIRS = 1 << 21


@dataclass(frozen=True)
class Borders:
    """Texlets on cut borders.

    Attributes:
        points: (B, 3) f32, m.
        beyond: (B, 3) f32, unit vectors along the surface over the border; 0: it is cut in all directions.
    """

    points: Tensor
    beyond: Tensor

    @staticmethod
    def of(positions: Tensor, beyond: Tensor | None) -> Borders | None:
        """Those of texlets (N, 3) with vectors (N, 3), NaN where there is no border; None of none."""
        if beyond is None or not len(on := beyond.isfinite().all(1).nonzero()[:, 0]):
            return None
        return Borders(positions[on].float(), beyond[on].float())


def clear_of_borders(
    borders: Borders | None, T_object_tcp: Tensor, grasp_type: Tensor, regions: Sequence[ClosingRegion]
) -> Tensor:
    """(G,) bool: no cut border lies between the fingers at grasps (G, 4, 4) of types (G,), but ahead of them.

    Args:
        regions: what the pads of each grasp type sweep.
    """
    clear = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
    if borders is None:
        return clear
    points, beyond = borders.points.to(clear.device), borders.beyond.to(clear.device)
    for code, region in enumerate(regions):
        for part in (grasp_type == code).nonzero()[:, 0].split(max(1, _PAIRS // len(points))):
            T = T_object_tcp[part].float()
            back = T[:, :3, :3].mT
            x, y, z = (back @ points.T - back @ T[:, :3, 3:]).unbind(1)
            between = (x.abs() < region.half) & (y.abs() < region.height) & (z > -FINGERS) & (z < region.high)
            ahead = T[:, :3, 2] @ beyond.T > _AHEAD
            clear[part] = ~(between & ~ahead).any(1)
    return clear
