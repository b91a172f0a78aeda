"""Depth images of real cameras: pixels, intrinsics, poses and masks from files, and the surface that they show."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from spgf_torch.config import InputError, SensingConfig
from spgf_torch.objects.scans import METRES
from spgf_torch.reading import existing, json_values, npy_array, text, unreadable, yaml_values
from spgf_torch.scene.cloud import Cloud
from spgf_torch.sensing.cameras import Camera
from spgf_torch.sensing.planes import surface_points

# A 16-bit image's highest value says "too far" or "not measured" in most drivers.
_SATURATED = 65535
# A principal point further from the middle, as a share of the image, belongs to an image of another size.
_OFF_CENTRE = 0.2
# Formats of a mask; pillow reads others, such as PostScript, by running programs.
_MASKS = ("PNG", "JPEG", "BMP", "TIFF", "PPM")
# Of a rotation matrix that was written with few digits.
_RIGID = 1e-3


def read_depth(path: Path, scale: float, unit: str, limit: int) -> np.ndarray:
    """(H, W) float64 depth image in m; 0, negative or not finite: no return.

    Args:
        path: a .png of 16 bits and one channel (65535 counts as no return), or a .npy of shape (H, W).
        scale: m per count of a .png.
        unit: of a .npy, m or mm.
        limit: pixels at most.

    Raises:
        InputError: another format, size or number of bits, a damaged file, no pixel with a return.
    """
    existing(path)
    if path.suffix.lower() == ".png":
        counts = _image(path, limit, ("PNG",))
        if counts.ndim != 2 or counts.dtype.itemsize < 2:
            bits, channels = 8 * counts.dtype.itemsize, counts.shape[2] if counts.ndim == 3 else 1
            raise InputError(f"{path}: expected 16 bits and one channel, got {bits} bits and {channels} channels")
        depth = np.where(counts == _SATURATED, 0.0, counts * scale)
    elif path.suffix.lower() == ".npy":
        numbers = _numbers(path)
        if numbers.ndim != 2:
            raise InputError(f"{path}: expected a depth image (H, W), got shape {numbers.shape}")
        _check_pixels(path, numbers.shape, limit)
        depth = numbers * METRES[unit]
    else:
        raise InputError(f"{path}: expected a depth image (.png, .npy), since intrinsics are given; got {path.suffix}")
    if not (np.isfinite(depth) & (depth > 0)).any():
        raise InputError(f"{path}: expected pixels with a depth, got none of {depth.size}")
    return depth


def check_depth(depth: np.ndarray, name: str, low: float, high: float) -> None:
    """InputError that names the options where the median of a depth image is not between two depths, m."""
    median = float(np.median(depth[np.isfinite(depth) & (depth > 0)]))
    if not low <= median <= high:
        raise InputError(
            f"{name}: expected a median depth of {low:g} to {high:g} m, got {median:.4g} m; another depth_scale "
            "(.png) or unit (.npy)?"
        )


def read_mask(path: Path, limit: int) -> np.ndarray:
    """(H, W) bool: which pixels of a mask (.npy, PNG, JPEG, BMP, TIFF, PPM), at most `limit` of them, are not 0."""
    pixels = _numbers(path) if path.suffix.lower() == ".npy" else _image(path, limit, _MASKS)
    if pixels.ndim not in (2, 3) or not pixels.size:
        raise InputError(f"{path}: expected a mask (H, W), got shape {pixels.shape}")
    _check_pixels(path, pixels.shape, limit)
    return np.any(np.atleast_3d(pixels)[..., :3] != 0, axis=-1)


def read_intrinsics(path: Path) -> tuple[np.ndarray, tuple[int, int] | None]:
    """A camera's K (3, 3) in pixels of the rectified image, and the (width, height) that the file states, if it does.

    Formats: nine numbers as text or .npy; JSON or YAML with a 3x3 list, nine numbers, or a mapping with one of
    `camera_matrix` (ROS camera_info files: its `data`), `K`, `k` (ROS messages), `intrinsic_matrix` (Open3D: nine
    numbers column by column), or with fx, fy and cx, cy (RealSense: ppx, ppy).

    Raises:
        InputError: none of these, K not 3x3, not finite, a focal length not above 0, a last row other than 0 0 1.
    """
    values = _structured(path)
    size = None
    if isinstance(values, dict):
        width, height = (values.get(f"image_{key}", values.get(key)) for key in ("width", "height"))
        size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
        values = _matrix_of(path, values)
    K = _array(path, values)
    if K.size != 9 or K.ndim > 2:
        raise InputError(f"{path}: expected K with 3 x 3 numbers, got shape {K.shape}")
    K = K.reshape(3, 3)
    if not np.isfinite(K).all():
        raise InputError(f"{path}: expected K with finite numbers, got {K.ravel().tolist()}")
    if np.array_equal(K[:, 2], [0, 0, 1]) and K[2, :2].all():  # column by column
        K = K.T.copy()
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(f"{path}: expected focal lengths above 0 in K, got {K[0, 0]:g} and {K[1, 1]:g}")
    if not np.array_equal(K[2], [0, 0, 1]) or K[1, 0] != 0:
        raise InputError(f"{path}: expected K = fx s cx; 0 fy cy; 0 0 1, got {K.ravel().tolist()}")
    return K, size


def read_poses(paths: Sequence[Path]) -> np.ndarray:
    """(V, 4, 4) T_input_camera, m: the files' matrices one after another.

    Formats: rows of four numbers as text; JSON or YAML lists, or a mapping with `T_input_camera`; .npy (4, 4) or
    (V, 4, 4).

    Raises:
        InputError: not 4x4 matrices, or not of a rotation and a translation.
    """
    poses = []
    for path in paths:
        values = _structured(path)
        if isinstance(values, dict):
            if "T_input_camera" not in values:
                raise InputError(f"{path}: expected a key T_input_camera, got {', '.join(map(str, values))}")
            values = values["T_input_camera"]
        array = _array(path, values)
        if array.ndim < 2 or array.size == 0 or array.shape[-1] != 4 or array.size % 16:
            raise InputError(f"{path}: expected camera poses of 4 x 4 numbers, got shape {array.shape}")
        for T in array.reshape(-1, 4, 4):
            turn = T[:3, :3]
            rigid = (
                np.isfinite(T).all() and np.abs(turn @ turn.T - np.eye(3)).max() < _RIGID and np.linalg.det(turn) > 0
            )
            if not rigid or not np.allclose(T[3], [0, 0, 0, 1]):
                raise InputError(f"{path}: expected a rotation, a translation and 0 0 0 1, got {T.round(4).tolist()}")
            poses.append(T)
    return np.array(poses)


def camera_of(depth: np.ndarray, K: np.ndarray, size: tuple[int, int] | None, T: np.ndarray, name: str) -> Camera:
    """The camera of a depth image (H, W).

    Raises:
        InputError: K is of an image of another size: by the `size` (width, height) that its file states or, without,
            by its principal point, which no sensor has far from the middle of its image.
    """
    height, width = depth.shape
    if size is not None and size != (width, height):
        raise InputError(
            f"{name}: expected K of an image of {width} x {height} pixels, got one of {size[0]} x {size[1]}"
        )
    off = np.abs(K[:2, 2] / (width, height) - 0.5)
    if size is None and (off > _OFF_CENTRE).any():
        raise InputError(
            f"{name}: expected K of an image of {width} x {height} pixels, got the principal point "
            f"({K[0, 2]:g}, {K[1, 2]:g}) far from its middle; for a cut-out give K as JSON with width and height"
        )
    return Camera(K, T, width, height)


def every(depth: np.ndarray, camera: Camera, stride: int) -> tuple[np.ndarray, Camera]:
    """Every `stride`-th row and column of a depth image, and the camera that sees just these."""
    fewer = depth[::stride, ::stride]
    K = camera.K.copy()
    K[:2] /= stride
    return fewer, replace(camera, K=K, width=fewer.shape[1], height=fewer.shape[0])


def learned_stride(depth: np.ndarray, K: np.ndarray, sensing: SensingConfig) -> int:
    """The stride that sets pixels as far apart on what is seen as those of the camera that the model learned from.

    Args:
        depth: of the pixels that matter, any shape, m, all above 0.
    """
    apart = float(np.median(depth)) / K[0, 0]
    return max(1, round(sensing.distance / sensing.focal / apart))


def pixel_points(depth: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W, 3) m: where the pixels of a depth image lie, in the frame that the camera's pose refers to."""
    T = camera.T_object_camera
    return (depth[..., None] * camera.rays()) @ T[:3, :3].T + T[:3, 3]


