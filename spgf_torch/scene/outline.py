"""Straight borders of a cloud: where the camera's image, a crop box or a mask cut it, so that what follows is unknown.

The outline of a lone thing is its silhouette; that of a scene is the frame it was seen through. A scene is known by
its size: an outline that runs straight for longer than what hands grasp, of a cloud that is wide across it too.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

# m; a straight outline at least so long, of a cloud at least so wide across it, is a frame: no hand holds such a thing.
LONG, WIDE = 0.3, 0.2
# m from the outline's line within which points lie on it, and the length of a piece of it that one point covers.
_ON, _PIECE = 0.004, 0.01
# Of the points so many tell the outline: more cost time. Hull edges shorter than this, m, tell no direction.
_POINTS, _SHORTEST = 200_000, 0.02
# Cosine: lines that run alike and are tried once.
_ALIKE = 0.998


def straight_borders(points: np.ndarray, eye: np.ndarray | None, along: np.ndarray) -> np.ndarray:
    """(L, 4) planes a, b, c, d through the straight parts of the outline; a x + b y + c z + d > 0 beyond, m.

    Args:
        points: (N, 3) m, all that was sensed. eye: (3,) m, from where; None: looked at from afar.
        along: (3,) the direction that it is looked at from then, any length.
    """
    if len(points) < 3:
        return np.zeros((0, 4))
    if len(points) > _POINTS:
        points = points[np.random.default_rng(0).choice(len(points), _POINTS, replace=False)]
    middle = np.median(points, axis=0)
    axis = along if eye is None else middle - eye
    if not np.linalg.norm(axis) > 0:
        return np.zeros((0, 4))
    axis = axis / np.linalg.norm(axis)
    side = np.eye(3)[np.abs(axis).argmin()]
    right = np.cross(axis, side) / np.linalg.norm(np.cross(axis, side))
    down = np.cross(axis, right)
    if eye is None:
        flat = (points - middle) @ np.stack([right, down], axis=1)
    else:
        ray = points - eye
        ahead = ray @ axis
        away = float(np.linalg.norm(middle - eye))
        ray, ahead = ray[ahead > 0.1 * away], ahead[ahead > 0.1 * away]
        flat = away * (ray @ np.stack([right, down], axis=1)) / ahead[:, None]
    planes = []
    for normal, offset in _lines(flat):
        outward = normal[0] * right + normal[1] * down
        if eye is None:
            planes.append([*outward, -float(outward @ middle) - offset])
        else:  # the plane of the eye and the line, which is `away` from it
            outward = outward - offset / away * axis
            outward /= np.linalg.norm(outward)
            planes.append([*outward, -float(outward @ eye)])
    return np.array(planes).reshape(-1, 4)


def _lines(flat: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Unit normals (2,), outwards, and offsets (m) of the long straight parts of the outline of points (N, 2)."""
    try:
        hull = ConvexHull(flat)
    except (QhullError, ValueError):
        return []
    corners = flat[hull.vertices]
    step = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(step, axis=1)
    found: list[tuple[np.ndarray, float]] = []
    for i in np.argsort(-length):
        if length[i] < _SHORTEST:
            break
        direction = step[i] / length[i]
        normal = np.array([direction[1], -direction[0]])  # qhull's corners run counterclockwise
        if any(normal @ other > _ALIKE for other, _ in found):
            continue
        offset = float(normal @ corners[i])
        depth = offset - flat @ normal
        pieces = np.unique(np.floor(flat[depth < _ON] @ direction / _PIECE))
        if len(pieces) * _PIECE >= LONG and depth.max() >= WIDE:
            found.append((normal, offset))
    return found
