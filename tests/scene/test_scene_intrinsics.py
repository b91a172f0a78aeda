"""Intrinsics and poses as cameras, ROS, BOP, Open3D and this field's networks write them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from spgf_torch.errors import InputError
from spgf_torch.scene.intrinsics import Intrinsics, read_intrinsics
from spgf_torch.scene.poses import read_poses

K = np.array([[300.0, 0, 159.5], [0, 310, 119.5], [0, 0, 1]])
FLAT = K.ravel().tolist()
P = [300.0, 0, 159.5, 0, 0, 310, 119.5, 0, 0, 0, 1, 0]
NAMED = {"fx": 300.0, "fy": 310.0, "cx": 159.5, "cy": 119.5, "width": 320, "height": 240}
LOST = "A message was lost!!!\n\ttotal count change:1\n\ttotal count: 1---\n"
OPENCV = f"!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {FLAT}"


def block(name: str, values: list[float]) -> str:
    return f"{name}:\n" + "".join(f"- {value}\n" for value in values)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("four.txt", "# fx fy cx cy\n300 310 159.5 119.5\n"),
        ("four.json", "[300, 310, 159.5, 119.5]"),
        ("printed.txt", str(K)),
        ("assigned.txt", "fx = 300\nfy = 310\ncx = 159.5\ncy = 119.5\n"),
        ("json.txt", json.dumps(NAMED)),
        ("text.json", "300 0 159.5\n0 310 119.5\n0 0 1\n"),
        ("phoxi.intr", json.dumps({f"_{key}": value for key, value in NAMED.items()} | {"_skew": 0.0, "_K": 0})),
        ("words.json", json.dumps({key: str(value) for key, value in NAMED.items()})),
        ("ros2_echo.txt", "height: 240\nwidth: 320\n" + block("k", FLAT) + block("p", P) + "---\nheight: 1\n---\n"),
        ("lost.yaml", LOST + f"k: {FLAT}\n---\n"),
        ("tabs.yaml", f"K:\t{FLAT}\nwidth:\t320\n"),
        ("anchors.yaml", f"first: &k {FLAT}\nK: *k\n"),
        ("opencv.yml", f"%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\ncamera_matrix: {OPENCV}\n"),
        ("zero.yaml", f"K: {[0.0] * 9}\nP: {P}\n"),
        ("camera.json", json.dumps({"camera": {"intrinsics": NAMED}})),
        ("one_of_a_scene.json", json.dumps({"7": {"cam_K": FLAT}})),
    ],
)
def test_formats(name: str, content: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    np.testing.assert_array_equal(read_intrinsics(tmp_path / name).K, K)


def test_matlab_and_numpy(tmp_path: Path) -> None:
    """GraspNet's meta.mat, with its counts a metre; arrays of objects beside them stay closed."""
    meta = {"intrinsic_matrix": K, "factor_depth": np.array([[1000]]), "poses": np.zeros((3, 4, 50)), "who": {"a": 1}}
    scipy.io.savemat(tmp_path / "meta.mat", meta, do_compression=True)
    given = read_intrinsics(tmp_path / "meta.mat")
    np.testing.assert_array_equal(given.K, K)
    assert given.depth_scale == 0.001
    np.savez(tmp_path / "K.npz", K=K, rgb=np.zeros((4, 4, 3)))
    np.save(tmp_path / "K.npy", K[None])
    for name in ("K.npz", "K.npy"):
        np.testing.assert_array_equal(read_intrinsics(tmp_path / name).K, K)
    (tmp_path / "cut.mat").write_bytes((tmp_path / "meta.mat").read_bytes()[:200])
    scipy.io.savemat(tmp_path / "none.mat", {"a": K})
    for name, message in (("cut.mat", "expected a MATLAB file, got a damaged"), ("none.mat", "K or intrinsic_matrix")):
        with pytest.raises(InputError, match=message):
            read_intrinsics(tmp_path / name)


@pytest.mark.parametrize(
    ("values", "notes"),
    [
        ({"K": FLAT, "P": P}, ()),
        ({"K": FLAT, "P": [0.0] * 12}, ()),
        ({"K": [330, 0, 159.5, 0, 310, 119.5, 0, 0, 1], "P": P}, (r"P taken, .* \(focal length by 10%",)),
        ({"P": P}, ("K is 0 or missing",)),
        ({"K": FLAT, "D": [0.78, -2.98, 0, 0, 0]}, (r"distortion \(coefficients up to 2.98\) is not undone",)),
        ({"K": FLAT, "extrinsic": np.eye(4).tolist()}, ("the extrinsic beside K is not used; give poses=",)),
    ],
)
def test_what_is_told(values: dict, notes: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "K.json").write_text(json.dumps(values))
    given = read_intrinsics(tmp_path / "K.json")
    np.testing.assert_allclose(given.K, K)
    assert len(given.notes) == len(notes)
    for note, told in zip(notes, given.notes, strict=True):
        assert re.search(note, told)


