"""Clouds and meshes from file to texlets, and the settings that cannot be used."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.assembly import read_scene, scene_of_views, texlets_of
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.target_selection import check_extent
from spgf_torch.scene.views import View
from spgf_torch.sensing.cameras import Camera, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe
from spgf_torch.settings import settings

SENSING = settings(SensingConfig)
Oriented = tuple[np.ndarray, np.ndarray]


def read(seed: int = 0, **given: object) -> Scene:
    given["input"] = [str(path) for path in given["input"]] if isinstance(given["input"], list) else str(given["input"])
    return read_scene(settings(SceneConfig, **given), SENSING, np.random.default_rng(seed))


@pytest.fixture
def cloud(ball: Oriented, tmp_path: Path) -> Path:
    """The upper part of the ball as a cloud of points alone."""
    np.save(tmp_path / "ball.npy", ball[0][ball[1][:, 2] > 0.2])
    return tmp_path / "ball.npy"


def test_a_cloud_from_file_to_texlets(cloud: Path) -> None:
    scene = read(input=cloud, viewpoints=[[0.1, 0, 1.0]])
    outwards = scene.texlets.positions - torch.tensor([0.1, 0, 0.2])
    assert len(scene.texlets) > 200
    assert scene.texlets.positions.dtype == scene.obstacles.dtype == torch.float32
    torch.testing.assert_close(scene.texlets.normals.norm(dim=1), torch.ones(len(scene.texlets)))
    assert ((outwards / 0.05) * scene.texlets.normals).sum(1).min() > 0.95
    np.testing.assert_array_equal(scene.viewpoints, [[0.1, 0, 1.0]])
    assert scene.table is None
    assert any(note.startswith("voxels of 0.002 m") for note in scene.notes)


def test_the_same_seed_gives_the_same_texlets(cloud: Path) -> None:
    first, again, other = (read(seed, input=cloud, viewpoints=[[0.1, 0, 1.0]]) for seed in (1, 1, 2))
    torch.testing.assert_close(first.texlets.positions, again.texlets.positions, atol=0, rtol=0)
    assert other.texlets.positions.shape != first.texlets.positions.shape or (
        (other.texlets.positions != first.texlets.positions).any()
    )


def test_millimetres_in_the_file_metres_in_the_settings(cloud: Path, ball: Oriented, tmp_path: Path) -> None:
    up = ball[1][:, 2] > 0.2
    np.savez(tmp_path / "mm.npz", points=1000 * ball[0][up], viewpoints=[[100.0, 0, 1000]])
    by_file = read(input=tmp_path / "mm.npz", unit="mm")
    by_setting = read(input=cloud, viewpoints=[[0.1, 0, 1.0]])
    torch.testing.assert_close(by_file.texlets.positions, by_setting.texlets.positions, atol=1e-6, rtol=0)


def test_each_cloud_is_turned_to_its_own_viewpoint(ball: Oriented, tmp_path: Path) -> None:
    """Two halves seen from two sides, the second from far: together they make the ball."""
    points, normals = ball
    for name, side, eye in (("a", 1, 0.6), ("b", -1, 4.0)):
        half = normals[:, 0] * side > 0.2
        np.savez(tmp_path / f"{name}.npz", points=points[half], viewpoints=[[0.1 + side * eye, 0, 0.2]])
    scene = read(input=[tmp_path / "a.npz", tmp_path / "b.npz"])
    outwards = scene.texlets.positions - torch.tensor([0.1, 0, 0.2])
    assert (outwards[:, 0] > 0.02).any() and (outwards[:, 0] < -0.02).any()
    assert (outwards * scene.texlets.normals).sum(1).min() > 0.9 * 0.05
    assert len(scene.viewpoints) == 2


def test_a_crop_keeps_what_is_inside(cloud: Path) -> None:
    scene = read(input=cloud, viewpoints=[[0.1, 0, 1.0]], crop_low=[0.1, -1, -1], crop_high=[1, 1, 0.24])
    assert scene.texlets.positions[:, 0].min() >= 0.1
    assert scene.texlets.positions[:, 2].max() <= 0.24
    assert scene.notes[0].startswith("crop: ")
    outside = (scene.obstacles[:, 0] < 0.1) | (scene.obstacles[:, 2] > 0.24)
    assert len(scene.obstacles) > 100 and outside.all()


def test_a_mesh_is_seen_as_in_training(tray: trimesh.Trimesh, tmp_path: Path) -> None:
    tray.export(tmp_path / "tray.ply")
    mesh = trimesh.load_mesh(tmp_path / "tray.ply", process=False)
    cameras = surround(SENSING, mesh.bounds.mean(axis=0))
    expected = observe(mesh, cameras, SENSING, np.random.default_rng(0))
    scene = read(input=tmp_path / "tray.ply")
    torch.testing.assert_close(scene.texlets.positions, expected.positions)
    torch.testing.assert_close(scene.texlets.normals, expected.normals)
    assert len(scene.viewpoints) == 4
    above = read(input=tmp_path / "tray.ply", table=[0, 0, 1, 0.025])
    assert above.texlets.positions[:, 2].min() > -0.025 + 0.008 - 1e-6
    assert 0 < len(above.texlets) < len(expected)


def test_a_mesh_is_sampled_whole(tmp_path: Path) -> None:
    """A box of 60 mm in mm: every side has its texlets, the lower one too, which no camera sees."""
    trimesh.creation.box([60.0, 60, 60]).export(tmp_path / "box.stl")
    scene = read(input=tmp_path / "box.stl", unit="mm", mesh="whole")
    sides = scene.texlets.normals
    for axis in range(3):
        for sign in (-1, 1):
            on = sides[:, axis] * sign > 0.9
            assert on.sum() > 40
            torch.testing.assert_close(
                scene.texlets.positions[on][:, axis], torch.full((int(on.sum()),), sign * 0.03), atol=1e-3, rtol=0
            )
    assert scene.viewpoints is None


def test_notes_and_plane_of_a_scene_on_a_table(cloud: Path, tmp_path: Path) -> None:
    ball = np.load(cloud)
    table = np.column_stack([np.random.default_rng(0).random((8000, 2)) * 0.4 - [0.1, 0.2], np.full(8000, 0.15)])
    np.save(tmp_path / "scene.npy", np.concatenate([ball, table]))
    scene = read(input=tmp_path / "scene.npy", viewpoints=[[0.1, 0, 1.0]], table="find")
    np.testing.assert_allclose(scene.table, [0, 0, 1, -0.15], atol=1e-6)
    assert scene.texlets.positions[:, 2].min() > 0.155


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"viewpoints": [0, 0]}, "viewpoints: expected N x 3 finite numbers"),
        ({"viewpoints": [[0, 0, "a"]]}, "viewpoints: expected N x 3 numbers"),
        ({"viewpoints": [[0, 0, 700]]}, r"viewpoints: expected within 10 m of the points, got .* settings are in m"),
        ({"viewpoints": [[0.1, 0, 0.22]]}, "expected the viewpoint outside of the points"),
        (
            {"unit": "mm"},
            r"expected an extent of 0\.01 to 10 m, got 9\.783e-05 m with unit=mm; unit=m would fit",
        ),
        ({"crop_low": [1, 1, 1]}, r"expected points in the box, got none; they span x .* m with unit=m"),
        ({"crop_low": [1, 0, 0], "crop_high": [0, 1, 1]}, "crop_low: expected below crop_high"),
        ({"crop_low": [1, 0]}, "crop_low: expected 3 finite numbers"),
        ({"crop_high": "box"}, "crop_high: expected 3 numbers, got 'box'"),
        ({"max_points": 10}, r"ball.npy: expected at most 10 points \(max_points\)"),
        ({"mask": "m.png"}, "m.png: expected a file, got nothing there"),
        ({"mask": "m.png", "segments": "m.png"}, "mask: expected mask or segments, got both"),
        ({"poses": "T.txt"}, "poses: expected with depth images"),
        ({"stride": 2}, "stride: expected with depth images"),
        ({"intrinsics": "K.txt"}, r"ball.npy: expected a depth image \(H, W\), got \d+ points; leave intrinsics out"),
        ({"normal_radius": 0.001, "viewpoints": [[0, 0, 1]]}, "give a larger normal_radius"),
        ({"table": "find", "viewpoints": [[0, 0, 1]]}, "table: expected a plane with 20% of the points"),
    ],
)
def test_settings_that_do_not_fit(changes: dict, message: str, cloud: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(**{"input": cloud, **changes})
    assert "\n" not in str(caught.value)


def test_metres_that_are_millimetres(ball: Oriented, tmp_path: Path) -> None:
    np.save(tmp_path / "mm.npy", 1000 * ball[0])
    with pytest.raises(InputError, match=r"mm.npy: expected .* got 99.98 m with unit=m; unit=cm or unit=mm would fit"):
        read(input=tmp_path / "mm.npy", viewpoints=[[0, 0, 1]])
    trimesh.creation.box([60.0, 60, 60]).export(tmp_path / "box.stl")
    for mesh in ("whole", "sensed"):
        with pytest.raises(InputError, match="got 60 m with unit=m; unit=cm or unit=mm would fit"):
            read(input=tmp_path / "box.stl", mesh=mesh)
    trimesh.creation.box([0.06, 0.06, 0.06]).export(tmp_path / "m.stl")
    with pytest.raises(InputError, match=r"got 6e-05 m with unit=mm; unit=m would fit"):
        read(input=tmp_path / "m.stl", unit="mm")
    with pytest.raises(InputError, match=r"expected a mesh within 0\.7 m of its middle, .* got 1\.039 m with unit=m"):
        trimesh.creation.box([1.2, 1.2, 1.2]).export(tmp_path / "m.stl")
        read(input=tmp_path / "m.stl")


@pytest.mark.parametrize(
    ("points", "unit", "hint"),
    [
        (400.0, "m", "unit=cm or unit=mm would fit, if that is the file's, else crop_low and crop_high"),
        (50.0, "m", "unit=cm or unit=mm would fit"),
        (2e5, "m", "no unit would fit; give crop_low and crop_high"),
        (5e-4, "m", "no unit would fit"),
        (20.0, "cm", None),
        (0.2, "cm", "unit=m would fit, if that is the file's"),
        (0.2, "mm", "unit=m would fit, if that is the file's"),
        (3.0, "mm", "unit=m or unit=cm would fit, if that is the file's"),
    ],
)
def test_hints_of_units_are_true(points: float, unit: str, hint: str | None, ball: Oriented) -> None:
    """`points` is the extent of the cloud in the file; a unit is named only where it would fit, and all that do."""
    extent = points * METRES[unit]
    low, high = np.zeros(3), np.array([extent, extent / 2, extent / 3])
    config = settings(SceneConfig, unit=unit)
    if hint is None:
        check_extent("a.ply", low, high, config)
        return
    with pytest.raises(InputError) as caught:
        check_extent("a.ply", low, high, config)
    assert str(caught.value).split("; ", 1)[1].startswith(hint)


@pytest.mark.parametrize(
    ("low", "high", "hint"),
    [
        (
            [548e3, 542e4, 240],
            [548267, 5420267, 300],
            "the points lie 5.42e+06 m from the origin, as on a map: subtract",
        ),
        ([0, 0, 0], [255, 255, 0], "z is 0 throughout: an image, not a surface"),
        ([3, 3, 3], [3, 3, 3], "all points lie in one place"),
    ],
)
def test_no_unit_mends_a_map_or_an_image(low: list[float], high: list[float], hint: str) -> None:
    with pytest.raises(InputError, match=re.escape(hint)) as caught:
        check_extent("a.pcd", np.array(low, float), np.array(high, float), settings(SceneConfig))
    assert "would fit" not in str(caught.value)


def test_bad_meshes(tray: trimesh.Trimesh, tmp_path: Path) -> None:
    inverted = trimesh.creation.box([0.06] * 3)
    inverted.invert()
    inverted.export(tmp_path / "inverted.stl")
    with pytest.raises(InputError, match="expected normals pointing outwards, got an inverted mesh"):
        read(input=tmp_path / "inverted.stl", mesh="whole")
    (tmp_path / "lines.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(InputError, match=r"lines\.obj: expected a mesh with faces, got none"):
        read(input=tmp_path / "lines.obj")
    (tmp_path / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="expected finite vertices, got 1 of 3"):
        read(input=tmp_path / "nan.obj")
    tray.export(tmp_path / "tray.glb")
    whole = (tmp_path / "tray.glb").read_bytes()
    (tmp_path / "tray.glb").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"expected a .glb mesh, got a damaged file"):
        read(input=tmp_path / "tray.glb")
    with pytest.raises(InputError, match="expected a file, got nothing there"):
        read(input=tmp_path / "none.stl")
    with pytest.raises(InputError, match="input: expected one mesh or several clouds, got 2 meshes in 2 files"):
        read(input=[tmp_path / "inverted.stl"] * 2)


@pytest.mark.parametrize(
    ("points", "normals", "message"),
    [
        (np.full((4, 3), np.nan), None, "live: expected points, got none: all 4 are NaN, infinite or 0 0 0"),
        (
            5e5 + 0.01 * np.arange(60).reshape(20, 3),
            np.tile([0.0, 0, 1], (20, 1)),
            "live: expected points within 1000 m",
        ),
        (np.zeros((0, 3)), None, "live: expected points, got none"),
        (np.zeros((4, 2)), None, r"live: expected points of shape \(N, 3\), got \(4, 2\)"),
        (np.zeros((4, 3)), np.ones((3, 3)), r"live: expected normals of shape \(4, 3\), got \(3, 3\)"),
    ],
)
def test_arrays_are_checked_as_files_are(points: np.ndarray, normals: np.ndarray | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        texlets_of(Cloud(points, normals, None, "live"), settings(SceneConfig), SENSING, np.random.default_rng(0))


def test_a_depth_image_of_another_size_than_its_camera() -> None:
    with pytest.raises(InputError, match=r"depth image: expected 6 x 8 pixels, got \(8, 6\)"):
        views = [View(np.ones((8, 6)), Camera(np.eye(3), np.eye(4), 8, 6))]
        scene_of_views(views, settings(SceneConfig), SENSING, np.random.default_rng(0))


@pytest.mark.parametrize("given", [None, [], 3, ["a.ply", 4]])
def test_input_must_be_files(given: object) -> None:
    with pytest.raises(InputError, match=r"input: expected .*, got"):
        read_scene(settings(SceneConfig, input=given), SENSING, np.random.default_rng(0))


def test_a_folder_for_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a file, got a folder"):
        read(input=tmp_path)
