"""Unseen space: by hand, and against a slow loop."""

import math

import numpy as np
import pytest
import torch
import trimesh

from spgf_torch.geometry import se3
from spgf_torch.sensing.cameras import Camera, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe, observe_on_table, observe_views
from spgf_torch.sensing.unseen import DepthView, behind, behind_at, mean_direction
from spgf_torch.settings import settings

K = np.array([[100.0, 0, 9.5], [0, 100.0, 7.5], [0, 0, 1]])
SENSING = settings(SensingConfig, width=160, height=120, focal=144)


def camera(T: np.ndarray | None = None) -> Camera:
    return Camera(K, np.eye(4) if T is None else T, 20, 16)


def slow(point: np.ndarray, images: list[tuple[np.ndarray, Camera]]) -> float:
    """One point, pixel by pixel."""
    least = math.inf
    for depth, seen_by in images:
        x, y, z = np.linalg.inv(seen_by.T_object_camera)[:3] @ [*point, 1]
        if z <= 0:
            continue
        u, v = (seen_by.K @ [x / z, y / z, 1])[:2]
        if not (-0.5 < u < seen_by.width - 0.5 and -0.5 < v < seen_by.height - 0.5):
            continue
        u, v = round(u), round(v)
        around = depth[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
        surface = depth[v, u] if depth[v, u] > 0 else min(around[around > 0], default=math.inf)
        least = min(least, z - surface if math.isfinite(surface) else -0.1)
    return least


def test_equals_the_slow_loop() -> None:
    rng = np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3] = trimesh.transformations.rotation_matrix(0.4, [1, 2, 3])[:3, :3]
    T[:3, 3] = [0.1, -0.05, -0.05]
    images = [(rng.uniform(0.4, 0.6, (16, 20)) * (rng.random((16, 20)) < 0.5), camera(pose)) for pose in (np.eye(4), T)]
    points = rng.uniform([-0.06, -0.05, 0.2], [0.06, 0.05, 0.7], (400, 3)).astype(np.float32)
    found = behind(torch.from_numpy(points), [DepthView.of(*image) for image in images]).numpy()
    expected = np.array([slow(point, images) for point in points], np.float32)
    assert np.isfinite(expected).sum() > 50 and np.isinf(expected).sum() > 50
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_a_body_at_poses_equals_its_points() -> None:
    """All but what is known well enough, which need not be the least; infinite in the same places."""
    rng = np.random.default_rng(1)
    generator = torch.Generator().manual_seed(1)
    pose = np.eye(4)
    pose[:3, :3] = trimesh.transformations.rotation_matrix(0.4, [1, 2, 3])[:3, :3]
    images = [(rng.uniform(0.4, 0.6, (16, 20)), camera(where)) for where in (np.eye(4), pose)]
    views = [DepthView.of(np.where(depth < 0.45, 0, depth), seen_by) for depth, seen_by in images]
    T = se3.random_poses(30, generator, extent=0.03)
    T[:, 2, 3] += 0.5
    body = 0.04 * torch.randn(40, 3, generator=generator)
    expected = behind((T[:, :3, :3] @ body.T).mT + T[:, None, :3, 3], views)
    assert 50 < expected.isinf().sum() < expected.numel() - 50
    for enough in (-1.0, 0.006, math.inf):
        found = behind_at(T, body, views, enough)
        assert torch.equal(found.isinf(), expected.isinf())
        exact = expected > enough
        torch.testing.assert_close(found[exact], expected[exact], atol=1e-5, rtol=0)
        assert (found[~exact] <= enough).all()


def test_by_hand() -> None:
    """A wall at 0.5 m with a hole of one pixel and a hole of five."""
    depth = np.full((16, 20), 0.5)
    depth[3, 3] = np.nan
    depth[8:13, 8:13] = 0
    view = DepthView.of(depth, camera())
    at = lambda u, v, z: torch.tensor([(u - 9.5) / 100 * z, (v - 7.5) / 100 * z, z])  # noqa: E731
    points = torch.stack([at(5, 5, 0.6), at(5, 5, 0.4), at(3, 3, 0.6), at(10, 10, 0.6), at(25, 5, 0.6), at(5, 5, -0.1)])
    expected = [0.1, -0.1, 0.1, -0.1, math.inf, math.inf]
    assert behind(points, [view]).tolist() == pytest.approx(expected, abs=1e-6)


def test_what_one_view_hides_another_shows() -> None:
    """The far side of a box: unseen from one side, free from four; below the table never seen."""
    box = trimesh.creation.box((0.06, 0.06, 0.1))
    far = torch.tensor([[-0.034, -0.034, -0.03]])
    rng = np.random.default_rng(0)
    for count, hidden in ((1, True), (4, False)):
        config = settings(SensingConfig, width=160, height=120, focal=144, cameras=count)
        texlets, views = observe_on_table(box, surround(config, np.zeros(3)), config, rng)
        assert (behind(far, views) > 0.01).item() == hidden
        assert behind(torch.tensor([[0.0, 0, -0.07]]), views).item() > 0.01
        assert texlets.positions[:, 2].min() > -0.045
        assert (mean_direction(views, torch.zeros(3))[:2].norm() > 0.5).item() == hidden


def test_images_leave_texlets_as_they_were() -> None:
    """`observe` and `observe_views` draw the same noise; outside of the part that was cast nothing returns."""
    ball = trimesh.creation.icosphere(radius=0.04)
    cameras = surround(SENSING, np.zeros(3))
    one = observe(ball, cameras, SENSING, np.random.default_rng(3))
    two, views = observe_views(ball, cameras, SENSING, np.random.default_rng(3))
    assert torch.equal(one.positions, two.positions) and torch.equal(one.normals, two.normals)
    assert all(view.depth.shape == (120, 160) for view in views)
    surface = behind(one.positions - 0.01 * one.normals, views)
    assert (surface > 0).float().mean() > 0.9 and (behind(one.positions + 0.02 * one.normals, views) < 0).all()
