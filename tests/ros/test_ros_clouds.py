"""PointCloud2, Image and CameraInfo: layouts packed by hand with struct, and the messages' definitions."""

import array
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from definitions import differences

from spgf_torch.errors import InputError
from spgf_torch.ros.cameras import camera_message, image_message, read_camera, read_depth, read_image
from spgf_torch.ros.clouds import cloud_message, read_cloud
from spgf_torch.ros.messages import Header

HEADER = Header("camera_optical_frame", 12, 345)
POINTS = np.array([[0.5, -0.25, 1.0], [2.0, 3.0, 4.0], [np.nan, np.nan, np.nan]])
CODES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


def message(data: bytes, fields: list[tuple[str, int, int]], **changes: Any) -> dict[str, Any]:
    """A cloud of one row; fields: name, offset, datatype."""
    plain = [{"name": name, "offset": at, "datatype": kind, "count": 1} for name, at, kind in fields]
    known = {"header": HEADER.plain(), "height": 1, "width": 1, "fields": plain, "is_bigendian": False}
    return {**known, "point_step": len(data), "row_step": len(data), "data": data, "is_dense": True} | changes


def test_a_cloud_there_and_back() -> None:
    normals, colours = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]), np.array([[255, 0, 1], [2, 3, 4], [127, 192, 0]])
    values = cloud_message(POINTS, HEADER, normals, colours.astype(np.uint8))
    assert differences(values, "sensor_msgs/PointCloud2") == []
    assert (values["height"], values["width"], values["point_step"], values["is_dense"]) == (1, 3, 28, False)
    known = read_cloud(values)
    np.testing.assert_array_equal(known.points, POINTS)
    np.testing.assert_array_equal(known.normals, normals)
    np.testing.assert_array_equal(known.colours, colours)  # 0x7FC000 and 0xFF0001: bits of NaN and of no number
    assert known.header == HEADER


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", CODES)
def test_every_datatype_in_both_orders(kind: int, order: str) -> None:
    """z, a gap of three bytes, x, y: 7, then 1 and 2."""
    code = CODES[kind]
    size = struct.calcsize(code)
    data = struct.pack(f"{order}{code}3x2{code}", 7, 1, 2)
    fields = [("z", 0, kind), ("x", size + 3, kind), ("y", 2 * size + 3, kind)]
    known = read_cloud(message(data, fields, is_bigendian=order == ">"))
    np.testing.assert_array_equal(known.points, [[1, 2, 7]])
    assert known.normals is None and known.colours is None


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", [6, 7])
def test_packed_colours(kind: int, order: str) -> None:
    data = struct.pack(f"{order}3fI", 1, 2, 3, 0xFF102030)
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgba", 12, kind)]
    known = read_cloud(message(data, fields, is_bigendian=order == ">"))
    assert known.colours is not None and known.colours.tolist() == [[0x10, 0x20, 0x30]]


def test_an_organised_cloud_with_padded_rows() -> None:
    """Two rows of three points of 13 bytes (one of padding), each row with 5 bytes more; red, green, blue apart."""
    points = np.arange(18.0).reshape(2, 3, 3)
    rows = [b"".join(struct.pack("<3f3Bx", *point, 9, 8, 7) for point in row) for row in points]
    data = b"12345".join(rows)  # the last row may end early
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("r", 12, 2), ("g", 13, 2), ("b", 14, 2)]
    known = read_cloud(message(data, fields, height=2, width=3, point_step=16, row_step=53))
    np.testing.assert_array_equal(known.points, points)
    assert known.colours is not None and known.colours.shape == (2, 3, 3) and known.colours[1, 2].tolist() == [9, 8, 7]
    again = read_cloud(cloud_message(points, HEADER))
    np.testing.assert_array_equal(again.points, points)


@pytest.mark.parametrize("data", [bytes, bytearray, list, lambda raw: array.array("B", raw), memoryview])
def test_message_objects_and_kinds_of_bytes(data: Any) -> None:
    """As rclpy has them: attributes, and data in an array."""
    values = cloud_message(POINTS[:2], HEADER)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=12, nanosec=345), frame_id="camera_optical_frame")
    fields = [SimpleNamespace(**field) for field in values["fields"]]
    known = read_cloud(SimpleNamespace(**{**values, "header": header, "fields": fields, "data": data(values["data"])}))
    np.testing.assert_array_equal(known.points, POINTS[:2])
    assert known.header == HEADER


def test_an_empty_cloud() -> None:
    assert read_cloud(cloud_message(np.zeros((0, 3)), HEADER)).points.shape == (0, 3)


