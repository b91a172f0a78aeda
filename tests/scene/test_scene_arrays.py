"""Clouds and depth images in memory are treated as those in files; depth files and what marks targets in them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from spgf_torch.errors import InputError
from spgf_torch.scene.arrays import cloud_of_arrays, view_of_arrays
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth_files import is_depth
from spgf_torch.scene.files import read_cloud
from spgf_torch.scene.views import read_views
from spgf_torch.settings import settings

P = np.random.default_rng(0).random((40, 3)) * 0.3 + 0.1
K = np.array([[60.0, 0, 24.5], [0, 60, 19.5], [0, 0, 1]])
D = np.full((40, 50), 0.6)
D[10:20, 10:30] = 0.5
MM = (1000 * D).astype(np.uint16)
SEGMENTS = np.zeros((40, 50), np.int64)
SEGMENTS[10:20, 10:20], SEGMENTS[10:20, 20:30], SEGMENTS[0] = 7, 9, -1


@pytest.mark.parametrize("shape", [(40, 3), (5, 8, 3)])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0])
def test_arrays_and_files_are_alike(shape: tuple[int, ...], bad: float, tmp_path: Path) -> None:
    points = P.copy()
    points[[3, 17]] = bad
    points = points.reshape(shape)
    np.save(tmp_path / "a.npy", points)
    of_file = read_cloud(tmp_path / "a.npy", 100)
    for values in (points, torch.from_numpy(points), points.tolist()):
        cloud = cloud_of_arrays(values, viewpoints=(0, 0, 1), labels=np.arange(40).reshape(shape[:-1]))
        np.testing.assert_array_equal(cloud.points, of_file.points)
        assert cloud.notes == of_file.notes
        np.testing.assert_array_equal(cloud.viewpoints, [[0, 0, 1]])
        np.testing.assert_array_equal(cloud.labels, np.delete(np.arange(40), [3, 17]))
        if len(shape) == 3:
            np.testing.assert_array_equal(cloud.pixels, np.stack(np.divmod(cloud.labels, 8), axis=1))
        else:
            assert cloud.pixels is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"points": np.ones((3, 600))}, r"live: expected shape \(N, 3\) or \(H, W, 3\), got \(3, 600\); transpose it"),
        ({"points": [["a", "b", "c"]]}, "live: expected an array of numbers, got list"),
        ({"points": [[1, 2, 3], [4, 5]]}, "live: expected an array of numbers, got list"),
        ({"points": P, "normals": P[:5]}, "live: expected points and normals of one shape"),
        ({"points": P, "labels": np.ones(7)}, r"live: labels: expected \(40,\) values as the cloud has, got \(7,\)"),
        ({"points": P, "labels": np.zeros(40)}, "live: labels: expected labels above 0"),
        ({"points": P, "labels": np.full(40, 0.5)}, "live: labels: expected labels that are whole numbers"),
        ({"points": P, "viewpoints": [[0, 0]]}, r"live: expected viewpoints of shape \(N, 3\)"),
        ({"points": P, "viewpoints": [[0, 0, np.nan]]}, "live: expected finite viewpoints"),
    ],
)
def test_bad_clouds(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        cloud_of_arrays(**given, name="live")


def test_a_view_of_arrays() -> None:
    view = view_of_arrays(MM[..., None], [60, 60, 24.5, 19.5], np.eye(4), segments=SEGMENTS)
    np.testing.assert_allclose(view.depth, D, atol=1e-9)
    np.testing.assert_array_equal(view.camera.K, K)
    np.testing.assert_array_equal(view.labels, np.maximum(SEGMENTS, 0))
    assert view.notes == ("depth of whole numbers taken as counts of 0.001 m",)
    marked = view_of_arrays(D.astype(np.float32), K, mask=SEGMENTS == 7)
    assert marked.labels is not None
    assert marked.labels.sum() == 100
    for given, message in (
        ({"depth": D[0]}, r"depth image: expected a depth image \(H, W\)"),
        ({"depth": np.zeros((40, 50))}, "depth image: expected pixels with a depth"),
        ({"depth": -D}, "2000 are negative: along OpenGL's axis"),
        ({"depth": D, "mask": D > 0, "segments": SEGMENTS}, "expected mask or segments, got both"),
        ({"depth": D, "T_input_camera": 2 * np.eye(4)}, "T_input_camera: expected a rotation"),
        ({"depth": D, "mask": D[1:] > 0}, r"mask: expected \(40, 50\) pixels"),
    ):
        with pytest.raises(InputError, match=message):
            view_of_arrays(**{"K": K, **given})  # type: ignore[arg-type]


def pgm(path: Path, most: int = 65535) -> None:
    path.write_bytes(b"P5\n# by hand\n50 40\n%d\n" % most + MM.astype(">u2").tobytes())


FILES: dict[str, Any] = {
    "16.png": lambda path: Image.fromarray(MM).save(path),
    "16.tiff": lambda path: Image.fromarray(MM).save(path),
    "32.tif": lambda path: Image.fromarray(MM.astype(np.int32)).save(path),
    "float.tiff": lambda path: Image.fromarray(D.astype(np.float32)).save(path),
    "a.pgm": pgm,
    "ten_thousand.pgm": lambda path: pgm(path, 10000),  # its maximum is no scale
    "plain.pgm": lambda path: path.write_text("P2 50 40 65535\n" + " ".join(map(str, MM.ravel()))),
    "a.pfm": lambda path: path.write_bytes(b"Pf\n50 40\n-1.0\n" + D[::-1].astype("<f4").tobytes()),
    "u2.npy": lambda path: np.save(path, MM),
    "i2.npy": lambda path: np.save(path, MM.astype(np.int16)),
    "i8.npy": lambda path: np.save(path, MM.astype(np.int64)[None]),
    "half.npy": lambda path: np.save(path, D.astype(np.float16)),
    "big.npy": lambda path: np.save(path, D.astype(">f8")[..., None]),
    "network.npz": lambda path: np.savez(path, depth=D, K=K, segmap=SEGMENTS.astype(np.float32), rgb=np.zeros(3)),
    "alone.npz": lambda path: np.savez(path, depth=D),
    "factor.npz": lambda path: np.savez(path, depth=10 * MM, factor_depth=10000),
}


@pytest.mark.parametrize("name", FILES)
def test_depth_files(name: str, tmp_path: Path) -> None:
    FILES[name](tmp_path / name)
    config = settings(SceneConfig, intrinsics=[60, 60, 24.5, 19.5])
    (view,) = read_views([tmp_path / name], config)
    np.testing.assert_allclose(view.depth, D, atol=1e-3)
    assert any("whole numbers" in note for note in view.notes) == (name in ("u2.npy", "i2.npy", "i8.npy", "factor.npz"))
    assert is_depth(tmp_path / name, settings(SceneConfig))


def test_a_networks_file_needs_nothing_else(tmp_path: Path) -> None:
    FILES["network.npz"](tmp_path / "a.npz")
    (view,) = read_views([tmp_path / "a.npz"], settings(SceneConfig))
    np.testing.assert_array_equal(view.camera.K, K)
    assert view.notes == ("segmap beside the depth not used; segments=a.npz makes its numbers targets",)
    (view,) = read_views([tmp_path / "a.npz"], settings(SceneConfig, segments=str(tmp_path / "a.npz")))
    np.testing.assert_array_equal(view.labels, np.maximum(SEGMENTS, 0))
    assert view.notes == ()
    np.savez(tmp_path / "cloud.npz", xyz=P, depth=D)
    assert not is_depth(tmp_path / "cloud.npz", settings(SceneConfig))
    np.save(tmp_path / "cloud.npy", P)
    assert not is_depth(tmp_path / "cloud.npy", settings(SceneConfig))


@pytest.mark.parametrize(
    ("changes", "depth", "note"),
    [
        ({}, 0.06, "depth_scale 0.1 read as mm per count"),
        ({"depth_scale": 0.001}, 0.6, "depth_scale=0.001 taken: 0.001 m per count; the camera's file says 0.0001"),
        ({"unit": "mm"}, 0.6, "unit=mm taken: 0.001 m per count; the camera's file says 0.0001"),
        ({"unit": "cm"}, 6.0, "unit=cm taken: 0.01 m per count"),
        ({"depth_scale": 0.0001, "unit": "mm"}, 0.06, "depth_scale 0.1 read as mm per count"),
    ],
)
def test_whose_depth_scale_wins(changes: dict[str, Any], depth: float, note: str, tmp_path: Path) -> None:
    """The user's, which is told where it contradicts, then the camera's file."""
    Image.fromarray(MM).save(tmp_path / "d.png")
    (tmp_path / "K.json").write_text('{"fx": 60, "fy": 60, "cx": 24.5, "cy": 19.5, "depth_scale": 0.1}')
    (view,) = read_views([tmp_path / "d.png"], settings(SceneConfig, intrinsics=str(tmp_path / "K.json"), **changes))
    assert np.median(view.depth) == pytest.approx(depth)
    assert note in view.notes[-1]
    assert len(view.notes) == 1 + ("taken" in note)


def test_label_images(tmp_path: Path) -> None:
    Image.fromarray(MM).save(tmp_path / "d.png")
    for array, name in (
        (np.maximum(SEGMENTS, 0).astype(np.uint8), "8.png"),
        (SEGMENTS.clip(0).astype(np.uint16), "16.png"),
    ):
        Image.fromarray(array).save(tmp_path / name)
    Image.fromarray(SEGMENTS.clip(0).astype(np.uint8)).convert("P").save(tmp_path / "palette.png")
    np.save(tmp_path / "s.npy", SEGMENTS[None])
    given = {"intrinsics": [60, 60, 24.5, 19.5]}
    for name in ("8.png", "16.png", "palette.png", "s.npy"):
        (view,) = read_views([tmp_path / "d.png"], settings(SceneConfig, segments=str(tmp_path / name), **given))
        np.testing.assert_array_equal(view.labels, SEGMENTS.clip(0))
    Image.fromarray(np.zeros((40, 50, 3), np.uint8)).save(tmp_path / "rgb.png")
    np.save(tmp_path / "other.npy", SEGMENTS[1:])
    np.save(tmp_path / "none.npy", 0 * SEGMENTS)
    np.save(tmp_path / "elsewhere.npy", 9 * (D == 0.5))
    Image.fromarray(np.where(D == 0.5, 0, MM).astype(np.uint16)).save(tmp_path / "hole.png")
    for name, message in (
        ("rgb.png", "expected labels of one channel"),
        ("other.npy", r"expected \(40, 50\) pixels as .*d\.png has, got \(39, 50\)"),
        ("none.npy", "expected labels above 0, which number the targets; got none"),
        ("elsewhere.npy", "got none among the pixels with a depth"),
    ):
        with pytest.raises(InputError, match=message):
            image = "hole.png" if name == "elsewhere.npy" else "d.png"
            read_views([tmp_path / image], settings(SceneConfig, segments=str(tmp_path / name), **given))


@pytest.mark.parametrize(
    ("array", "unit", "hint"),
    [
        (1000 * D, "m", "got 600 m; unit=cm or unit=mm would fit"),
        (D, "mm", "got 0.0006 m; unit=m would fit"),
        (1e6 * D, "m", "numbers of another kind, such as a depth buffer's"),
        (MM * 30, "m", r"another depth_scale \(m per count\)"),
    ],
)
def test_a_median_depth_of_no_scene(array: np.ndarray, unit: str, hint: str, tmp_path: Path) -> None:
    np.save(tmp_path / "d.npy", array)
    config = settings(SceneConfig, intrinsics=[60, 60, 24.5, 19.5], unit=unit)
    with pytest.raises(InputError, match=hint):
        read_views([tmp_path / "d.npy"], config)
