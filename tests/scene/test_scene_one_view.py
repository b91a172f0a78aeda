"""The grid mesh of a camera is a cloud, a CAD mesh is none, open or closed."""

import numpy as np
import pytest
import trimesh

from spgf_torch.scene.one_view import seen_from
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

SENSING = settings(SensingConfig)


def grid(mesh: trimesh.Trimesh, eye: np.ndarray, own_frame: bool, away: bool) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces as a camera at `eye` writes them, its pixels joined, jump edges too."""
    camera = Camera(intrinsics(SENSING), look_at(eye, np.zeros(3)), SENSING.width, SENSING.height)
    depth = cast(mesh, camera)[0]
    points = (camera.rays() * depth[..., None]).reshape(-1, 3)
    number = np.arange(depth.size).reshape(depth.shape)
    a, b, c, d = (each.ravel() for each in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])
    faces = faces[(depth.ravel()[faces] > 0).all(axis=1)]
    if not own_frame:
        points = points @ camera.T_object_camera[:3, :3].T + camera.T_object_camera[:3, 3]
    return points, faces[:, ::-1] if away else faces


@pytest.mark.parametrize("away", [False, True], ids=["faces-to-camera", "faces-away"])
@pytest.mark.parametrize("own_frame", [True, False], ids=["camera-frame", "robot-frame"])
def test_what_a_camera_writes(own_frame: bool, away: bool) -> None:
    box = trimesh.creation.box([0.1, 0.06, 0.08])
    eye = np.array([0.4, -0.3, 0.5])
    found = seen_from(*grid(box, eye, own_frame, away))
    assert found is not None
    if own_frame:
        np.testing.assert_array_equal(found, 0)
    else:
        assert found @ eye > 0.8 * np.linalg.norm(found) * np.linalg.norm(eye)


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(3, 0.05)


def part(mesh: trimesh.Trimesh, keep: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[keep], process=False)


def soup() -> trimesh.Trimesh:
    mesh, turn = ball(), np.random.default_rng(0).random(1280) < 0.5
    return trimesh.Trimesh(mesh.vertices, np.where(turn[:, None], mesh.faces, mesh.faces[:, ::-1]), process=False)


@pytest.mark.parametrize(
    "mesh",
    [
        ball(),
        part(ball(), np.arange(1280) % 40 != 0),
        part(ball(), ball().triangles_center[:, 2] > -0.03),
        part(ball(), ball().triangles_center[:, 2] > 0),
        part(soup(), np.arange(1280) % 40 != 0),
        trimesh.util.concatenate([ball(), ball().apply_translation([0.2, 0, 0])]),
        trimesh.Trimesh(ball().triangles.reshape(-1, 3), np.arange(3840).reshape(-1, 3), process=False),
    ],
    ids=["closed", "holes", "fused", "half", "soup", "two", "unmerged"],
)
def test_things_from_all_sides(mesh: trimesh.Trimesh) -> None:
    assert seen_from(np.asarray(mesh.vertices), np.asarray(mesh.faces)) is None


def bottle(rings: int) -> trimesh.Trimesh:
    """Turned about z, its base about the origin; walls and neck in so many rings."""
    z = np.linspace(0, 0.21, rings)
    radius = np.where(z < 0.15, 0.03, 0.012)
    return trimesh.creation.revolve(np.column_stack([[0, *radius, 0], [0, *z, 0.21]]))


@pytest.mark.parametrize(
    "mesh",
    [
        bottle(3),
        bottle(60),
        trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.06, 0.08]]),
        trimesh.creation.cone(0.04, 0.1),
    ],
    ids=["bottle", "bottle of many rings", "box from its corner", "cone"],
)
def test_a_closed_mesh_with_a_corner_at_the_origin_is_none(mesh: trimesh.Trimesh) -> None:
    assert mesh.is_watertight and (mesh.vertices == 0).all(axis=1).any()
    assert seen_from(np.asarray(mesh.vertices), np.asarray(mesh.faces)) is None


def test_pixels_without_a_reading_that_close_a_cameras_mesh_are_no_corner() -> None:
    """A ball alone in the image: all else is 0 0 0, and the faces to there make the surface a closed one."""
    camera = Camera(intrinsics(SENSING), look_at(np.array([0.3, 0, 0.2]), np.zeros(3)), SENSING.width, SENSING.height)
    depth = cast(trimesh.creation.icosphere(3, 0.05), camera)[0]
    points = (camera.rays() * np.nan_to_num(depth)[..., None]).reshape(-1, 3)
    number = np.arange(depth.size).reshape(depth.shape)
    a, b, c, d = (each.ravel() for each in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])
    found = seen_from(points, faces)
    assert found is not None and not found.any()