XYZ = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"data": b"\0" * 11}, "data: expected 12 bytes of 1 rows, got 11"),
        ({"width": 2**31, "row_step": 2**40}, "data: expected"),
        ({"height": 2}, "data: expected 24 bytes"),
        ({"row_step": 11}, "row_step: expected at least 12 bytes"),
        ({"point_step": 8, "row_step": 8}, "fields[2]: expected to end within point_step (8 bytes), got 12"),
        ({"width": -1}, "width: expected a whole number from 0"),
        ({"is_bigendian": 2}, "is_bigendian: expected true or false"),
        ({"data": "text"}, "data: expected at most"),
        ({"data": [0, 256]}, "data: expected at most"),
        ({"fields": []}, "expected x, y, z; got none"),
        ({"fields": 3}, "fields: expected a list"),
        ({"header": {}}, "header: expected"),
        ({"fields": [{"name": "x", "offset": 0, "datatype": 9, "count": 1}]}, "datatype: expected a number from 1 to"),
    ],
)
def test_bad_clouds(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        read_cloud(message(struct.pack("<3f", 1, 2, 3), XYZ) | changes)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_depth_in_millimetres_with_padding_and_the_other_order() -> None:
    data = struct.pack(">3H", 1000, 0, 65535) + b"??" + struct.pack(">3H", 1, 2, 770)
    values = {"header": HEADER.plain(), "height": 2, "width": 3, "encoding": "16UC1", "is_bigendian": 1, "step": 8}
    depth = read_depth({**values, "data": data})
    assert depth.dtype == np.uint16 and depth.tolist() == [[1000, 0, 65535], [1, 2, 770]]


@pytest.mark.parametrize(("kind", "encoding"), [("u1", "mono8"), ("u2", "16UC1"), ("i4", "32SC1"), ("f4", "32FC1")])
def test_images_there_and_back(kind: str, encoding: str) -> None:
    image = np.array([[1, 2, 3], [4, 5, 6]]).astype(kind)
    values = image_message(image, HEADER)
    assert differences(values, "sensor_msgs/Image") == [] and values["encoding"] == encoding
    np.testing.assert_array_equal(read_image(values), image)
    if encoding not in ("16UC1", "32FC1"):
        with pytest.raises(InputError, match="expected one of 16UC1, 32FC1"):
            read_depth(values)


def test_an_image_that_ends_early() -> None:
    values = image_message(np.ones((2, 3), np.float32), HEADER)
    with pytest.raises(InputError, match="data: expected 24 bytes of 2 rows, got 23"):
        read_depth({**values, "data": values["data"][:23]})


K = np.array([[600.0, 0, 320], [0, 610, 240], [0, 0, 1]])


def test_a_camera_there_and_back() -> None:
    values = camera_message(K, 640, 480, HEADER)
    assert differences(values, "sensor_msgs/CameraInfo") == []
    known = read_camera(values, 640, 480)
    np.testing.assert_array_equal(known.K, K)
    assert known.notes == ()


def test_a_binned_part_of_an_image() -> None:
    """From (40, 80) on, two pixels across and four down became one: cx (320 - 40) / 2, cy (240 - 80) / 4."""
    part = {"x_offset": 40, "y_offset": 80, "width": 400, "height": 200, "do_rectify": False}
    values = camera_message(K, 640, 480, HEADER) | {"roi": part, "binning_x": 2, "binning_y": 4}
    known = read_camera(values, 200, 50)
    np.testing.assert_allclose(known.K, [[300, 0, 140], [0, 152.5, 40], [0, 0, 1]])


def test_the_rectified_image_is_meant() -> None:
    values = camera_message(K, 640, 480, HEADER)
    values["p"] = [590.0, 0, 318, 0, 0, 590, 238, 0, 0, 0, 1, 0]
    known = read_camera(values, 640, 480)
    assert known.K[0].tolist() == [590, 0, 318] and "P taken" in known.notes[0]


def test_cameras_that_cannot_be_used() -> None:
    values = camera_message(K, 640, 480, HEADER)
    with pytest.raises(InputError, match="expected a calibrated camera"):
        read_camera(values | {"k": [0.0] * 9, "p": [0.0] * 12}, 640, 480)
    with pytest.raises(InputError, match="got one of 640 x 480"):
        read_camera(values, 320, 240)
    with pytest.raises(InputError, match="k: expected 9 numbers, got 4"):
        read_camera(values | {"k": [1.0] * 4}, 640, 480)
