"""Lists of numbers in a JSON object, as arrays that a scene is made of."""

from __future__ import annotations

import reprlib
from typing import Any

import numpy as np

from spgf_torch.errors import InputError

# How many numbers each has for a point or a pixel; others are small.
_PER_POINT = {"points": 3, "normals": 3, "depth": 1, "mask": 1, "segments": 1}


def checked_arrays(values: dict[str, Any], most: int) -> dict[str, Any]:
    """The values that are given, as arrays; null is no reading. InputError for what has no numbers, or too many points.

    Args:
        most: points or pixels.
    """
    arrays = {key: _array(key, value) for key, value in values.items() if value is not None}
    for key, each in _PER_POINT.items():
        if key in arrays and (count := arrays[key].size // each) > most:
            raise InputError(f"{key}: expected at most {most} points or pixels (max_points), got {count}")
    return arrays


def _array(name: str, value: Any) -> np.ndarray:
    """Whole numbers stay whole: of a depth they are counts."""
    try:
        array = np.asarray(value)
        array = np.array(value, dtype=np.float64) if array.dtype == object else array
        if array.dtype.kind not in "fiub":
            raise ValueError
    except (TypeError, ValueError, OverflowError):  # words, rows of several lengths, numbers of hundreds of digits
        raise InputError(f"{name}: expected numbers in rows of one length, got {reprlib.repr(value)}") from None
    return array
