"""sensor_msgs/Image and CameraInfo to and from arrays: depth images, masks and label images, and their cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.ros.messages import Header, count, flag, numbers, part, parts, rows
from spgf_torch.scene.intrinsics import Intrinsics, intrinsics_of

# Encodings of one channel (sensor_msgs/image_encodings.hpp), as numpy has them.
ENCODINGS = {
    "mono8": "u1",
    "8UC1": "u1",
    "8SC1": "i1",
    "mono16": "u2",
    "16UC1": "u2",
    "16SC1": "i2",
    "32SC1": "i4",
    "32FC1": "f4",
    "64FC1": "f8",
}
# What REP 118 allows for depth: mm as whole numbers, m as floats.
DEPTHS = ("16UC1", "32FC1")
_WHAT, _CAMERA = "Image", "CameraInfo"


def read_image(message: Any, encodings: tuple[str, ...] = tuple(ENCODINGS)) -> np.ndarray:
    """(H, W) of an image of one channel, such as a mask or labels, in the machine's byte order.

    Raises:
        InputError: another encoding, rows that are too short, data that end early.
    """
    encoding = part(message, "encoding", _WHAT)
    if encoding not in encodings:
        raise InputError(f"{_WHAT}.encoding: expected one of {', '.join(encodings)}; got {encoding!r:.40}")
    width, height = (count(message, key, _WHAT) for key in ("width", "height"))
    kind = np.dtype((">" if flag(message, "is_bigendian", _WHAT) else "<") + ENCODINGS[encoding])
    data, step = rows(message, width, height, kind.itemsize, _WHAT)
    if not width * height:
        return np.zeros((height, width), kind.newbyteorder("="))
    return np.ndarray((height, width), kind, data.data, 0, (step, kind.itemsize)).astype(kind.newbyteorder("="))


def read_depth(message: Any) -> np.ndarray:
    """(H, W) uint16 mm (0: no reading) or float32 m (NaN: no reading) of a depth image, as `Scene.from_depth` takes it.

    Raises InputError for an encoding other than REP 118's 16UC1 and 32FC1.
    """
    return read_image(message, DEPTHS)


def image_message(image: np.ndarray, header: Header) -> dict[str, Any]:
    """An Image as a dictionary of (H, W) uint8 (mono8), uint16 (16UC1, mm), int32 (32SC1) or float32 (32FC1, m)."""
    names = {"u1": "mono8", "u2": "16UC1", "i4": "32SC1", "f4": "32FC1"}
    kind = image.dtype.str[1:]
    if image.ndim != 2 or kind not in names:
        raise InputError(f"image: expected (H, W) of uint8, uint16, int32 or float32; got {image.shape} {image.dtype}")
    height, width = image.shape
    data = image.astype("<" + kind).tobytes()
    about = {"encoding": names[kind], "is_bigendian": 0, "step": width * image.dtype.itemsize}
    return {"header": header.plain(), "height": height, "width": width, **about, "data": data}


def read_camera(message: Any, width: int, height: int) -> Intrinsics:
    """K of an image of `width` x `height` pixels that belongs to a CameraInfo.

    Binning and region of interest are used; where P, of the rectified image, differs from K it is P: depth images are
    rectified. What was taken for what is in `notes`.

    Raises:
        InputError: an uncalibrated camera (k is 0), or one of images of another size.
    """
    roi = part(message, "roi", _CAMERA)
    values = {
        **{key: count(message, key, _CAMERA) for key in ("width", "height", "binning_x", "binning_y")},
        **{key: numbers(message, key, length, _CAMERA).tolist() for key, length in (("k", 9), ("p", 12))},
        "d": list(parts(message, "d", _CAMERA)),
        "roi": {key: count(roi, key, f"{_CAMERA}.roi") for key in ("x_offset", "y_offset", "width", "height")},
    }
    if not any(values["k"]) and not any(values["p"]):
        raise InputError(f"{_CAMERA}: expected a calibrated camera, got k and p of zeros")
    return intrinsics_of(Path(_CAMERA), values).of_image(width, height, "depth image")


def camera_message(K: np.ndarray, width: int, height: int, header: Header) -> dict[str, Any]:
    """A CameraInfo as a dictionary: of an ideal camera K (3, 3), rectified, not binned, the whole image."""
    k = [float(value) for value in np.asarray(K, dtype=np.float64).reshape(9)]
    p = [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]
    whole_image = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    model = {"distortion_model": "plumb_bob", "d": [0.0] * 5, "k": k, "r": np.eye(3).ravel().tolist(), "p": p}
    size = {"height": height, "width": width}
    return {"header": header.plain(), **size, **model, "binning_x": 0, "binning_y": 0, "roi": whole_image}