def surface(depth: np.ndarray, camera: Camera, sensing: SensingConfig, name: str) -> Cloud:
    """The oriented surface points of one depth image, in the frame that the camera's pose refers to."""
    points, normals = surface_points(depth, camera.rays(), sensing)
    rotation, translation = camera.T_object_camera[:3, :3], camera.T_object_camera[:3, 3]
    return Cloud(points @ rotation.T + translation, normals @ rotation.T, translation[None], name)


def _image(path: Path, limit: int, formats: tuple[str, ...]) -> np.ndarray:
    """The pixels of an image, whose size is looked at first; other formats, some of which are programs, stay closed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(existing(path), formats=formats)
        with image:
            _check_pixels(path, (image.height, image.width), limit)
            return np.asarray(image)
    except InputError:
        raise
    except Exception as error:  # each format's reader raises its own kinds for a damaged file
        raise unreadable(path, "a whole image", error, "a damaged one") from None


def _check_pixels(path: Path, shape: tuple[int, ...], limit: int) -> None:
    if shape[0] * shape[1] > limit:
        raise InputError(f"{path}: expected at most {limit} pixels (max_points), got {shape[1]} x {shape[0]}")


def _numbers(path: Path) -> np.ndarray:
    array = npy_array(path)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{path}: expected an array of numbers, got {array.dtype}")
    return array


def _structured(path: Path) -> Any:
    """What a .json, .yaml, .npy or text file of numbers holds."""
    what, suffix = "numbers as text, JSON, YAML or .npy", path.suffix.lower()
    if suffix == ".npy":
        return _numbers(path)
    if suffix == ".json":
        return json_values(path, what)
    if suffix in (".yaml", ".yml"):
        return yaml_values(path, what)
    rows = [line.split("#")[0].replace(",", " ").split() for line in text(path, what).splitlines()]
    try:
        return [[float(word) for word in row] for row in rows if row]
    except ValueError as error:
        raise unreadable(path, what, error) from None


def _matrix_of(path: Path, values: dict[str, Any]) -> Any:
    """The entry of a mapping that is K."""
    for key in ("camera_matrix", "K", "k", "intrinsic_matrix"):
        if key in values:
            matrix = values[key]
            return matrix.get("data") if isinstance(matrix, dict) else matrix
    fx, fy = values.get("fx"), values.get("fy")
    cx, cy = (values.get(key, values.get("pp" + key[1])) for key in ("cx", "cy"))
    if None in (fx, fy, cx, cy):
        keys = "camera_matrix, K, k, intrinsic_matrix or fx, fy, cx, cy"
        raise InputError(f"{path}: expected one of {keys}; got {', '.join(map(str, values)) or 'nothing'}")
    return [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]


def _array(path: Path, values: Any) -> np.ndarray:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: expected a matrix of numbers, got {str(values)[:80]}") from None
