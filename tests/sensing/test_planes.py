"""Normals of pixel windows against a slow loop, and on planes."""

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.planes import smallest_eigenvectors, surface_points
from spgf_torch.settings import settings


def rays(height: int, width: int, focal: float = 288.0) -> np.ndarray:
    u, v = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    return np.stack([u / focal, v / focal, np.ones_like(u)], axis=-1)


def plane_depth(normal: np.ndarray, offset: float, ray: np.ndarray) -> np.ndarray:
    """(H, W) depth of the plane normal . p = offset."""
    return offset / (ray @ normal)


def slow_points(depth: np.ndarray, ray: np.ndarray, config: SensingConfig) -> tuple[np.ndarray, np.ndarray]:
    """surface_points, pixel by pixel."""
    half, points, normals = config.window // 2, [], []
    for v, u in np.ndindex(depth.shape):
        if depth[v, u] <= 0:
            continue
        window = [
            depth[y, x] * ray[y, x]
            for y in range(max(v - half, 0), min(v + half + 1, depth.shape[0]))
            for x in range(max(u - half, 0), min(u + half + 1, depth.shape[1]))
            if depth[y, x] > 0 and abs(depth[y, x] - depth[v, u]) <= config.depth_gate
        ]
        if len(window) < config.min_window:
            continue
        mean = np.mean(window, axis=0)
        normal = np.linalg.eigh(np.cov(np.array(window).T, bias=True))[1][:, 0]
        normal = -normal if normal @ ray[v, u] > 0 else normal
        if -normal @ ray[v, u] / np.linalg.norm(ray[v, u]) <= np.cos(np.deg2rad(config.grazing_deg)):
            continue
        z = normal @ mean / (normal @ ray[v, u])
        if abs(z - depth[v, u]) <= config.depth_gate:
            points.append(z * ray[v, u])
            normals.append(normal)
    return np.array(points), np.array(normals)


def test_equals_the_slow_loop(rng: np.random.Generator) -> None:
    """A noisy bent surface with holes and a step beyond the gate."""
    ray = rays(24, 30)
    depth = 0.7 + 0.3 * ray[..., 0] + 2.0 * ray[..., 1] ** 2 + rng.normal(0, 0.0013, (24, 30))
    depth[:, 17:] += 0.03
    depth[rng.random(depth.shape) < 0.2] = 0.0
    config = settings(SensingConfig)
    points, normals = surface_points(depth, ray, config)
    slow, slow_normals = slow_points(depth, ray, config)
    assert len(slow) > 300
    np.testing.assert_allclose(points, slow, atol=1e-9)
    np.testing.assert_allclose(normals, slow_normals, atol=1e-7)


@pytest.mark.parametrize("turn_deg", [0, 30, 60])
def test_plane(turn_deg: float) -> None:
    """On an ideal plane every pixel gives the plane's normal and its own point."""
    turn, ray = np.deg2rad(turn_deg), rays(20, 20)
    normal = np.array([np.sin(turn), 0.0, -np.cos(turn)])
    depth = plane_depth(normal, -0.7 * np.cos(turn), ray)
    points, normals = surface_points(depth, ray, settings(SensingConfig))
    corners = np.ix_([0, -1], [0, -1])  # their windows have 3 x 3 pixels, fewer than min_window = 12
    inner = np.ones((20, 20), bool)
    inner[corners] = False
    np.testing.assert_allclose(points, (depth[..., None] * ray)[inner], atol=1e-9)
    np.testing.assert_allclose(normals, np.broadcast_to(normal, normals.shape), atol=1e-6)


def test_depth_gate_keeps_surfaces_apart() -> None:
    """Two frontal planes 15 mm apart: beyond the 12 mm gate no normal leans, up to the edge."""
    depth = np.full((20, 20), 0.7)
    depth[:, 10:] = 0.715
    _, normals = surface_points(depth, rays(20, 20), settings(SensingConfig))
    np.testing.assert_allclose(normals, np.broadcast_to([0, 0, -1.0], normals.shape), atol=1e-7)


def test_lone_pixels_and_missing_readings_give_nothing() -> None:
    depth = np.full((20, 20), np.nan)
    depth[3:6, 3:6], depth[10], depth[15, 15] = 0.7, -1.0, np.inf
    points, normals = surface_points(depth, rays(20, 20), settings(SensingConfig))
    assert points.shape == normals.shape == (0, 3)


def test_even_window_is_refused() -> None:
    with pytest.raises(InputError, match="window: expected an odd number of pixels, got 4"):
        surface_points(np.ones((9, 9)), rays(9, 9), settings(SensingConfig, window=4))


def test_smallest_eigenvectors_equal_eigh(rng: np.random.Generator) -> None:
    """Random and flat matrices (smallest eigenvalue 0) at scales from 1e-8 (windows in m2) to 1.

    Largest deviation over 10 seeds 3e-13 rad where the two smallest eigenvalues differ by 1 % of the largest.
    """
    factors = rng.normal(size=(5000, 3, 3)) * 10 ** rng.uniform(-4, 0, (5000, 1, 1))
    factors[::2, :, 2] *= 1e-3
    matrices = factors @ factors.transpose(0, 2, 1)
    matrices[::4] = np.diag([2.0, 2.0, 1.0])
    values, vectors = np.linalg.eigh(matrices)
    distinct = values[:, 1] - values[:, 0] > 0.01 * values[:, 2]
    six = matrices[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].T
    found = smallest_eigenvectors(six)
    sine = np.linalg.norm(np.cross(found, vectors[:, :, 0]), axis=1)
    assert distinct.sum() > 3000
    assert sine[distinct].max() < 1e-11


def test_smallest_eigenvectors_of_degenerate_matrices_are_finite() -> None:
    """Zero, isotropic, and a line (two zero eigenvalues)."""
    line = np.array([1.0, 0, 0, 0, 0, 0])
    found = smallest_eigenvectors(np.stack([np.zeros(6), np.array([1.0, 0, 0, 1, 0, 1]), line], axis=1))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    assert abs(found[2, 0]) < 1e-6
