"""All that was sensed, thinned by voxels, with its colours: for whoever shows a scene. Nothing is computed from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from spgf_torch.scene.cloud import Cloud, voxel_means
from spgf_torch.scene.planes import height
from spgf_torch.scene.target_selection import is_target

# Of points without a colour, where others have one.
_GREY = 150


@dataclass(frozen=True)
class Sensed:
    """Points, targets and all else.

    Attributes:
        points: (M, 3) float32, m, the input's frame. target: (M,) bool, whether it is of a target.
        colours: (M, 3) uint8, red, green, blue; None where the input has none.
    """

    points: np.ndarray
    target: np.ndarray
    colours: np.ndarray | None = None

    def colours_at(self, positions: np.ndarray) -> np.ndarray | None:
        """(N, 3) uint8 of the target's points nearest to positions (N, 3), m; None where no colour is known."""
        if self.colours is None or not self.target.any():
            return None
        return self.colours[self.target][cKDTree(self.points[self.target]).query(positions)[1]]


def sensed_of(
    clouds: Sequence[Cloud], table: np.ndarray | None, clearance: float, voxel: float | None = None
) -> Sensed:
    """What clouds show, in m.

    Args:
        table: (4,) a, b, c, d of the table; what is less than `clearance` (m) above it is no target.
        voxel: side of the cells that clouds are thinned by, m; None: they are thin.
    """
    clouds = [cloud if voxel is None else voxel_means(cloud, voxel) for cloud in clouds if len(cloud)]
    points = np.concatenate([np.zeros((0, 3)), *(cloud.points for cloud in clouds)])
    target = np.concatenate([np.zeros(0, bool), *(is_target(cloud) for cloud in clouds)])
    if table is not None:
        target &= height(points, table) > clearance
    colours = None
    if any(cloud.colours is not None for cloud in clouds):
        grey = [np.full((len(c), 3), _GREY, np.uint8) if c.colours is None else c.colours for c in clouds]
        colours = np.concatenate(grey)
    return Sensed(points.astype(np.float32), target, colours)
