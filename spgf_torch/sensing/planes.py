"""A plane through the neighbourhood of every pixel of a depth image: oriented surface points."""

from __future__ import annotations

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.sensing.config import SensingConfig

# Upper triangle of a symmetric 3x3 matrix: xx, xy, xz, yy, yz, zz.
_ROW, _COLUMN = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])


def surface_points(depth: np.ndarray, rays: np.ndarray, config: SensingConfig) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of the surface that a depth image shows, camera frame.

    Each pixel's normal is the direction of least variance (PCA) of the points in the window around it whose depth is
    within `config.depth_gate` of its own; its point slides along its ray onto the plane through their mean. Dropped:
    pixels with fewer than `config.min_window` such points, planes seen at more than `config.grazing_deg`, and points
    that would slide further than the gate.

    Args:
        depth: (H, W) m; 0, negative or not finite = no return.
        rays: (H, W, 3), z = 1.
        config: window, depth_gate, min_window, grazing_deg.

    Returns:
        points (M, 3) m and unit normals (M, 3) towards the camera, float64.

    Raises:
        InputError: the window has no middle pixel.
    """
    if config.window % 2 == 0:
        raise InputError(f"window: expected an odd number of pixels, got {config.window}")
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, 0.0)
    count, mean, covariance = _moments(depth, rays, config.window // 2, config.depth_gate)
    enough = count >= config.min_window
    mean, ray, z = mean[enough], rays[depth > 0][enough], depth[depth > 0][enough]
    normal = smallest_eigenvectors(covariance[:, enough])
    towards = (normal * ray).sum(axis=1)
    normal *= -np.sign(towards)[:, None]
    facing = np.abs(towards) / np.linalg.norm(ray, axis=1)
    on_plane = (normal * mean).sum(axis=1) / np.where(towards == 0, -1.0, -np.abs(towards))
    steady = (facing > np.cos(np.deg2rad(config.grazing_deg))) & (np.abs(on_plane - z) <= config.depth_gate)
    return ray[steady] * on_plane[steady, None], normal[steady]


def smallest_eigenvectors(matrices: np.ndarray) -> np.ndarray:
    """(M, 3) unit eigenvectors of the smallest eigenvalue of M symmetric matrices (6, M): xx, xy, xz, yy, yz, zz.

    Closed form, about 5 times as fast as numpy's batched eigh: eigenvalues by the trigonometric solution (Smith 1961),
    the vector as the longest cross product of two rows of A - lambda I. Where the smallest eigenvalue is not simple
    the direction is arbitrary but finite.
    """
    xx, xy, xz, yy, yz, zz = matrices / np.maximum(np.abs(matrices).max(axis=0), 1e-300)
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = np.sqrt(np.maximum((a * a + b * b + c * c) / 6 + (xy * xy + xz * xz + yz * yz) / 3, 1e-30))
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    third = np.arccos(np.clip(determinant / (2 * spread**3), -1.0, 1.0)) / 3
    smallest = 2 * spread * np.cos(third + 2 * np.pi / 3)
    a, b, c = a - smallest, b - smallest, c - smallest
    rows = np.stack([np.stack([a, xy, xz]), np.stack([xy, b, yz]), np.stack([xz, yz, c])])
    crosses = np.stack([_cross(rows[i], rows[j]) for i, j in ((0, 1), (0, 2), (1, 2))])
    lengths = (crosses**2).sum(axis=1)
    best = lengths.argmax(axis=0)
    longest = np.take_along_axis(crosses, best[None, None], axis=0)[0]
    length = np.sqrt(np.take_along_axis(lengths, best[None], axis=0)[0])
    fallback = np.array([[0.0], [0.0], [1.0]])
    return np.where(length > 1e-14, longest / np.maximum(length, 1e-14), fallback).T


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _moments(depth: np.ndarray, rays: np.ndarray, half: int, gate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number (M,), mean (M, 3) and covariance (6, M) of the gated points around each of the M pixels with a return."""
    padded = np.pad(depth, half)
    points = np.pad(rays * depth[..., None], ((half, half), (half, half), (0, 0))).reshape(-1, 3).T
    flat, width = padded.ravel(), padded.shape[1]
    at = np.flatnonzero(flat)
    z, centre = flat[at], points[:, at]
    count, first, second = np.zeros(len(at)), np.zeros((3, len(at))), np.zeros((6, len(at)))
    for down in range(-half, half + 1):
        for right in range(-half, half + 1):
            other = at + down * width + right
            near = (np.abs(flat[other] - z) <= gate) & (flat[other] > 0)
            offset = np.where(near, points[:, other] - centre, 0.0)
            count += near
            first += offset
            second += offset[_ROW] * offset[_COLUMN]
    mean = first / count
    return count, (centre + mean).T, second / count - mean[_ROW] * mean[_COLUMN]
