"""Two directions along a surface, for patches that are drawn in it."""

from __future__ import annotations

import numpy as np


def tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors u, v (N, 3) at right angles to unit normals (N, 3) and to each other; u x v is the normal."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    u = np.cross(helper, normals)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(normals, u)
