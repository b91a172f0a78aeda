"""Where what was looked at ends, but the thing does not: borders of an image, a mask, a crop box. They are no edges.

A surface that a border cuts looks like a sheet with an edge, which hands love. Near the border of all that was looked
at nothing is gripped. Where a mask or a crop box ends, what follows was seen: there no hand may have the border between
its fingers, unless the border lies ahead of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from scipy.spatial import cKDTree
from torch import Tensor

if TYPE_CHECKING:
    from spgf_torch.proposing.closing_region import ClosingRegion

# m behind the TCP as far as fingers reach, and about it as far across as something counts as between the pads.
FINGERS, _ACROSS = 0.05, 0.015
# Cosine of the angle between the approach and the way over a border, from which on it lies ahead, unless it is
# behind the pads: within 60 deg.
_AHEAD = 0.5
# Pairs of a grasp and a point looked at together: bounds the memory.
_PAIRS = 1 << 20


@dataclass(frozen=True)
class Borders:
    """Texlets of which some are on borders.

    Attributes:
        points: (B, 3) f32, m, of those.
        beyond: (B, 3) f32, unit vectors along the surface over the border; 0: unseen beyond.
        others: (M, 3) f32, m, of the rest.
    """

    points: Tensor
    beyond: Tensor
    others: Tensor

    @staticmethod
    def of(positions: Tensor, beyond: Tensor | None) -> Borders | None:
        """Those of texlets (N, 3) with vectors (N, 3), NaN where there is no border; None of none."""
        if beyond is None or not bool((on := beyond.isfinite().all(1)).any()):
            return None
        return Borders(positions[on].float(), beyond[on].float(), positions[~on].float())

    def nearest(self, points: Tensor) -> Tensor:
        """(G,) bool: the texlet nearest to a point (G, 3) is one beyond which nothing was seen."""
        unknown = (self.beyond == 0).all(1)
        place = torch.cat([self.points[unknown], self.points[~unknown], self.others]).cpu().numpy()
        nearest = cKDTree(place).query(points.detach().cpu().numpy())[1]
        return torch.from_numpy(nearest < int(unknown.sum())).to(points.device)


def clear_of_borders(
    borders: Borders | None, T_object_tcp: Tensor, grasp_type: Tensor, regions: Sequence[ClosingRegion]
) -> Tensor:
    """(G,) bool: grasps (G, 4, 4) of types (G,) whose TCP and fingers are away from borders.

    Args:
        regions: what the fingers of each grasp type sweep.
    """
    if borders is None or not len(grasp_type):
        return torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
    clear = ~borders.nearest(T_object_tcp[:, :3, 3])
    points, beyond = borders.points.to(clear.device), borders.beyond.to(clear.device)
    for code, region in enumerate(regions):
        across, high = max(region.height, _ACROSS), max(region.high, _ACROSS)
        for part in (clear & (grasp_type == code)).nonzero()[:, 0].split(max(1, _PAIRS // len(points))):
            T = T_object_tcp[part].float()
            back = T[:, :3, :3].mT
            x, y, z = (back @ points.T - back @ T[:, :3, 3:]).unbind(1)
            between = ((x - region.middle).abs() < region.half) & (y.abs() < across) & (z > -FINGERS) & (z < high)
            ahead = (T[:, :3, 2] @ beyond.T > _AHEAD) & (z > region.low)
            clear[part] = ~(between & ~ahead).any(1)
    return clear
