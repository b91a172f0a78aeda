"""Scenes: a mask, a crop box and segments mark targets, the rest stays an obstacle, the table is found before."""

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import spgf_torch
from spgf_torch.errors import InputError
from spgf_torch.scene.scene import Scene, check_spacing
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

SENSING = settings(SensingConfig)
EYE = np.array([0.3, -0.3, 0.5])


def box(size: tuple[float, float, float], place: tuple[float, float, float]) -> trimesh.Trimesh:
    made = trimesh.creation.box(size)
    made.apply_translation(place)
    return made


@pytest.fixture(scope="module")
def image() -> tuple[np.ndarray, Camera, np.ndarray]:
    """Two boxes on a table 0.6 m wide, z up, and what shows which: 0 the table, 1 and 2 the boxes."""
    parts = [
        box((0.6, 0.6, 0.02), (0, 0, -0.01)),
        box((0.06, 0.05, 0.08), (0, 0, 0.04)),
        box((0.05, 0.05, 0.1), (0.15, 0.05, 0.05)),
    ]
    camera = Camera(intrinsics(SENSING), look_at(EYE, np.array([0.05, 0, 0.03])), SENSING.width, SENSING.height)
    depth = cast(trimesh.util.concatenate(parts), camera)[0]
    own = [cast(part, camera)[0] for part in parts]
    labels = np.zeros(depth.shape, np.int32)
    for k in (1, 2):
        labels[(own[k] > 0) & (np.abs(own[k] - depth) < 1e-6)] = k
    return depth, camera, labels


def around(scene: Scene, low: list[float], high: list[float]) -> bool:
    """Whether all texlets lie in a box."""
    positions = scene.texlets.positions
    return bool(((positions >= torch.tensor(low)) & (positions <= torch.tensor(high))).all())


FIRST = ([-0.04, -0.035, 0.0], [0.04, 0.035, 0.09])
SECOND = ([0.12, 0.02, 0.0], [0.18, 0.08, 0.11])


def test_a_mask_marks_the_target_and_leaves_table_and_neighbour(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    depth, camera, labels = image
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, mask=labels == 1, table="find")
    assert scene.table is not None
    np.testing.assert_allclose(scene.table, [0, 0, 1, 0], atol=2e-3)
    assert around(scene, *FIRST) and len(scene.texlets) > 100 and scene.targets == (1,)
    near = scene.obstacles[:, 0] > 0.1
    assert near.all() and len(scene.obstacles) > 100  # the neighbour alone: neither target nor table
    assert scene.obstacles[:, 2].min() > 0.008 - 1e-6
    np.testing.assert_allclose(scene.viewpoints, [EYE])
    whole = Scene.from_depth(depth, camera.K, camera.T_object_camera, table="find")
    assert not len(whole.obstacles) and len(whole.texlets) > len(scene.texlets) + 100


def test_segments_are_targets_and_each_others_obstacles(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    depth, camera, labels = image
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, segments=labels * 3, table="find")
    assert scene.targets == (3, 6) and not len(scene.obstacles)
    first, second = scene.of(3), scene.of(6)
    assert around(first, *FIRST) and around(second, *SECOND)
    assert torch.equal(first.obstacles, second.texlets.positions) and torch.equal(
        second.obstacles, first.texlets.positions
    )
    assert any(note.startswith("targets: 3 (") for note in scene.notes)


def test_a_scene_is_a_line(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    depth, camera, shown = image
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, segments=shown, table="find")
    counted = f"2 target(s), {len(scene.texlets)} texlets, {len(scene.obstacles)} obstacle points"
    assert repr(scene) == f"Scene({counted}, a table, 1 images, {len(scene.notes)} notes)"


