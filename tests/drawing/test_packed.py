"""Arrays in a page: read back as its script reads them."""

import base64

import numpy as np
import pytest

from spgf_torch.drawing.packed import STEPS, packed, packed_points, packed_units


def unpacked(content: dict) -> np.ndarray:
    """What `viewer/data.js` makes of a packed array."""
    return np.frombuffer(base64.b64decode(content["base64"]), np.dtype(content["kind"]).newbyteorder("<"))


def test_numbers_are_little_endian() -> None:
    assert base64.b64decode(packed([1, 258], "u2")["base64"]) == bytes([1, 0, 2, 1])
    assert unpacked(packed([[0.5, -2.0]], "f4")).tolist() == [0.5, -2.0]


def test_points_are_whole_steps_about_an_origin() -> None:
    """The farthest coordinate, 0.8 m from the origin, is 32,000 steps of 25 um; 10 mm are 400 of them."""
    content = packed_points(np.array([[1.8, 2.0, 3.0], [1.01, 2.0, 2.99]]), np.array([1.0, 2.0, 3.0]))
    assert content["step"] == pytest.approx(0.8 / STEPS)
    assert unpacked(content).tolist() == [STEPS, 0, 0, 400, 0, -400]


def test_points_at_the_origin_and_none() -> None:
    assert unpacked(packed_points(np.ones((1, 3)), np.ones(3))).tolist() == [0, 0, 0]
    assert packed_points(np.zeros((0, 3)), np.zeros(3))["base64"] == ""


def test_units_are_bytes() -> None:
    assert unpacked(packed_units(np.array([[0.6, -0.8, 0.0]]))).tolist() == [76, -102, 0]
