"""sensor_msgs/PointCloud2 to and from arrays: all datatypes, both byte orders, padding, images of points, colours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.ros.messages import Header, count, flag, part, parts, rows

# PointField's numbers of datatypes, as numpy has them.
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_FLOAT32 = 7
_POSITION, _NORMAL = ("x", "y", "z"), ("normal_x", "normal_y", "normal_z")
_WHAT = "PointCloud2"


@dataclass(frozen=True)
class CloudMessage:
    """What a PointCloud2 holds.

    Attributes:
        points: (N, 3) float64, or (H, W, 3) of a cloud in rows, m in the header's frame; NaN: no reading.
        normals: in the shape of the points; None: not in the message.
        colours: in the shape of the points, uint8 red, green, blue; None: not in the message.
        header: frame and time.
    """

    points: np.ndarray
    normals: np.ndarray | None
    colours: np.ndarray | None
    header: Header


def read_cloud(message: Any) -> CloudMessage:
    """The points of a PointCloud2, with normals and colours where it has them.

    Fields may have any datatype, order and gaps. Colours are PCL's `rgb` or `rgba` (0xAARRGGBB in four bytes, whether
    they are called float or not) or fields r, g, b.

    Args:
        message: a dictionary with the message's fields, or rclpy's message.

    Raises:
        InputError: no x, y, z, a field that reaches out of its point, an unknown datatype, data that end early.
    """
    width, height = (count(message, key, _WHAT) for key in ("width", "height"))
    size = count(message, "point_step", _WHAT)
    data, step = rows(message, width, height, size, _WHAT)
    order = ">" if flag(message, "is_bigendian", _WHAT) else "<"
    fields = _fields(message, size)
    shape = (height, width) if height > 1 else (width,)

    def column(name: str, dtype: str | None = None) -> np.ndarray:
        offset, own = fields[name]
        if not width * height:
            return np.zeros(shape, dtype or own)
        kind = np.dtype(order + (dtype or own))
        return np.ndarray((height, width), kind, data.data, offset, (step, size)).reshape(shape)

    if missing := [name for name in _POSITION if name not in fields]:
        raise InputError(f"{_WHAT}.fields: expected x, y, z; got {', '.join(fields) or 'none'} without {missing[0]}")
    points = np.stack([column(name).astype(np.float64) for name in _POSITION], axis=-1)
    normals = None
    if all(name in fields for name in _NORMAL):
        normals = np.stack([column(name).astype(np.float64) for name in _NORMAL], axis=-1)
    colours = None
    packed = next((name for name in ("rgb", "rgba") if name in fields), None)
    if packed is not None and np.dtype(fields[packed][1]).itemsize == 4:
        bits = column(packed, "u4")
        colours = np.stack([(bits >> shift & 255).astype(np.uint8) for shift in (16, 8, 0)], axis=-1)
    elif all(name in fields and fields[name][1] == "u1" for name in "rgb"):
        colours = np.stack([column(name) for name in "rgb"], axis=-1)
    return CloudMessage(points, normals, colours, Header.of(message, _WHAT))


def _fields(message: Any, size: int) -> dict[str, tuple[int, str]]:
    """Name -> offset and datatype of each field of one value; `size`: bytes of a point."""
    found = {}
    for i, field in enumerate(parts(message, "fields", _WHAT)):
        where = f"{_WHAT}.fields[{i}]"
        name, offset, number = part(field, "name", where), count(field, "offset", where), part(field, "datatype", where)
        if number not in DATATYPES:
            raise InputError(f"{where}.datatype: expected a number from 1 to 8, got {number!r:.40}")
        own, values = DATATYPES[number], max(1, count(field, "count", where))
        if (end := offset + values * np.dtype(own).itemsize) > size:
            raise InputError(f"{where}: expected to end within point_step ({size} bytes), got {end}")
        if values == 1:
            found[str(name)] = (offset, own)
    return found


def cloud_message(
    points: np.ndarray, header: Header, normals: np.ndarray | None = None, colours: np.ndarray | None = None
) -> dict[str, Any]:
    """A PointCloud2 as a dictionary: float32, little-endian, without gaps; its data are bytes.

    Args:
        points: (N, 3), or (H, W, 3) as an image of points, m; NaN: no reading.
        normals, colours (uint8 red, green, blue): in the shape of the points.

    Raises:
        InputError: other shapes.
    """
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise InputError(f"points: expected shape (N, 3) or (H, W, 3), got {points.shape}")
    for name, beside in (("normals", normals), ("colours", colours)):
        if beside is not None and beside.shape != points.shape:
            raise InputError(f"{name}: expected the shape of the points, {points.shape}; got {beside.shape}")
    columns: dict[str, np.ndarray] = {name: points[..., i] for i, name in enumerate(_POSITION)}
    if normals is not None:
        columns |= {name: normals[..., i] for i, name in enumerate(_NORMAL)}
    if colours is not None:
        red, green, blue = (colours[..., i].astype("<u4") for i in range(3))
        columns["rgb"] = (red << 16 | green << 8 | blue).view("<f4")  # PCL calls the four bytes a float
    height, width = points.shape[:-1] if points.ndim == 3 else (1, len(points))
    packed = _packed(columns, points.shape[:-1])
    names = [{"name": name, "offset": 4 * i, "datatype": _FLOAT32, "count": 1} for i, name in enumerate(columns)]
    size = 4 * len(columns)
    layout = {"is_bigendian": False, "point_step": size, "row_step": size * width, "data": packed}
    dense = bool(np.isfinite(points).all())
    return {"header": header.plain(), "height": height, "width": width, "fields": names, **layout, "is_dense": dense}


def _packed(columns: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> bytes:
    """Columns of four bytes each, point by point; bit patterns are kept, also of what is no number."""
    table = np.empty((math.prod(shape), len(columns)), "<u4")
    for i, column in enumerate(columns.values()):
        table[:, i] = column.astype("<f4").reshape(-1).view("<u4")
    return table.tobytes()