def test_a_cloud_with_a_crop_box_a_mask_and_segments(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    """As a camera's image of points (H, W, 3) with NaN, whose viewpoint is told by its pixels."""
    depth, camera, labels = image
    T = camera.T_object_camera
    points = (depth[..., None] * camera.rays()) @ T[:3, :3].T + T[:3, 3]
    points[depth <= 0] = np.nan
    cropped = Scene.from_points(points, table="find", crop_low=np.array(FIRST[0]) - 0.01, crop_high=np.array(FIRST[1]))
    masked = Scene.from_points(points, EYE, mask=labels == 1, table="find")
    several = Scene.from_points(points, EYE, segments=labels, table="find")
    for scene in (cropped, masked, several.of(1)):
        assert scene.table is not None
        np.testing.assert_allclose(scene.table, [0, 0, 1, 0], atol=2e-3)
        assert around(scene, *FIRST) and len(scene.texlets) > 100
        assert (scene.obstacles[:, 0] > 0.1).sum() > 20
    assert any("pixels' rays meet at (0.300, -0.300, 0.500)" in note for note in cropped.notes)
    assert several.targets == (1, 2)


def test_files_give_the_same_scene(image: tuple[np.ndarray, Camera, np.ndarray], tmp_path: Path) -> None:
    depth, camera, labels = image
    for name, array in (("depth", depth), ("mask", (labels == 1).astype(np.uint8)), ("K", camera.K)):
        np.save(tmp_path / f"{name}.npy", array)
    (tmp_path / "T.json").write_text(json.dumps(camera.T_object_camera.tolist()))
    files = {"intrinsics": tmp_path / "K.npy", "poses": tmp_path / "T.json", "mask": tmp_path / "mask.npy"}
    of_files = Scene.from_files(tmp_path / "depth.npy", table="find", **files)
    of_arrays = Scene.from_depth(depth, camera.K, camera.T_object_camera, mask=labels == 1, table="find")
    torch.testing.assert_close(of_files.texlets.positions, of_arrays.texlets.positions)
    torch.testing.assert_close(of_files.obstacles, of_arrays.obstacles)


def test_several_images_in_lists(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    depth, camera, labels = image
    T = camera.T_object_camera
    once = Scene.from_depth(depth, camera.K, T, mask=labels == 1, table="find")
    twice = Scene.from_depth([depth, depth], camera.K, [T, T], mask=[labels == 1] * 2, table="find")
    assert 0.7 < len(twice.texlets) / len(once.texlets) < 1.4
    with pytest.raises(InputError, match="T_input_camera: expected the pose of each of the 2 depth images, got none"):
        Scene.from_depth([depth, depth], camera.K)
    with pytest.raises(InputError, match=r"mask: expected one a depth image \(2\), got 1"):
        Scene.from_depth([depth, depth], camera.K, [T, T], mask=[labels == 1])


def test_without_a_table_it_is_said_and_what_is_up(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    depth, camera, labels = image
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, mask=labels == 1)
    assert scene.gravity is not None and scene.gravity.up.tolist() == [0, 0, 1]
    assert sum(note.startswith("no table: none given") and "z is taken for up" in note for note in scene.notes) == 1
    assert (scene.obstacles[:, 2] < 0.005).sum() > 1000  # the table is an obstacle like any other
    free = Scene.from_depth(depth, camera.K, camera.T_object_camera, mask=labels == 1, gravity=None)
    assert free.gravity is None
    assert any("no table" in note and "hands may come from below" in note for note in free.notes)


def test_a_table_that_looks_level_to_nobody_is_warned_of(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    """OpenGL's pose: the same camera with y up and z back."""
    depth, camera, _ = image
    T = camera.T_object_camera @ np.diag([1.0, -1, -1, 1])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        scene = Scene.from_depth(depth, camera.K, T, table="find")
    words = [str(each.message) for each in told]
    assert any(re.search(r"z and the pictures' up are \d+ deg apart: .*OpenGL's", word) for word in words)
    assert any(re.search(r"^table: tilted \d+ deg", word) for word in words)
    assert sum(note.startswith("warning: ") for note in scene.notes) == len(words)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"table": "floor"}, "table: expected null, find"),
        ({"gravity": "up"}, "gravity: expected auto, null"),
        ({"tabel": "find"}, r"tabel: expected a key of SceneConfig, got tabel; did you mean table\?"),
        ({"mask": np.zeros((4, 4), bool)}, "mask: expected"),
        ({"segments": np.zeros((240, 320), int)}, "segments: expected"),
        ({"mask": np.ones((240, 320)), "segments": np.ones((240, 320), int)}, "expected mask or segments, got both"),
    ],
)
def test_settings_in_python_that_do_not_fit(
    changes: dict, message: str, image: tuple[np.ndarray, Camera, np.ndarray]
) -> None:
    depth, camera, _ = image
    with pytest.raises(InputError, match=message) as caught:
        Scene.from_depth(depth, camera.K, camera.T_object_camera, **changes)
    assert "\n" not in str(caught.value)


def test_the_package_shows_it() -> None:
    assert spgf_torch.Scene is Scene
    with pytest.raises(AttributeError, match="no attribute 'no_such'"):
        spgf_torch.no_such  # noqa: B018


def test_texlets_of_another_model_are_refused(image: tuple[np.ndarray, Camera, np.ndarray]) -> None:
    depth, camera, labels = image
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, mask=labels == 1)
    check_spacing(scene, SENSING)
    with pytest.raises(InputError, match=r"0\.008 m apart as the model's, got 0\.005 m; .* sensing=model\.sensing"):
        check_spacing(scene, settings(SensingConfig, spacing=0.008))
