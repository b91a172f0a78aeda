"""Poses, intrinsics and ray casting against values worked out by hand."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from spgf_torch.sensing.cameras import Camera, cast, crop, look_at, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings


def frontal(target: np.ndarray, distance: float) -> Camera:
    """101 x 81 pixels, f = 100, looking along -x at `target`; its middle pixel (50, 40) is the principal point."""
    K = np.array([[100.0, 0.0, 50.0], [0.0, 100.0, 40.0], [0.0, 0.0, 1.0]])
    return Camera(K, look_at(target + np.array([distance, 0.0, 0.0]), target), 101, 81)


def test_cameras_look_at_the_centre() -> None:
    """The centre lies on the optical axis at the configured distance, the eye at the configured elevation."""
    config, centre = settings(SensingConfig, cameras=5, distance=0.6, elevation_deg=30, azimuth_deg=10), np.ones(3)
    cameras = surround(config, centre)
    assert len(cameras) == 5
    for i, camera in enumerate(cameras):
        T = camera.T_object_camera
        np.testing.assert_allclose(T[:3, :3].T @ (centre - T[:3, 3]), [0, 0, 0.6], atol=1e-12)
        np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        eye = T[:3, 3] - centre
        assert eye[2] == pytest.approx(0.3)  # 0.6 sin 30
        assert np.rad2deg(np.arctan2(eye[1], eye[0])) % 360 == pytest.approx(10 + 72 * i)


def test_image_axes() -> None:
    """A camera on +x looking along -x: object +z is up (lower row), object +y is to the right (higher column)."""
    camera = frontal(np.zeros(3), 1.0)
    up, right = (camera.T_object_camera[:3, :3].T @ axis for axis in ([0, 0, 1.0], [0, 1.0, 0]))
    np.testing.assert_allclose(up, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(right, [1, 0, 0], atol=1e-12)


def test_ray_through_the_principal_point() -> None:
    rays = frontal(np.zeros(3), 1.0).rays()
    np.testing.assert_allclose(rays[40, 50], [0, 0, 1])
    np.testing.assert_allclose(rays[0, 100], [0.5, -0.4, 1])


def test_box() -> None:
    """A cube of side 0.2 m, 1 m away: its front face is at depth 0.9 m everywhere and covers 0.1 * 100 / 0.9 = 11.1
    pixels to each side of the principal point, so 23 x 23 pixels. The ray at pixel offset k meets it at cosine
    1 / sqrt(1 + (k/100)^2)."""
    depth, cosine = cast(trimesh.creation.box([0.2, 0.2, 0.2]), frontal(np.zeros(3), 1.0))
    seen = depth > 0
    assert seen.sum() == 23 * 23
    assert seen[40 - 11 : 40 + 12, 50 - 11 : 50 + 12].all()
    np.testing.assert_allclose(depth[seen], 0.9, atol=1e-12)
    assert cosine[40, 61] == pytest.approx(1 / np.sqrt(1.0121))
    assert (cosine[~seen] == 1).all()


def test_sphere() -> None:
    """Ray p = z r against |p - D e_z| = R: z = (D - sqrt(D^2 - |r|^2 (D^2 - R^2))) / |r|^2.

    The mesh is inscribed with edges of about 0.02 R: sagitta R (0.02)^2 / 8 = 5e-6 m for R = 0.1 m, more at slant.
    """
    ball, camera = trimesh.creation.icosphere(6, radius=0.1), frontal(np.zeros(3), 1.0)
    depth, cosine = cast(ball, camera)
    square = (camera.rays() ** 2).sum(axis=-1)
    root = 1.0 - square * (1.0 - 0.01)
    expected = (1.0 - np.sqrt(np.maximum(root, 0))) / square
    inside = root > 0.002  # up to 63 deg of incidence
    assert inside.sum() > 200
    np.testing.assert_allclose(depth[inside], expected[inside], atol=2e-5)
    assert (depth[root < -0.001] == 0).all()
    point = expected[..., None] * camera.rays() - [0, 0, 1]
    facing = -(point * camera.rays()).sum(axis=-1) / (0.1 * np.sqrt(square))
    np.testing.assert_allclose(cosine[inside], facing[inside], atol=0.02)


def test_crop_is_a_part_of_the_image() -> None:
    """Casting only the pixels that the box can cover gives the same readings, and nothing lies outside them."""
    mesh = trimesh.creation.box([0.1, 0.05, 0.2])
    mesh.apply_translation([0.03, 0.02, 0.0])
    camera = surround(settings(SensingConfig), np.zeros(3))[1]
    part = crop(camera, mesh.bounds, margin=3)
    left, top = np.rint(camera.K[:2, 2] - part.K[:2, 2]).astype(int)
    whole, _ = cast(mesh, camera)
    rows, columns = slice(top, top + part.height), slice(left, left + part.width)
    np.testing.assert_allclose(cast(mesh, part)[0], whole[rows, columns], atol=1e-9)
    assert part.width * part.height < 0.2 * whole.size
    assert np.count_nonzero(whole[rows, columns]) == np.count_nonzero(whole)


def test_crop_of_what_the_image_does_not_show_in_full() -> None:
    camera = frontal(np.zeros(3), 0.5)
    assert crop(camera, np.array([[-1.0, -1, -1], [1, 1, 1]]), 2) is camera  # around the camera
    part = crop(camera, np.array([[-0.1, -9, -9], [0.1, 9, 9]]), 2)  # larger than the image
    assert (part.width, part.height) == (101, 81)
    part = crop(camera, np.array([[-0.1, 8, -0.1], [0.1, 9, 0.1]]), 2)  # outside it
    assert part.width == 1


def test_moving_object_and_camera_together_changes_nothing() -> None:
    mesh, camera = trimesh.creation.torus(0.06, 0.02), surround(settings(SensingConfig), np.zeros(3))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=3).as_matrix(), [0.3, -0.2, 0.5]
    moved = Camera(camera.K, T @ camera.T_object_camera, camera.width, camera.height)
    (depth, cosine), (depth_moved, cosine_moved) = cast(mesh, camera), cast(mesh.copy().apply_transform(T), moved)
    same = (depth > 0) & (depth_moved > 0) & (np.abs(cosine - cosine_moved) < 1e-6)  # float32 may pick a neighbour face
    assert same.sum() > 0.995 * max((depth > 0).sum(), (depth_moved > 0).sum())
    np.testing.assert_allclose(depth[same], depth_moved[same], atol=1e-9)
