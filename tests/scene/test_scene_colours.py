"""Colours of points, from every kind of file to what a page is given."""

import struct
from pathlib import Path

import numpy as np
import pytest

from spgf_torch.scene.cloud import Cloud, voxel_means
from spgf_torch.scene.colours import colour_bytes, unpacked_colours
from spgf_torch.scene.files import read_cloud
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.sensed import sensed_of

POINTS = np.array([[0.1, 0.0, 0.5], [0.2, 0.0, 0.5], [0.3, 0.1, 0.6]])
COLOURS = np.array([[255, 128, 0], [1, 2, 3], [200, 200, 255]], np.uint8)
LIMIT = 100


def test_ply(tmp_path: Path) -> None:
    rows = [f"{x} {y} {z} {r} {g} {b}" for (x, y, z), (r, g, b) in zip(POINTS, COLOURS, strict=True)]
    names = ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
    head = ["ply", "format ascii 1.0", "element vertex 3", *(f"property {name}" for name in names), "end_header"]
    (tmp_path / "a.ply").write_text("\n".join([*head, *rows, ""]))
    assert read_cloud(tmp_path / "a.ply", LIMIT).colours.tolist() == COLOURS.tolist()


@pytest.mark.parametrize(("data", "kind"), [("ascii", "F"), ("ascii", "U"), ("binary", "F"), ("binary", "U")])
def test_pcd(tmp_path: Path, data: str, kind: str) -> None:
    """0xRRGGBB as the bits of a float, or as a whole number; with an opaque alpha the float's bits are those of NaN."""
    alpha = 0xFF000000 if data == "binary" else 0
    bits = [alpha | int(r) << 16 | int(g) << 8 | int(b) for r, g, b in COLOURS.tolist()]
    head = f"VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F {kind}\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\n"
    head += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {data}\n"
    if data == "binary":
        body = b"".join(struct.pack("<fffI", *point, value) for point, value in zip(POINTS, bits, strict=True))
    else:
        floats = np.array(bits, np.uint32).view(np.float32)
        values = [f"{v:.9g}" for v in floats] if kind == "F" else [str(v) for v in bits]
        body = "".join(f"{x} {y} {z} {v}\n" for (x, y, z), v in zip(POINTS, values, strict=True)).encode()
    (tmp_path / "a.pcd").write_bytes(head.encode() + body)
    cloud = read_cloud(tmp_path / "a.pcd", LIMIT)
    assert cloud.colours.tolist() == COLOURS.tolist()
    np.testing.assert_allclose(cloud.points, POINTS, atol=1e-6)


def test_npz_and_what_is_no_colour(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=POINTS, colors=COLOURS / 255)
    assert read_cloud(tmp_path / "a.npz", LIMIT).colours.tolist() == COLOURS.tolist()
    np.savez(tmp_path / "b.npz", points=POINTS, rgb=COLOURS[:2])
    cloud = read_cloud(tmp_path / "b.npz", LIMIT)
    assert cloud.colours is None and cloud.notes == ("colours of shape (2, 3) and type uint8 left out",)


def test_bytes_of_other_kinds() -> None:
    assert colour_bytes(np.array([[0.0, 0.5, 1.0]])).tolist() == [[0, 128, 255]]
    assert colour_bytes(np.array([[0.0, 128.0, 255.0]])).tolist() == [[0, 128, 255]]
    assert colour_bytes(np.array([[0, 0x8000, 0xFFFF]], np.uint16)).tolist() == [[0, 128, 255]]
    assert colour_bytes(np.array([[-1.0, 0.0, 0.0]])) is None and colour_bytes(np.array([[256, 0, 0]])) is None
    assert colour_bytes(np.array([[np.nan, 0.0, 0.0]])) is None
    assert unpacked_colours(np.array([np.nan, -16777216.0])).tolist() == [[0, 0, 0], [0, 0, 0]]


def test_thinning_takes_their_mean_and_selection_their_rows() -> None:
    """Two of the three points lie in one voxel: (255 + 1) / 2 = 128, (128 + 2) / 2 = 65, 3 / 2 = 1.5 -> 2."""
    near = np.array([[0.1, 0.0, 0.5], [0.1001, 0.0, 0.5], [0.3, 0.1, 0.6]])
    thin = voxel_means(Cloud(near, colours=COLOURS), 0.002)
    assert thin.colours.tolist() == [[128, 65, 2], [200, 200, 255]]
    assert Cloud(near, colours=COLOURS).select(np.array([2])).colours.tolist() == [[200, 200, 255]]


def test_what_was_sensed_says_what_is_a_target() -> None:
    """The table z = 0.5 takes the first two points, a label of 0 the fourth; a cloud without colours is grey."""
    clouds = [Cloud(POINTS, colours=COLOURS), Cloud(POINTS[2:], labels=np.zeros(1, np.int32))]
    sensed = sensed_of(clouds, np.array([0.0, 0.0, 1.0, -0.5]), 0.01)
    assert sensed.target.tolist() == [False, False, True, False]
    assert sensed.colours.tolist() == [*COLOURS.tolist(), [150, 150, 150]]
    assert sensed_of([Cloud(POINTS)], None, 0.01).colours is None


def test_a_scene_keeps_all_that_was_sensed(ball: tuple[np.ndarray, np.ndarray]) -> None:
    """A ball of which the upper half is the target: the rest is there, too, thinned by voxels of 2 mm."""
    points, normals = ball
    scene = Scene.from_points(points, normals=normals, mask=(points[:, 2] > 0.2).astype(np.uint8))
    assert scene.sensed.target.sum() == pytest.approx(len(scene.sensed.target) / 2, rel=0.05)
    assert (scene.sensed.points[scene.sensed.target][:, 2] > 0.2 - 0.002).all()
    np.testing.assert_allclose(np.linalg.norm(scene.sensed.points - [0.1, 0, 0.2], axis=1), 0.05, atol=5e-4)
