"""The depth image that a cloud's points make at the place they were seen from: what they hide is unseen.

A cloud does not say in which directions nothing returned. As in an image without return, what has no point is taken for
seen through: clouds are cut to what matters, and what stood before it would have hidden it. Beyond the straight borders
of a cloud nothing is known; there all counts as unseen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from scipy.ndimage import binary_closing
from scipy.spatial import cKDTree

from spgf_torch.sensing.cameras import Camera
from spgf_torch.sensing.unseen import DepthView, behind

# Side of a pixel in distances to the fourth neighbour, which of a grid is one step: no pixel of it is empty.
_PIXEL, _NEIGHBOURS = 1.25, 4
# Pixels on a side, and points that the spacing is taken from.
_MOST, _SOME = 1200, 4000
# m about the target as far as a hand reaches; beyond it the image ends.
_MARGIN = 0.35
# m from the target's middle, nearer than which no depth camera sees.
_NEAREST = 0.05
# Tangent of the half angle of the image at most: a pinhole sees no half space.
_WIDEST = 3.0
# m in depth within which the points of a pixel are one surface, whose mean depth it gets.
_GATE = 0.012
# Points so many m behind what the views show were seen from elsewhere; of one view's no more than this share.
_HIDDEN, _FEW = 0.03, 0.1
# Side, in pixels, of the holes that are closed.
_CLOSED = 3


def view_of_points(points: np.ndarray, eye: np.ndarray, target: np.ndarray, planes: np.ndarray) -> DepthView | None:
    """The depth image of points (N, 3) at the eye (3,), m, around a target (M, 3); None where it cannot be one.

    Args:
        planes: (L, 4) through straight borders of the cloud and the eye; a x + b y + c z + d > 0 beyond.
    """
    middle = (target.min(axis=0) + target.max(axis=0)) / 2
    ahead = middle - eye
    away = float(np.linalg.norm(ahead))
    if away < _NEAREST:
        return None
    T = np.eye(4)
    side = np.eye(3)[np.abs(ahead).argmin()]
    right = np.cross(ahead, side) / np.linalg.norm(np.cross(ahead, side))
    T[:3, :3] = np.stack([right, np.cross(ahead / away, right), ahead / away], axis=1)
    T[:3, 3] = eye
    local = (points - eye) @ T[:3, :3]
    reach = (np.linalg.norm(target - middle, axis=1).max() + _MARGIN) / away
    reach = min(reach, _WIDEST)
    local = local[(local[:, 2] > 1e-3) & (np.abs(local[:, :2]) < reach * local[:, 2:]).all(axis=1)]
    if len(local) <= _NEIGHBOURS:
        return None
    camera = _camera(local, reach, T)
    depth = _depths(local, camera)
    view = DepthView.of(depth, camera)
    unknown = torch.from_numpy(_beyond(camera, planes)) & view.depth.isinf()
    return DepthView(view.depth.masked_fill(unknown, 0.0), view.K, view.rotation, view.eye)


def seen_by(points: np.ndarray, views: Sequence[DepthView]) -> bool:
    """Whether the views together show next to all points (N, 3), m, as they do that were seen from there."""
    depth = behind(torch.from_numpy(np.ascontiguousarray(points)), views)
    return float(((depth > _HIDDEN) & depth.isfinite()).float().mean()) <= _FEW


def _camera(local: np.ndarray, reach: float, T: np.ndarray) -> Camera:
    """The camera whose pixels are as large as the points (N, 3), in its frame, are apart as it sees them."""
    flat = local[:, :2] / local[:, 2:]
    some = flat[np.random.default_rng(0).choice(len(flat), min(len(flat), _SOME), replace=False)]
    apart = cKDTree(flat).query(some, _NEIGHBOURS + 1)[0][:, -1]
    pitch = max(_PIXEL * float(np.median(apart)), 2 * reach / _MOST)
    half = int(np.ceil(reach / pitch))
    K = np.array([[1 / pitch, 0, half], [0, 1 / pitch, half], [0, 0, 1.0]])
    return Camera(K, T, 2 * half + 1, 2 * half + 1)


def _depths(local: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W) m: of each pixel the mean depth of its nearest points (N, 3), small holes closed; 0 elsewhere."""
    column, row = np.rint(local[:, :2] / local[:, 2:] * camera.K[0, 0] + camera.K[0, 2]).astype(int).T
    pixel, z = row * camera.width + column, local[:, 2]
    nearest = np.full(camera.width * camera.height, np.inf)
    np.minimum.at(nearest, pixel, z)
    front = z <= nearest[pixel] + _GATE
    count = np.bincount(pixel[front], minlength=len(nearest))
    total = np.bincount(pixel[front], weights=z[front], minlength=len(nearest))
    depth = np.where(count > 0, total / np.maximum(count, 1), 0.0).reshape(camera.height, camera.width)
    closed = binary_closing(depth > 0, np.ones((_CLOSED, _CLOSED), bool)) & (depth == 0)
    return np.where(closed, _around(depth), depth)


def _around(depth: np.ndarray) -> np.ndarray:
    """(H, W) the mean of the nearest of what is in the 3 x 3 pixels around each; 0 where there is nothing."""
    padded = np.pad(depth, 1)
    height, width = depth.shape
    windows = np.stack([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)])
    windows[windows == 0] = np.inf
    near = windows <= windows.min(axis=0) + _GATE
    near &= np.isfinite(windows)
    return np.where(near, windows, 0.0).sum(axis=0) / np.maximum(near.sum(axis=0), 1)


def _beyond(camera: Camera, planes: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels whose ray lies beyond one of the planes through the eye."""
    rays = camera.rays() @ camera.T_object_camera[:3, :3].T
    return (rays @ planes[:, :3].T > 0).any(axis=2) if len(planes) else np.zeros(rays.shape[:2], bool)
