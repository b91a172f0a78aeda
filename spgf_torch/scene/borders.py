"""Which texlets lie where a border of the image, of a mask, of a crop box or of the cloud cuts what was looked at.

Three signs: the borders of all images are near; a straight outline of the whole cloud is near; or the surface was seen
to go on, in something that is no target, without a step in depth. In the first two nobody knows what follows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from scipy.spatial import cKDTree

from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView

# A surface goes on where it leaves its plane by no more than this share of the distance and so many m: of a ball of
# 4 cm 12 mm further on 1.8 mm, and the noise of a depth camera.
_SLOPE, _NOISE = 0.15, 0.003
# m from the nearest texlet of a target, between which what goes on is looked for: masks are some pixels too small.
_FIRST, _LAST = 0.008, 0.015
# Points of it that are no chance, and the share of the way to one at which the surface must have been seen too.
_SOME, _BETWEEN = 3, 0.4
# Texlet spacings to a straight outline within which texlets tell whether it is a true edge: so it is where more than
# this share faces over it, by this cosine.
_NEAR, _FACES, _EDGE = 2.0, 0.7, 0.33


def cut_borders(
    texlets: Texlets, others: np.ndarray, views: Sequence[DepthView], planes: np.ndarray, spacing: float, reach: float
) -> torch.Tensor:
    """(N, 3) f32 of each texlet the unit vector along its surface over the border that cuts it; NaN: there is none.

    A zero vector: a border is near beyond which nobody has looked.

    Args:
        others: (M, 3) m, sensed points that are of no target or of others. views: () where there are no images.
        planes: (L, 4) of `outline.straight_borders`. spacing: m between texlets.
        reach: m to a border beyond which nobody has looked, from where on it is near.
    """
    positions, normals = (t.double().numpy() for t in (texlets.positions, texlets.normals))
    beyond = np.full((len(positions), 3), np.nan)
    if len(positions):
        goes_on, direction = _into_others(positions, normals, others)
        beyond[goes_on] = direction[goes_on]
        beyond[_near_images_end(positions, views, reach)] = 0.0
        beyond[_near_planes(positions, normals, planes, _NEAR * spacing, reach)] = 0.0
    return torch.from_numpy(beyond).float()


def _near_images_end(positions: np.ndarray, views: Sequence[DepthView], reach: float) -> np.ndarray:
    """(N,) bool: less than `reach` (m, across the line of sight) from the border of every image, or in none."""
    inside = np.full(len(positions), np.inf if not views else -np.inf)
    for view in views:
        K, rotation, eye = (part.double().numpy() for part in (view.K, view.rotation, view.eye))
        local = (positions - eye) @ rotation
        z = np.maximum(local[:, 2], 1e-6)
        u, v = (local @ K.T)[:, :2].T / z
        height, width = view.depth.shape
        across = np.minimum(u + 0.5, width - 0.5 - u) / K[0, 0], np.minimum(v + 0.5, height - 0.5 - v) / K[1, 1]
        inside = np.maximum(inside, np.where(local[:, 2] > 0, np.minimum(*across) * z, -np.inf))
    return inside < reach


def _near_planes(
    positions: np.ndarray, normals: np.ndarray, planes: np.ndarray, near: float, reach: float
) -> np.ndarray:
    """(N,) bool: less than `reach` (m) from a plane through a straight outline that is no true edge."""
    found = np.zeros(len(positions), bool)
    for plane in planes:
        inside = -(positions @ plane[:3] + plane[3])
        at = inside < near
        if at.any() and (normals[at] @ plane[:3] > _FACES).mean() <= _EDGE:
            found |= inside < reach
    return found


def _into_others(positions: np.ndarray, normals: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which texlets' (N,) surface goes on in other sensed points (M, 3), and in which directions (N, 3)."""
    found, direction = np.zeros(len(positions), bool), np.zeros_like(positions)
    low, high = positions.min(axis=0) - _LAST, positions.max(axis=0) + _LAST
    others = others[((others >= low) & (others <= high)).all(axis=1)]
    if not len(others):
        return found, direction
    away, nearest = cKDTree(positions).query(others, distance_upper_bound=_LAST)
    far = np.flatnonzero((away >= _FIRST) & np.isfinite(away))
    home = nearest[far]
    step = others[far] - positions[home]
    off = (step * normals[home]).sum(axis=1)
    # Where nothing of the surface lies between, it is another thing, however flush.
    joined = cKDTree(others).query(positions[home] + _BETWEEN * step, distance_upper_bound=_FIRST / 2)[0]
    on = (np.abs(off) <= _SLOPE * away[far] + _NOISE) & np.isfinite(joined)
    found = np.bincount(home[on], minlength=len(positions)) >= _SOME
    np.add.at(direction, home[on], step[on] - off[on, None] * normals[home[on]])
    return found, direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