@pytest.mark.parametrize(
    ("key", "value", "scale"),
    [
        ("depth_scale", 0.1, 1e-4),  # BOP: mm a count
        ("depth_scale", 1.0, 1e-3),
        ("depth_scale", 1000.0, 1e-3),  # Open3D: counts a metre
        ("depth_scale", 5000, 2e-4),  # TUM
        ("depth_scale", 0.00025, 2.5e-4),  # RealSense: m a count
        ("depth_units", 0.0001, 1e-4),
        ("depth_units", "mm", 1e-3),
        ("factor_depth", 10000, 1e-4),  # YCB-Video: counts a metre
        ("depth_scale", 30, None),
        ("depth_scale", "far", None),
        ("depth_scale", -1, None),
    ],
)
def test_depth_scales_are_told_apart(key: str, value: object, scale: float | None, tmp_path: Path) -> None:
    for values in ({**NAMED, key: value}, {"depth": {"intrinsics": NAMED, key: value}}):
        (tmp_path / "K.json").write_text(json.dumps(values))
        given = read_intrinsics(tmp_path / "K.json")
        assert given.depth_scale == (scale if scale is None else pytest.approx(scale))
        assert len(given.notes) == 1
        assert key in given.notes[0]


def test_the_camera_of_an_image_of_a_scene(tmp_path: Path) -> None:
    """BOP's scene_camera.json: chosen by the image's number, or all the same."""
    scene = {str(i): {"cam_K": [300 + i, *FLAT[1:]], "depth_scale": 0.1} for i in range(12)}
    path = tmp_path / "scene_camera.json"
    path.write_text(json.dumps(scene))
    assert read_intrinsics(path, Path("depth/000011.png")).K[0, 0] == 311
    for image in (Path("depth/000012.png"), Path("depth.png"), None):
        with pytest.raises(InputError, match=r"named by its number, one of 0, 1, 2, 3, 4, \.\.\.; got"):
            read_intrinsics(path, image)
    path.write_text(json.dumps({str(i): scene["0"] for i in range(12)}))
    assert read_intrinsics(path).K[0, 0] == 300


def test_binning_and_roi() -> None:
    """image_geometry: pixel u of the full image is (u - x_offset) / binning of the smaller."""
    full = Intrinsics(K, (320, 240), roi=(40, 20, 160, 120), binning=(2, 2))
    cut = full.of_image(80, 60, "d")
    np.testing.assert_allclose(cut.K, [[150, 0, (159.5 - 40) / 2], [0, 155, (119.5 - 20) / 2], [0, 0, 1]])
    assert "80 x 60" in cut.notes[0]
    assert full.of_image(320, 240, "d") is full
    with pytest.raises(InputError, match="K of an image of 160 x 120 pixels, got one of 320 x 240 or 80 x 60"):
        full.of_image(160, 120, "d")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"fx": 0.9, "fy": 1.2, "cx": 0.5, "cy": 0.5}, "expected K in pixels, got focal lengths of 0.9 and 1.2"),
        ({"K": FLAT, "roi": {"x_offset": -1, "width": 5}}, "roi: expected whole numbers"),
        ({"K": [FLAT, 1, [2]]}, "expected a matrix of numbers"),
        ({"K": FLAT, "binning_x": 1.5}, "expected whole numbers binning_x, binning_y; got"),
        ({"parameters": [{"intrinsic": NAMED}, {"intrinsic": {**NAMED, "fx": 2}}]}, "expected one camera, got 2"),
    ],
)
def test_refused(content: dict, message: str, tmp_path: Path) -> None:
    (tmp_path / "K.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        read_intrinsics(tmp_path / "K.json")


T = np.array([[0.0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]])
HALF = 0.5**0.5


def line(values: np.ndarray) -> str:
    return " ".join(map(str, values.ravel())) + "\n"


def open3d(matrix: np.ndarray) -> str:
    camera = {"class_name": "PinholeCameraParameters", "extrinsic": np.linalg.inv(matrix).T.ravel().tolist()}
    return json.dumps({"class_name": "PinholeCameraTrajectory", "parameters": [camera, camera]})


@pytest.mark.parametrize(
    ("name", "content", "count", "note"),
    [
        ("a.txt", "".join(map(line, T[:3])), 1, ""),
        ("a.txt", "".join(map(line, np.concatenate([T[:3]] * 4))), 4, ""),
        ("a.txt", "".join(map(line, np.concatenate([T] * 3))), 3, ""),
        ("kitti.txt", line(T[:3]) * 2, 2, ""),
        ("a.txt", line(T), 1, ""),
        ("tum.txt", f"# t x y z q\n17.5 0.1 0.2 0.3 0 0 {HALF} {HALF}\n", 1, r"taken for \[t\] x y z qx qy qz qw"),
        ("a.txt", f"0.1 0.2 0.3 0 0 {HALF} {HALF}\n" * 2, 2, "lines of 7 numbers taken for x y z qx qy qz qw"),
        ("a.log", "0 0 1\n" + "".join(map(line, T)) + "1 1 2\n" + "".join(map(line, T)), 2, "Redwood"),
        ("a.json", open3d(T), 2, "the inverse of Open3D's extrinsics"),
    ],
)
def test_poses(name: str, content: str, count: int, note: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    poses, notes = read_poses([tmp_path / name])
    np.testing.assert_allclose(poses, [T] * count, atol=1e-12)
    assert len(notes) == bool(note)
    assert not note or re.search(note, notes[0])


@pytest.mark.parametrize("array", [T[:3], np.stack([T[:3]] * 4), np.stack([T] * 4)])
def test_poses_of_numpy(array: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "T.npy", array)
    poses, _ = read_poses([tmp_path / "T.npy"])
    np.testing.assert_array_equal(poses, [T] * (1 if array.ndim == 2 else 4))
