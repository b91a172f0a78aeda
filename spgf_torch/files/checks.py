"""Checks of values from files: type and range. InputError names the place, in one line."""

from __future__ import annotations

import math
import numbers
import re
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.reading import text

TOLERANCE = 1e-4  # of a rotation matrix's orthonormality and of a quaternion's length: float32 gives 1e-6
LARGEST = 64_000_000  # bytes of a file of grasps: a hundred thousand in JSON
LONGEST = 200  # characters of a name
_NAME = re.compile(r"[\w/][\w/.: -]*", re.ASCII)


def content(path: Path, what: str, largest: int = LARGEST) -> str:
    """The UTF-8 text of a file that should be `what`, of `largest` bytes at most."""
    if not path.is_file():
        raise InputError(f"{path}: expected {what}, got {'a folder' if path.is_dir() else 'no such file'}")
    return text(path, what, largest)


def entry(values: Any, key: str, where: str) -> Any:
    """`values[key]` of a mapping."""
    if not isinstance(values, Mapping):
        raise InputError(f"{where}: expected keys and values, got {reprlib.repr(values)}")
    if key not in values:
        raise InputError(f"{where}: expected the key {key}, got none")
    return values[key]


def entries(value: Any, where: str) -> list[Any]:
    """A list."""
    if not isinstance(value, list):
        raise InputError(f"{where}: expected a list, got {reprlib.repr(value)}")
    return value


def number(value: Any, where: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number within [low, high]; True and False are none."""
    bounds = f" from {low:g} to {high:g}" if math.isfinite(low) or math.isfinite(high) else ""
    if not isinstance(value, bool | np.bool_) and isinstance(value, numbers.Real):
        try:
            known = float(value)
        except OverflowError:  # an integer of hundreds of digits
            known = math.inf
        if math.isfinite(known) and low <= known <= high:
            return known
    raise InputError(f"{where}: expected a finite number{bounds}, got {reprlib.repr(value)}")


def whole(value: Any, where: str) -> int:
    """A count or an index: an integer from 0."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Integral) or value < 0:
        raise InputError(f"{where}: expected a whole number from 0, got {reprlib.repr(value)}")
    return int(value)


def vector(value: Any, length: int, where: str) -> np.ndarray:
    """(length,) float64."""
    if not isinstance(value, list) or len(value) != length:
        raise InputError(f"{where}: expected {length} numbers, got {reprlib.repr(value)}")
    return np.array([number(part, where) for part in value])


def rigid(value: Any, where: str) -> np.ndarray:
    """T (4, 4) float64: a rotation, a translation, and 0 0 0 1 below."""
    if not isinstance(value, list) or len(value) != 4:
        raise InputError(f"{where}: expected 4 rows of a pose, got {reprlib.repr(value)}")
    return _rigid(np.stack([vector(row, 4, where) for row in value]), where)


def _rigid(T: np.ndarray, where: str) -> np.ndarray:
    if np.abs(T[3] - [0, 0, 0, 1]).max() > TOLERANCE:
        raise InputError(f"{where}: expected 0 0 0 1 in the last row, got {reprlib.repr(T[3].tolist())}")
    rotation(T[:3, :3], where)
    return T


def rigid_of(T: Any, where: str) -> np.ndarray:
    """T (4, 4) float64 of anything that numpy takes for it, rigid as `rigid` wants it."""
    try:
        values = np.asarray(T, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where}: expected a rigid pose (4, 4), got {reprlib.repr(T)}") from None
    if values.shape != (4, 4):
        raise InputError(f"{where}: expected a rigid pose (4, 4), got shape {values.shape}")
    if (wrong := values[~np.isfinite(values)]).size:
        raise InputError(f"{where}: expected a finite number, got {wrong[0]}")
    return _rigid(values, where)


def rotation(R: np.ndarray, where: str) -> np.ndarray:
    """R (3, 3), orthonormal and right-handed."""
    off = float(np.abs(R.T @ R - np.eye(3)).max()) if np.abs(R).max() < 2 else math.inf
    if off > TOLERANCE:
        raise InputError(f"{where}: expected a rotation, got a matrix that is {off:.2g} off orthonormal")
    if np.linalg.det(R) < 0:
        raise InputError(f"{where}: expected a rotation, got a mirrored one (determinant -1)")
    return R


def joint_values(value: Any, where: str) -> dict[str, float]:
    """Joint name -> rad or m."""
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: expected joint names and values, got {reprlib.repr(value)}")
    return {name(joint, where): number(at, f"{where}.{joint}") for joint, at in value.items()}


def name(value: Any, where: str) -> str:
    """A word that may become part of a path or of a page: letters, digits and `_ / . : -` or blanks, no `..`."""
    if not isinstance(value, str) or len(value) > LONGEST or ".." in value or not _NAME.fullmatch(value):
        raise InputError(f"{where}: expected a name of letters, digits and _ / . : -, got {reprlib.repr(value)}")
    return value
