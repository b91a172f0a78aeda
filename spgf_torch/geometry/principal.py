"""A frame that a point cloud brings with it."""

from __future__ import annotations

import numpy as np


def principal_axes(points: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) whose rows are the principal axes of points (N, 3), the widest first, right-handed.

    An axis points to the side on which the points reach farther, as the third moment tells. The axes turn with the
    points; of a cloud that looks the same along several of them any is as good as another.
    """
    offset = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(offset.T @ offset)
    widest, second, _ = axes.T[::-1]
    widest, second = (axis * np.copysign(1.0, ((offset @ axis) ** 3).sum()) for axis in (widest, second))
    return np.stack([widest, second, np.cross(widest, second)])
