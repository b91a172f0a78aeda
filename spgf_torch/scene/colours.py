"""Colours of points as files carry them, as red, green and blue bytes. They are shown, never computed with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

# What writers call the three; the last of .npz files, as one array.
NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
ARRAYS = ("colours", "colors", "rgb")
# The largest value of floats that are shares; above it they are bytes.
_SHARES = 1.0


def colours_of_columns(columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """(N, 3) uint8 of properties or columns with the names of colours; None where there are none."""
    for names in NAMES:
        if set(names) <= set(columns):
            return colour_bytes(np.stack([columns[name] for name in names], axis=1))
    return None


def colour_bytes(values: np.ndarray) -> np.ndarray | None:
    """(..., 3) uint8 of colours as bytes, 16-bit numbers or shares from 0 to 1; None for what can be none."""
    if values.dtype == np.uint8:
        return values
    if values.dtype == np.uint16:
        return (values >> 8).astype(np.uint8)
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all() or not len(values) or values.min() < 0:
        return None
    shares = values.dtype.kind == "f" and values.max() <= _SHARES
    if values.max() > 255:
        return None
    return np.rint(255 * values if shares else values).astype(np.uint8)


def unpacked_colours(packed: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 of numbers (N,) whose bits are 0xRRGGBB, with anything above them."""
    bits = np.nan_to_num(packed).astype(np.int64)
    return np.stack([(bits >> shift) & 255 for shift in (16, 8, 0)], axis=1).astype(np.uint8)
