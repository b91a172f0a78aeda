"""Arrays as short text for a page: numbers of few bytes in base64, which the page's script reads without parsing."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

STEPS = 32_000  # of a packed coordinate, from the middle to either side: 16 bits with sign


def packed(values: np.ndarray | Sequence[Any], kind: str) -> dict[str, str]:
    """The values, row by row, as little-endian numbers of a kind of numpy's: `i1`, `u1`, `i2`, `u2` or `f4`."""
    plain = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return {"kind": kind, "base64": base64.b64encode(plain.tobytes()).decode()}


def packed_points(points: np.ndarray, origin: np.ndarray) -> dict[str, Any]:
    """Points (N, 3), m, about `origin` (3,): whole steps of `step` m, the finest that reaches all of them."""
    about = np.asarray(points, dtype=np.float64).reshape(-1, 3) - origin
    step = float(np.abs(about).max(initial=0.0)) / STEPS or 1.0 / STEPS
    return {**packed(np.rint(about / step), "i2"), "step": step}


def packed_units(vectors: np.ndarray) -> dict[str, str]:
    """Vectors (N, 3) of length 1, or 0 where there is none, in steps of 1 / 127."""
    return packed(np.rint(127 * np.asarray(vectors, dtype=np.float64).reshape(-1, 3)), "i1")
