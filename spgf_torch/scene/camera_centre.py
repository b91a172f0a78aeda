"""A camera's centre, found from its pixels: where their rays meet, or from where its points are a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from spgf_torch.scene.cloud import Cloud

# Points that are looked at.
_MOST = 3000
# Optical frames look along z (or -z, OpenGL's): nearly all points lie within 60 deg of it; within 45 deg of most.
WIDEST, USUAL, _IN_VIEW = np.tan(np.deg2rad(60)), 1.0, 0.99
# A camera's pixels are a grid: of its points as seen from its centre, nearly all have a neighbour as far as the others.
_GRID, _EVEN = 0.8, 0.05
# Rows and columns of an image meet their rays' origin to this share of the distance, if it is one camera's image.
_PINHOLE, _PIXELS = 0.01, 200
AS_ORIGIN = "taken for the origin, as in a camera's frame, which its points agree with"


@dataclass(frozen=True)
class Side:
    """Where a cloud was seen from: eye (3,), m, or, if guessed, a place far out on that side; a description."""

    eye: np.ndarray
    words: str
    guessed: bool = True


def of_grid(cloud: Cloud) -> Side | None:
    """The origin, where the points are a grid of pixels as seen from there."""
    if len(cloud) < _PIXELS or not optical(cloud.points, WIDEST):
        return None
    image = cloud.points[:, :2] / cloud.points[:, 2:]
    apart = cKDTree(image).query(image[: 4 * _MOST], 2)[0][:, 1]
    apart = apart[apart > 1e-9]  # points that were written twice
    if not len(apart):
        return None
    even = np.abs(apart / np.median(apart) - 1) < _EVEN
    return Side(np.zeros(3), AS_ORIGIN, guessed=False) if even.mean() >= _GRID else None


def of_pixels(cloud: Cloud) -> Side | None:
    """The camera's centre, where the points are an image: the projection from points to pixels, solved for.

    Hartley and Zisserman, Multiple View Geometry, sections 6.2 (centre = null vector of P) and 7.1 (DLT).
    """
    if cloud.pixels is None or len(cloud.pixels) < _PIXELS:
        return None
    chosen = np.linspace(0, len(cloud) - 1, min(len(cloud), _MOST)).astype(int)
    X, x = cloud.points[chosen], cloud.pixels[chosen][:, ::-1].astype(np.float64)
    middle, size = X.mean(axis=0), X.std() or 1.0
    flat = np.linalg.svd(X - middle, compute_uv=False)
    if flat[2] < 0.02 * flat[0]:  # points of a plane have many cameras
        return None
    homogeneous = np.column_stack([(X - middle) / size, np.ones(len(X))])
    x = (x - x.mean(axis=0)) / (x.std() or 1.0)
    zero = np.zeros_like(homogeneous)
    rows = np.concatenate(
        [
            np.hstack([homogeneous, zero, -x[:, :1] * homogeneous]),
            np.hstack([zero, homogeneous, -x[:, 1:] * homogeneous]),
        ]
    )
    P = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
    image = homogeneous @ P.T
    depth = image[:, 2]
    centre = np.linalg.svd(P)[2][-1]
    if abs(centre[3]) < 1e-9 or not ((depth > 0).all() or (depth < 0).all()):
        return None
    error = float(np.median(np.abs(image[:, :2] / depth[:, None] - x)))
    eye = middle + size * centre[:3] / centre[3]
    if error > _PINHOLE:
        return None
    return Side(eye, f"its pixels' rays meet at ({', '.join(f'{v:.3f}' for v in eye)}) m", guessed=False)


def optical(points: np.ndarray, widest: float) -> bool:
    """Whether the points lie as a camera at the origin sees them: before it along z, or along -z.

    Args:
        widest: tangent of the angle that they may be off it.
    """
    z = np.abs(points[:, 2])
    ahead = (np.abs(points[:, :2]).max(axis=1) <= widest * z) & (z > 0)
    share = max(float((ahead & (points[:, 2] > 0)).mean()), float((ahead & (points[:, 2] < 0)).mean()))
    return share >= _IN_VIEW
