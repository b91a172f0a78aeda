"""Fields of messages, of plain dictionaries or of rclpy's objects, and the parts that all messages share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from spgf_torch.errors import InputError
from spgf_torch.files.checks import entry, number, whole
from spgf_torch.geometry import se3

# Bytes of the largest message that is read: images and clouds of 16 million pixels with 64 bytes each.
LARGEST = 1 << 30


@dataclass(frozen=True)
class Header:
    """std_msgs/Header: the frame of what comes with it, and when that was sensed (s, ns)."""

    frame: str
    sec: int = 0
    nanosec: int = 0

    @staticmethod
    def of(message: Any, where: str) -> Header:
        """The header of a message. Raises InputError where there is none."""
        header = part(message, "header", where)
        stamp, frame = part(header, "stamp", f"{where}.header"), part(header, "frame_id", f"{where}.header")
        if not isinstance(frame, str):
            raise InputError(f"{where}.header.frame_id: expected a word, got {frame!r:.40}")
        sec = part(stamp, "sec", f"{where}.header.stamp")
        if isinstance(sec, bool) or not isinstance(sec, int):
            raise InputError(f"{where}.header.stamp.sec: expected a whole number, got {sec!r:.40}")
        return Header(frame, sec, count(stamp, "nanosec", f"{where}.header.stamp"))

    def plain(self) -> dict[str, Any]:
        """The fields of the message."""
        return {"stamp": {"sec": self.sec, "nanosec": self.nanosec}, "frame_id": self.frame}


def part(message: Any, key: str, where: str) -> Any:
    """The field `key` of a dictionary or of a message object. Raises InputError where it has none."""
    if isinstance(message, Mapping):
        return entry(message, key, where)
    if not hasattr(message, key):
        raise InputError(f"{where}: expected a message with the field {key}, got {type(message).__name__}")
    return getattr(message, key)


def parts(message: Any, key: str, where: str) -> Sequence[Any]:
    """A list under `key`. Raises InputError for anything else."""
    listed = part(message, key, where)
    if isinstance(listed, str | bytes) or not isinstance(listed, Sequence | np.ndarray):
        raise InputError(f"{where}.{key}: expected a list, got {type(listed).__name__}")
    return listed  # type: ignore[return-value]


def count(message: Any, key: str, where: str) -> int:
    """A whole number from 0 under `key`."""
    return whole(part(message, key, where), f"{where}.{key}")


def flag(message: Any, key: str, where: str) -> bool:
    """A bool, or 0 or 1, under `key`."""
    value = part(message, key, where)
    if value not in (0, 1):
        raise InputError(f"{where}.{key}: expected true or false, got {value!r:.40}")
    return bool(value)


def raw(message: Any, key: str, where: str) -> np.ndarray:
    """(N,) uint8 under `key`: bytes, an array of bytes, or a list of numbers from 0 to 255."""
    data = part(message, key, where)
    try:
        if isinstance(data, list | tuple):
            return np.frombuffer(bytes(data), np.uint8)
        flat = memoryview(data)
        if flat.itemsize != 1 or flat.nbytes > LARGEST:
            raise ValueError
        return np.frombuffer(flat, np.uint8)
    except (TypeError, ValueError):
        expected = f"at most {LARGEST} bytes"
        raise InputError(f"{where}.{key}: expected {expected}, got {type(data).__name__}") from None


def rows(message: Any, width: int, height: int, size: int, where: str) -> tuple[np.ndarray, int]:
    """The bytes of an image or a cloud and the length of a row, which may be padded.

    Args:
        size: bytes of a pixel or a point.

    Raises InputError where rows overlap or the data end early.
    """
    key = "step" if hasattr(message, "step") or (isinstance(message, Mapping) and "step" in message) else "row_step"
    step, data = count(message, key, where), raw(message, "data", where)
    if step < width * size:
        raise InputError(f"{where}.{key}: expected at least {width * size} bytes ({width} x {size}), got {step}")
    needed = (height - 1) * step + width * size if width and height else 0
    if len(data) < needed:
        raise InputError(f"{where}.data: expected {needed} bytes of {height} rows, got {len(data)}")
    return data, step


def numbers(message: Any, key: str, length: int, where: str) -> np.ndarray:
    """(length,) finite float64 under `key`."""
    listed = parts(message, key, where)
    if len(listed) != length:
        raise InputError(f"{where}.{key}: expected {length} numbers, got {len(listed)}")
    return np.array([number(value, f"{where}.{key}") for value in listed])


def xyz(message: Any, key: str, where: str) -> np.ndarray:
    """(3,) float64 of a Point or a Vector3 under `key`."""
    inner, place = part(message, key, where), f"{where}.{key}"
    return np.array([number(part(inner, axis, place), f"{place}.{axis}") for axis in "xyz"])


def plain_xyz(vector: np.ndarray) -> dict[str, float]:
    """geometry_msgs/Point and Vector3."""
    return dict(zip("xyz", map(float, vector), strict=True))


def plain_pose(T: np.ndarray) -> dict[str, Any]:
    """geometry_msgs/Pose of T (4, 4)."""
    w, x, y, z = se3.quaternion_of(torch.from_numpy(np.asarray(T, dtype=np.float64))).tolist()
    return {"position": plain_xyz(T[:3, 3]), "orientation": {"x": x, "y": y, "z": z, "w": w}}


def pose(message: Any, where: str) -> np.ndarray:
    """T (4, 4) float64 of a geometry_msgs/Pose. Raises InputError for a quaternion that is not of length 1."""
    turn = part(message, "orientation", where)
    wxyz = [number(part(turn, axis, f"{where}.orientation"), f"{where}.orientation.{axis}") for axis in "wxyz"]
    length = float(np.linalg.norm(wxyz))
    if abs(length - 1) > 1e-3:  # single precision and rounded text are far nearer
        raise InputError(f"{where}.orientation: expected a quaternion of length 1, got {length:g}")
    place = torch.from_numpy(xyz(message, "position", where))
    return se3.pose(place, torch.tensor(wxyz, dtype=torch.float64)).numpy()
