"""Depth images, K, poses and masks from files; the surface they show; what is refused."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from PIL import Image

from spgf_torch.errors import InputError
from spgf_torch.scene.arrays import view_of_arrays
from spgf_torch.scene.assembly import read_scene, scene_of_views
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth import camera_of, every, learned_stride
from spgf_torch.scene.depth_files import in_metres, read_depth_file
from spgf_torch.scene.intrinsics import Intrinsics, read_intrinsics
from spgf_torch.scene.labels import read_mask
from spgf_torch.scene.poses import read_poses
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.views import View, read_views
from spgf_torch.sensing.cameras import Camera, cast, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.texlets import extract
from spgf_torch.sensing.unseen import behind
from spgf_torch.settings import settings

SENSING = settings(SensingConfig)
K = np.array([[280.0, 0, 49.5], [0, 290.0, 39.5], [0, 0, 1]])
SIZE = {"width": 100, "height": 80}


@pytest.fixture(scope="module")
def images(tray) -> list[tuple[np.ndarray, Camera]]:  # type: ignore[no-untyped-def]
    """The tray seen from two sides, depth in whole millimetres."""
    views = []
    for eye in ([0.4, 0.3, 0.4], [-0.4, 0.3, 0.4]):
        camera = Camera(K, look_at(np.array(eye), np.zeros(3)), 100, 80)
        views.append((0.001 * (1000 * cast(tray, camera)[0]).round(), camera))
    return views


def save(folder: Path, views: list[tuple[np.ndarray, Camera]], **changes: object) -> SceneConfig:
    """The images as 16-bit .png in mm, K as text, all poses as one JSON; settings that name them."""
    names = []
    for i, (depth, _) in enumerate(views):
        names.append(str(folder / f"{i}.png"))
        Image.fromarray((depth * 1000).round().astype(np.uint16)).save(names[-1])
    np.savetxt(folder / "K.txt", K)
    (folder / "poses.json").write_text(json.dumps([camera.T_object_camera.tolist() for _, camera in views]))
    given = {"input": names, "intrinsics": str(folder / "K.txt"), "poses": str(folder / "poses.json"), **changes}
    return settings(SceneConfig, **given)


def read(config: SceneConfig) -> Scene:
    return read_scene(config, SENSING, np.random.default_rng(5))


def test_texlets_equal_those_of_sensing(images: list[tuple[np.ndarray, Camera]], tmp_path: Path) -> None:
    expected = extract(images, SENSING, np.random.default_rng(5))
    scene = read(save(tmp_path, images, stride=1))
    assert len(expected) > 200
    torch.testing.assert_close(scene.texlets.positions, expected.positions, atol=1e-6, rtol=0)
    torch.testing.assert_close(scene.texlets.normals, expected.normals, atol=1e-5, rtol=0)
    np.testing.assert_allclose(scene.viewpoints, sorted(c.T_object_camera[:3, 3].tolist() for _, c in images))
    assert scene.table is None
    assert not len(scene.obstacles)


def test_npy_in_millimetres_and_png_are_alike(images: list[tuple[np.ndarray, Camera]], tmp_path: Path) -> None:
    by_png = read(save(tmp_path, images[:1]))
    np.save(tmp_path / "d.npy", (images[0][0] * 1000).round())
    by_npy = read(save(tmp_path, images[:1], input=str(tmp_path / "d.npy"), unit="mm"))
    torch.testing.assert_close(by_npy.texlets.positions, by_png.texlets.positions, atol=1e-6, rtol=0)


def test_a_turned_camera_by_hand(tmp_path: Path) -> None:
    """A camera at (1, 2, 3) that looks along the input's +x, its image's right along -y and down along -z: the columns
    of its rotation are where its own axes x (right), y (down), z (forward) point. It sees a wall 0.5 m ahead, so at
    x = 1.5, whose normal is -x. The pixel right of the middle by 10 of fx = 280 lies at y = 2 - 0.5 * 10 / 280."""
    T = np.array([[0.0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 3], [0, 0, 0, 1]])
    depth = np.zeros((80, 100))
    depth[:, 50:60] = 0.5
    np.save(tmp_path / "left.npy", np.arange(100) < np.full((80, 1), 55))
    wall = save(tmp_path, [(depth, Camera(K, T, 100, 80))], stride=1, voxel=0.0005, mask=str(tmp_path / "left.npy"))
    scene = read(wall)
    assert scene.no_grasp is not None and "one plane" in scene.no_grasp
    np.testing.assert_allclose(scene.texlets.positions[:, 0], 1.5, atol=1e-5)
    np.testing.assert_allclose(scene.texlets.normals, np.tile([-1.0, 0, 0], (len(scene.texlets), 1)), atol=1e-5)
    y, z = scene.obstacles[:, 1], scene.obstacles[:, 2]
    np.testing.assert_allclose([y.max(), y.min()], [2 - 0.5 * 5.5 / 280, 2 - 0.5 * 9.5 / 280], atol=1e-5)
    np.testing.assert_allclose([z.max(), z.min()], [3 + 0.5 * 39.5 / 290, 3 - 0.5 * 39.5 / 290], atol=1e-5)
    np.testing.assert_array_equal(scene.viewpoints, [[1, 2, 3]])
    assert scene.views is not None  # of the whole image, whatever the mask
    places = torch.tensor([[1.6, y.min(), 3], [1.4, y.min(), 3], [1.5, 2.4, 3]])
    np.testing.assert_allclose(behind(places, scene.views), [0.1, -0.1, np.inf], atol=1e-5)


def test_without_a_pose_the_frame_is_the_camera(images: list[tuple[np.ndarray, Camera]], tmp_path: Path) -> None:
    still = read(save(tmp_path, images[:1], poses=None))
    T = torch.from_numpy(images[0][1].T_object_camera).float()
    moved = read(save(tmp_path, images[:1]))
    torch.testing.assert_close(
        moved.texlets.positions, still.texlets.positions @ T[:3, :3].T + T[:3, 3], atol=1e-5, rtol=0
    )
    assert still.texlets.positions[:, 2].min() > 0.4


def test_a_mask_and_a_crop_keep_their_part(images: list[tuple[np.ndarray, Camera]], tmp_path: Path) -> None:
    mask = np.zeros((80, 100), np.uint8)
    mask[:, :50] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    masked = read(save(tmp_path, images[:1], poses=None, mask=str(tmp_path / "mask.png")))
    cropped = read(save(tmp_path, images[:1], poses=None, crop_high=[0, 9, 9], crop_low=[-1, -1, 0]))
    assert masked.texlets.positions[:, 0].max() < 0.003
    assert cropped.texlets.positions[:, 0].max() <= 0
    assert any(note.startswith("crop: ") for note in cropped.notes)
    for name, pixels in (("a.npy", mask > 0), ("b.png", np.stack([mask] * 3, axis=-1))):
        np.save(tmp_path / name, pixels) if name == "a.npy" else Image.fromarray(pixels).save(tmp_path / name)
        np.testing.assert_array_equal(read_mask(tmp_path / name, 10**6), mask > 0)


def test_sixteen_bits_survive(tmp_path: Path) -> None:
    """Every value of 16 bits; the highest means that nothing was measured."""
    counts = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    Image.fromarray(counts).save(tmp_path / "d.png")
    depth, _ = in_metres(read_depth_file(tmp_path / "d.png", 10**6), 0.0002, "m", None)
    np.testing.assert_allclose(depth.ravel()[:-1], 0.0002 * np.arange(65535))
    assert depth[-1, -1] == 0


def test_every_second_pixel() -> None:
    """Pixel u of the smaller image is pixel 2 u of the larger: its ray is the same."""
    camera = Camera(K, np.eye(4), 7, 5)
    fewer, seen_by = every(np.arange(35.0).reshape(5, 7), camera, 2)
    np.testing.assert_array_equal(fewer, [[0, 2, 4, 6], [14, 16, 18, 20], [28, 30, 32, 34]])
    np.testing.assert_allclose(seen_by.rays(), camera.rays()[::2, ::2])


def test_the_stride_makes_pixels_as_far_apart_as_learned() -> None:
    """Learned at 0.7 / 288 = 2.4 mm. A 640 x 480 camera of f = 575 at 0.7 m: 1.2 mm, so every second; at 1.4 m each."""
    strides = [learned_stride(np.full(9, z), np.diag([575.0, 575, 1]), SENSING) for z in (0.35, 0.7, 1.4, 5.0)]
    assert strides == [4, 2, 1, 1]


def test_the_stride_suits_what_is_in_the_crop_box() -> None:
    """A wall at 3 m behind a plate at 0.35 m: alone the wall counts, as most pixels show it, in the box the plate."""
    depth = np.full((80, 120), 3.0)
    depth[:30] = 0.35
    camera = Camera(np.array([[575.0, 0, 59.5], [0, 575.0, 39.5], [0, 0, 1]]), np.eye(4), 120, 80)
    whole, near = (
        scene_of_views([View(depth, camera)], settings(SceneConfig, **box), SENSING, np.random.default_rng(0)).notes[0]
        for box in ({}, {"crop_high": [1.0, 1.0, 1.0]})
    )
    assert near == "stride: every 4 pixels of the depth images" and not whole.startswith("stride")  # every pixel


ROS = {"image_width": 100, "image_height": 80, "camera_matrix": {"rows": 3, "cols": 3, "data": K.ravel().tolist()}}


@pytest.mark.parametrize(
    ("name", "content", "stated"),
    [
        ("K.txt", "280 0 49.5\n0 290 39.5\n0 0 1\n", False),
        ("K.csv", "# pixels\n280,0,49.5\n0,290,39.5\n0,0,1", False),
        ("K.txt", "280 0 49.5 0 290 39.5 0 0 1", False),
        ("K.json", json.dumps(K.tolist()), False),
        ("K.json", json.dumps({"K": K.tolist()}), False),
        ("K.json", json.dumps({"intrinsic_matrix": K.T.ravel().tolist(), **SIZE}), True),
        ("K.json", json.dumps({"fx": 280, "fy": 290, "ppx": 49.5, "ppy": 39.5, **SIZE}), True),
        ("K.json", json.dumps({"fx": 280, "fy": 290, "cx": 49.5, "cy": 39.5}), False),
        ("K.yaml", yaml.safe_dump(ROS), True),
        ("K.yml", yaml.safe_dump({"k": K.ravel().tolist(), "d": [0.0], **SIZE}), True),
    ],
)
def test_intrinsics(name: str, content: str, stated: bool, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    given = read_intrinsics(tmp_path / name)
    np.testing.assert_array_equal(given.K, K)
    assert given.notes == ()
    assert given.size == ((100, 80) if stated else None)


def test_poses(tmp_path: Path) -> None:
    first, second = look_at(np.array([1.0, 0, 1]), np.zeros(3)), np.eye(4)
    np.savetxt(tmp_path / "both.txt", np.concatenate([first, second]))
    np.save(tmp_path / "both.npy", np.stack([first, second]))
    (tmp_path / "both.json").write_text(json.dumps({"T_input_camera": [first.tolist(), second.tolist()]}))
    np.savetxt(tmp_path / "one.txt", first)
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(second.tolist()))
    for names in (["both.txt"], ["both.npy"], ["both.json"], ["one.txt", "two.yaml"]):
        np.testing.assert_allclose(read_poses([tmp_path / name for name in names])[0], [first, second])


def matrix(**entries: float) -> str:
    changed = K.copy()
    for place, value in entries.items():
        changed[int(place[1]), int(place[2])] = value
    return json.dumps(changed.tolist())


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("K.txt", "1 2\n3 4\n5 6\n", r"expected K with 3 x 3 numbers, or fx fy cx cy; got shape \(3, 2\)"),
        ("K.txt", "1 2 3\n4 5\n", "expected a matrix of numbers, got"),
        ("K.txt", "a b c\n", "expected numbers as text, JSON, YAML or .npy, got could not convert"),
        ("K.json", matrix(k00=float("nan")), "expected K with finite numbers"),
        ("K.json", matrix(k00=0), "expected focal lengths above 0 in K, got 0 and 290"),
        ("K.json", matrix(k11=-290), "expected focal lengths above 0 in K, got 280 and -290"),
        ("K.json", matrix(k22=2), "expected K = fx s cx; 0 fy cy; 0 0 1, got"),
        ("K.json", '{"K": [[280, 0', "expected numbers as text, JSON, YAML or .npy"),
        (
            "K.json",
            '{"D": [0]}',
            "expected one of camera_matrix, K, k, intrinsic_matrix, cam_K or fx, fy, cx, cy; got D",
        ),
        ("K.json", '{"K": "calib"}', "expected a matrix of numbers, got calib"),
        ("K.yaml", "camera_matrix: {rows: 3", "expected numbers as text, JSON, YAML or .npy"),
        ("K.yaml", "camera_matrix: {rows: 3}", "expected one of camera_matrix, .* got camera_matrix"),
        ("K.yaml", "K: !!python/object/apply:os.getcwd []", "expected numbers as text, JSON, YAML or .npy"),
        ("K.txt", "", "expected data, got an empty file"),
    ],
)
def test_bad_intrinsics(name: str, content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        read_intrinsics(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_K_of_another_size_is_told() -> None:  # noqa: N802
    """By the file's own size, or by a principal point far from the image's middle; a stated cut-out may have one."""
    depth = np.ones((80, 100))
    assert camera_of(depth, Intrinsics(K, (100, 80)), np.eye(4), "d")[0].width == 100
    with pytest.raises(InputError, match="d: expected K of an image of 100 x 80 pixels, got one of 200 x 160"):
        camera_of(depth, Intrinsics(K, (200, 160)), np.eye(4), "d")
    twice = np.diag([2.0, 2, 1]) @ K
    with pytest.raises(InputError, match=r"100 x 80 pixels, got the principal point \(99, 79\) far from its middle"):
        camera_of(depth, Intrinsics(twice), np.eye(4), "d")
    with pytest.raises(InputError, match="principal point"):
        camera_of(depth, Intrinsics(np.diag([0.5, 0.5, 1]) @ K), np.eye(4), "d")
    camera_of(depth, Intrinsics(twice, (100, 80)), np.eye(4), "d")


def png(pixels: np.ndarray) -> Callable[[Path], None]:
    return lambda path: Image.fromarray(pixels).save(path)


def half(path: Path) -> None:
    Image.fromarray(np.random.default_rng(0).integers(0, 65535, (80, 100)).astype(np.uint16)).save(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("d.png", png(np.ones((8, 8), np.uint8)), "expected 16 bits and one channel, got 8 bits and 1 channels"),
        ("d.png", png(np.ones((8, 8, 3), np.uint8)), "expected 16 bits and one channel, got 8 bits and 3 channels"),
        ("d.png", half, "expected a whole image, got a damaged one"),
        ("d.png", lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n"), "expected a whole image, got a damaged one"),
        ("d.npy", lambda path: np.save(path, np.ones((8, 8), np.uint8)), "expected floats or whole numbers of 16 bits"),
        ("d.npy", lambda path: np.save(path, np.ones((8, 8), bool)), "expected floats or whole numbers of 16 bits"),
        (
            "d.npz",
            lambda path: np.savez(path, K=np.eye(3)),
            r"expected an array named depth of shape .*, got K \(3, 3\)",
        ),
        ("d.tiff", png(np.ones((8, 8), np.uint8)), "expected 16 bits and one channel, got 8 bits"),
        ("d.pgm", lambda path: path.write_bytes(b"P5 8 8 255\n" + bytes(64)), "got a PGM of values up to 255"),
        (
            "d.pgm",
            lambda path: path.write_bytes(b"P5 8 8 65535\n" + bytes(64)),
            "expected 8 x 8 pixels, got 32: .* cut",
        ),
        ("d.npy", lambda path: np.save(path, np.ones((8, 8, 2))), r"expected a depth image \(H, W\), .* got shape"),
        ("d.npy", lambda path: path.write_bytes(b"\x93NUMPY\x01"), "expected a whole numpy file"),
        ("d.npy", lambda path: np.save(path, np.array([{}])), "got pickled Python objects"),
        ("d.pcd", lambda path: path.write_text("x"), "expected a depth image .*, since intrinsics are given; got .pcd"),
    ],
)
def test_bad_images(name: str, write: Callable[[Path], None], message: str, tmp_path: Path) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match=message) as caught:
        read_depth_file(tmp_path / name, 10**6)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


TURN = np.eye(4) + 0.1 * np.eye(4, k=1)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.eye(3).tolist(), r"expected camera poses of 4 x 4 or 3 x 4 numbers.* got shape \(3, 3\)"),
        (np.eye(4)[:2].tolist(), "expected camera poses of 4 x 4 or 3 x 4 numbers"),
        ([[0, 0, 0, 0, 0, 0, 2]], "expected unit quaternions qx qy qz qw at the ends of the lines"),
        (TURN.tolist(), "expected a rotation, a translation and 0 0 0 1"),
        (np.diag([1.0, 1, -1, 1]).tolist(), "expected a rotation"),
        (np.full((4, 4), float("inf")).tolist(), "expected a rotation"),
        ({"extrinsic": np.eye(4).tolist()}, "expected a key T_input_camera, got extrinsic"),
    ],
)
def test_bad_poses(content: object, message: str, tmp_path: Path) -> None:
    (tmp_path / "T.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        read_poses([tmp_path / "T.json"])


FAR = np.eye(4)
FAR[0, 3] = 400.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"intrinsics": None, "poses": None},
            "intrinsics: expected the file of K for the depth image .*0.png, got none",
        ),
        ({"intrinsics": ["K.txt"] * 3}, r"intrinsics: expected one file, or one a depth image \(2\), got 3"),
        ({"poses": None}, "poses: expected T_input_camera of each of the 2 depth images, got none"),
        ({"poses": ["one.npy"]}, r"poses: expected one a depth image \(2\), got 1"),
        ({"poses": ["one.npy", "far.npy"]}, "poses: expected cameras within 10 m of the origin, got 400; mm"),
        ({"mask": ["small.png"]}, r"mask: expected one file a depth image \(2\), got 1"),
        ({"mask": ["small.png"] * 2}, r"small.png: expected \(80, 100\) pixels as .*0.png has, got \(8, 9\)"),
        ({"mask": ["empty.png"] * 2}, "empty.png: expected pixels above 0, which mark the target; got none"),
        ({"depth_scale": 1.0}, r"0.png: expected a median depth of 0\.01 to 10 m, got \d+ m; another depth_scale"),
        ({"depth_scale": 1e-6}, r"0.png: expected a median depth of 0\.01 to 10 m, got 0.000\d+ m"),
        ({"max_points": 100}, r"expected at most 100 pixels \(max_points\)"),
        ({"viewpoints": [[0, 0, 1]]}, "viewpoints: expected with point clouds only"),
        ({"crop_low": [5, 5, 5]}, "crop_low, crop_high: expected points in the box, got none; they span x"),
        ({"stride": 0}, "stride: expected a whole number from 1, got 0"),
        ({"stride": 50}, "expected surfaces of 5 x 5 pixels in the depth images, got none"),
    ],
)
def test_settings_that_do_not_fit(
    changes: dict, message: str, images: list[tuple[np.ndarray, Camera]], tmp_path: Path
) -> None:
    np.save(tmp_path / "one.npy", np.eye(4))
    np.save(tmp_path / "far.npy", FAR)
    Image.fromarray(np.ones((8, 9), np.uint8)).save(tmp_path / "small.png")
    Image.fromarray(np.zeros((80, 100), np.uint8)).save(tmp_path / "empty.png")
    there = {
        key: [str(tmp_path / v) if isinstance(v, str) else v for v in value] if isinstance(value, list) else value
        for key, value in changes.items()
    }
    with pytest.raises(InputError, match=message) as caught:
        read(save(tmp_path, images, **there))
    assert "\n" not in str(caught.value)


def test_a_cloud_with_intrinsics_is_told_not_its_viewpoint(tmp_path: Path) -> None:
    cloud = tmp_path / "cloud.ply"
    cloud.write_text("ply\n")
    config = settings(SceneConfig, input=str(cloud), intrinsics=[100, 100, 50, 40], viewpoints=[[0, 0, 0]])
    with pytest.raises(InputError, match=r"cloud\.ply: expected a depth image .* got .ply .*leave intrinsics out"):
        read(config)


@pytest.mark.parametrize(("scale", "taken"), [(None, 0.0002), (0.001, 0.001)])
def test_a_view_knows_what_its_counts_were_taken_for(
    scale: float | None, taken: float, images: list[tuple[np.ndarray, Camera]], tmp_path: Path
) -> None:
    """What other scales are offered against: that of the camera's file, unless the setting says another."""
    config = save(tmp_path, images[:1], depth_scale=scale)
    (tmp_path / "K.json").write_text(json.dumps({"cam_K": K.ravel().tolist(), "depth_scale": 0.2}))
    one = replace(config, intrinsics=str(tmp_path / "K.json"), poses=None)
    assert [view.scale for view in read_views([tmp_path / "0.png"], one)] == [pytest.approx(taken)]
    lengths = view_of_arrays(images[0][0], K)
    assert lengths.scale is None and view_of_arrays((1000 * images[0][0]).astype(np.int32), K).scale == 0.001
