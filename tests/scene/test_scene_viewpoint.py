"""From which side clouds were seen that do not say it: told rightly, or refused, never wrong."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.objects.library import load_object
from spgf_torch.paths import root
from spgf_torch.scene.cloud import Cloud, pixels_of, voxel_means
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.normals import facing, neighbourhoods, principal_normals
from spgf_torch.scene.viewpoint import check_side, with_viewpoint
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.settings import settings

CONFIG, SENSING = settings(SceneConfig), settings(SensingConfig)
EYE = np.array([0.35, -0.3, 0.45])


@cache
def mesh_of(name: str) -> trimesh.Trimesh:
    return load_object(root() / f"data/objects/{name}.yaml").mesh


def seen(name: str, eye: np.ndarray = EYE, table: bool = False, seed: int = 0) -> tuple[np.ndarray, np.ndarray, Camera]:
    """(H, W, 3) points of a noisy image of an object that stands at z = 0, NaN without return; its depth and camera."""
    mesh = mesh_of(name).copy()
    mesh.apply_translation([0, 0, -mesh.bounds[0, 2]])
    if table:
        board = trimesh.creation.box([0.5, 0.5, 0.02])
        board.apply_translation([0, 0, -0.01])
        mesh = trimesh.util.concatenate([mesh, board])
    camera = Camera(intrinsics(SENSING), look_at(eye, np.array([0, 0, 0.04])), SENSING.width, SENSING.height)
    depth, cosine = cast(mesh, camera)
    depth = measure(depth, cosine, camera.K[0, 0], SENSING, np.random.default_rng(seed))
    T = camera.T_object_camera
    points = (depth[..., None] * camera.rays()) @ T[:3, :3].T + T[:3, 3]
    return np.where(depth[..., None] > 0, points, np.nan), depth, camera


def flat(image: np.ndarray) -> np.ndarray:
    points = image.reshape(-1, 3)
    return points[np.isfinite(points).all(axis=1)]


def wrong(cloud: Cloud, eye: np.ndarray) -> float:
    """The share of normals that the viewpoint found turns otherwise than the true one."""
    notes: list[str] = []
    thinned = voxel_means(cloud, CONFIG.voxel)
    found = with_viewpoint(thinned, cloud, CONFIG, notes)
    assert len(notes) == 1 and "does not say it" in notes[0]
    index, pitch = neighbourhoods(thinned.points, CONFIG.neighbours, CONFIG.normal_radius)
    normals, _ = principal_normals(thinned.points, index)
    assert found.viewpoints is not None
    truth, told = (facing(thinned.points, normals, eyes, pitch)[0] for eyes in (eye[None], found.viewpoints))
    return float(((truth * told).sum(axis=1) < 0).mean())


@pytest.mark.parametrize("name", ["box_tea", "mug_coffee", "apple"])
@pytest.mark.parametrize("shift", [(0.6, -0.2, -0.05), (-0.4, 0.5, 0.3), (0.7, 0.0, -0.4)])
def test_an_object_in_a_robots_frame(name: str, shift: tuple[float, float, float]) -> None:
    """The origin is not the camera. Told to within a tenth of the normals, or refused."""
    cloud = Cloud(flat(seen(name)[0]) + shift)
    try:
        assert wrong(cloud, EYE + shift) < 0.1
    except InputError as error:
        assert re.search(r"viewpoint.* give viewpoints=\[\[x,y,z\]", str(error))
        assert name == "mug_coffee"  # a cup that is seen from above bulges to neither side


def test_what_stands_on_a_table_tells_its_side() -> None:
    for shift in ([0.5, 0.1, -0.1], [0.4, 0.2, 0.9], [0, 0, 0]):
        cloud = Cloud(flat(seen("mug_coffee", table=True)[0]) + shift)
        assert wrong(cloud, EYE + shift) < 0.02


def test_a_cameras_own_frame_is_known_by_its_pixels() -> None:
    """Seen from its own centre a camera's cloud is a grid, a cup's too; every other point of it is a grid no more."""
    _, depth, camera = seen("mug_coffee")
    points = depth[depth > 0, None] * camera.rays()[depth > 0]
    assert wrong(Cloud(points), np.zeros(3)) == 0
    assert wrong(Cloud(points * [1, -1, -1]), np.zeros(3)) == 0  # OpenGL's axes
    box = (d := seen("box_tea"))[1][d[1] > 0, None] * d[2].rays()[d[1] > 0]
    few = box[np.random.default_rng(0).random(len(box)) < 0.5] + np.random.default_rng(1).normal(0, 0.0005, 3)
    assert wrong(Cloud(few), np.zeros(3)) == 0


def test_an_image_of_points_tells_its_camera_in_any_frame() -> None:
    image, _, _ = seen("mug_coffee")
    kept = np.isfinite(image).all(axis=2).ravel()
    pixels = pixels_of(image.shape)
    assert pixels is not None
    R = look_at(np.array([0.3, 0.8, 0.1]), np.zeros(3))[:3, :3]
    cloud = Cloud(image.reshape(-1, 3)[kept] @ R.T + [1, 2, 3], pixels=pixels[kept])
    found = with_viewpoint(voxel_means(cloud, CONFIG.voxel), cloud, CONFIG, [])
    assert found.viewpoints is not None
    np.testing.assert_allclose(found.viewpoints[0], R @ EYE + [1, 2, 3], atol=0.03)


def test_a_ball_seen_from_all_sides_and_a_lone_plane_do_not_tell(ball: tuple[np.ndarray, np.ndarray]) -> None:
    grid = np.stack(np.meshgrid(np.arange(0, 0.1, 0.003), np.arange(0, 0.1, 0.003)), axis=-1).reshape(-1, 2)
    plane = np.column_stack([grid + np.array([0.4, 0.1]), np.full(len(grid), -0.02)])
    for points in (ball[0] + [0.4, 0, -0.2], plane):
        cloud = Cloud(points)
        with pytest.raises(InputError, match=r"got neither, .* give viewpoints=\[\[x,y,z\],...\]"):
            with_viewpoint(voxel_means(cloud, CONFIG.voxel), cloud, CONFIG, [])


def test_what_is_known_stays() -> None:
    known = Cloud(np.zeros((3, 3)), None, EYE[None])
    assert with_viewpoint(known, known, CONFIG, notes := []) is known and not notes


def estimated(name: str, eye: np.ndarray, told: np.ndarray) -> Cloud:
    cloud = voxel_means(Cloud(flat(seen(name, eye)[0])), CONFIG.voxel)
    index, pitch = neighbourhoods(cloud.points, CONFIG.neighbours, CONFIG.normal_radius)
    normals = facing(cloud.points, principal_normals(cloud.points, index)[0], told[None], pitch)[0]
    return replace(cloud, normals=normals, viewpoints=told[None])


def test_a_viewpoint_on_the_wrong_side_is_refused_where_the_shape_tells_it() -> None:
    check_side(estimated("box_tea", EYE, EYE), CONFIG, notes := [])
    assert not notes
    with pytest.raises(
        InputError, match=r"expected a viewpoint on the side that was seen, got \(-0\.35, 0\.3, -0\.45\) m"
    ):
        check_side(estimated("box_tea", EYE, -EYE), CONFIG, notes)


def test_the_corner_of_a_room_is_warned_of_not_refused() -> None:
    """Floor and two walls of 0.5 m seen from within: a box of that size seen from without looks the same."""
    grid = np.stack(np.meshgrid(np.arange(0, 0.5, 0.004), np.arange(0, 0.5, 0.004)), axis=-1).reshape(-1, 2)
    flat = np.column_stack([grid, np.zeros(len(grid))])
    points, normals = (
        np.concatenate([flat, np.roll(flat, 1, 1), np.roll(flat, 2, 1)]),
        np.repeat(np.eye(3)[[2, 0, 1]], len(grid), 0),
    )
    corner = Cloud(points, normals, np.array([[0.8, 0.9, 1.0]]))
    check_side(corner, CONFIG, notes := [])
    assert len(notes) == 1 and "hollow" in notes[0]


def test_the_inside_of_a_bin_is_warned_of_not_refused() -> None:
    """Walls and floor seen from above look hollow, and from below they would hide each other."""
    above = np.array([0.02, -0.05, 0.7])
    check_side(estimated("bin_storage", above, above), CONFIG, notes := [])
    assert all(note.startswith("warning: ") and "hollow" in note for note in notes)
