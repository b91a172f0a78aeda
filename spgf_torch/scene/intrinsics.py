"""Camera intrinsics from users' files: what K is, of which image, and what else the file says of its depth images."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.calibration_files import number_array, structured

_MATRICES = (
    "K", "intrinsic_matrix", "cam_K", "camera_matrix", "k", "intrinsicMatrix", "cameraMatrix", "camera_intrinsics",
    "camera_intrinsic", "intrinsics", "intrinsic", "_K", "mtx",
)  # fmt: skip
_SCALES = ("depth_scale", "factor_depth", "depth_units", "depthScale")
_NPZ = (*_MATRICES, *_SCALES, "arr_0")
_PROJECTIONS = ("projection_matrix", "P", "p")
_DISTORTIONS = ("distortion_coefficients", "D", "d", "coeffs", "dist_coeffs", "dist")
# A mapping within a mapping, as Open3D, RealSense and Azure write the intrinsics.
_INNER = ("intrinsic", "intrinsics", "camera", "depth", "color", "parameters")
# P and K that differ by less are the same but for rounding.
_SAME = 1e-3
# Pixels; a focal length below is one of a normalised image of width 1.
_NORMALISED = 5.0


@dataclass(frozen=True)
class Intrinsics:
    """What a file says of a camera.

    Attributes:
        K: (3, 3) in pixels of the rectified image.
        size: (width, height) of the image that K is of; None: not stated.
        depth_scale: m per count of the depth images; None: not stated.
        notes: what was taken for what, a line each.
        roi: x, y, width and height of the part that images show, in pixels of `size`; None: the whole.
        binning: pixels of `size` that became one, across and down.
    """

    K: np.ndarray
    size: tuple[int, int] | None = None
    depth_scale: float | None = None
    notes: tuple[str, ...] = ()
    roi: tuple[int, int, int, int] | None = None
    binning: tuple[int, int] = (1, 1)

    def of_image(self, width: int, height: int, name: str) -> Intrinsics:
        """The intrinsics of an image of `width` x `height` pixels: these, or those of their binned or cut part.

        Raises:
            InputError: the file states other sizes.
        """
        if self.size is None or self.size == (width, height):
            return self
        x, y, across, down = self.roi or (0, 0, *self.size)
        reduced = (across // self.binning[0], down // self.binning[1])
        if reduced != (width, height):
            stated = " or ".join(f"{w} x {h}" for w, h in dict.fromkeys((self.size, reduced)))
            raise InputError(f"{name}: expected K of an image of {width} x {height} pixels, got one of {stated}")
        K = self.K.copy()
        K[:2, 2] -= (x, y)
        K[:2] /= np.array(self.binning)[:, None]
        note = (
            f"K of {self.size[0]} x {self.size[1]} pixels brought to {width} x {height} by the file's binning and roi"
        )
        return replace(self, K=K, size=(width, height), roi=None, binning=(1, 1), notes=(*self.notes, note))


def read_intrinsics(path: Path, image: Path | None = None) -> Intrinsics:
    """The intrinsics in a file, whose format is known by what is in it.

    Formats: nine numbers or fx fy cx cy as text or .npy; JSON, YAML or .npz with a 3x3 list, nine numbers, or a mapping
    with one of `camera_matrix` (ROS camera_info files: its `data`), `K`, `k` (ROS messages, also as `rostopic echo`
    writes them), `intrinsic_matrix` (Open3D: nine numbers column by column), `cam_K` (BOP), or with fx, fy and cx, cy
    (RealSense: ppx, ppy); MATLAB files with `intrinsic_matrix` (GraspNet). Where a ROS file has a P, which is of the
    rectified image, and it differs from K, it is P.

    Args:
        image: the depth image, whose number chooses among the cameras of a BOP scene.

    Raises:
        InputError: none of these, K not 3x3, not finite, a focal length not above 0, a last row other than 0 0 1.
    """
    values = structured(path, _NPZ)
    if not isinstance(values, dict):
        return Intrinsics(checked_K(str(path), number_array(path, values)))
    return intrinsics_of(path, _of_trajectory(path, _of_scene(path, values, image)))


def given_intrinsics(values: Any) -> Intrinsics:
    """The intrinsics that are the setting itself: [fx, fy, cx, cy], nine numbers or three rows of three."""
    return Intrinsics(checked_K("intrinsics", number_array(Path("intrinsics"), values)))


def checked_K(name: str, values: np.ndarray) -> np.ndarray:  # noqa: N802
    """(3, 3) float64 K of 3x3 numbers or of fx fy cx cy; InputError for anything else."""
    K = np.squeeze(np.asarray(values, dtype=np.float64))
    if K.shape == (4,):
        fx, fy, cx, cy = K
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if K.size != 9 or K.ndim > 2:
        raise InputError(f"{name}: expected K with 3 x 3 numbers, or fx fy cx cy; got shape {np.shape(values)}")
    K = K.reshape(3, 3)
    if not np.isfinite(K).all():
        raise InputError(f"{name}: expected K with finite numbers, got {K.ravel().tolist()}")
    if np.array_equal(K[:, 2], [0, 0, 1]) and K[2, :2].all():  # column by column
        K = K.T.copy()
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(f"{name}: expected focal lengths above 0 in K, got {K[0, 0]:g} and {K[1, 1]:g}")
    if not np.array_equal(K[2], [0, 0, 1]) or K[1, 0] != 0:
        raise InputError(f"{name}: expected K = fx s cx; 0 fy cy; 0 0 1, got {K.ravel().tolist()}")
    if max(K[0, 0], K[1, 1], *K[:2, 2]) < _NORMALISED:
        raise InputError(
            f"{name}: expected K in pixels, got focal lengths of {K[0, 0]:g} and {K[1, 1]:g} (of an image of width 1? "
            "then multiply by its width and height)"
        )
    return K


def _of_scene(path: Path, values: dict[Any, Any], image: Path | None) -> dict[Any, Any]:
    """The camera of one image where a file has those of a whole scene, by the images' numbers, as BOP writes them."""
    if not values or not all(str(key).isdecimal() and isinstance(entry, dict) for key, entry in values.items()):
        return values
    entries = {int(key): entry for key, entry in values.items()}
    digits = re.search(r"(\d{1,18})\D*$", image.stem) if image is not None else None
    if digits and int(digits[1]) in entries:
        return entries[int(digits[1])]
    about = [{key: entry.get(key) for key in ("cam_K", "depth_scale")} for entry in entries.values()]
    if all(each == about[0] for each in about):
        return next(iter(entries.values()))
    listed = ", ".join(map(str, list(entries)[:5])) + (", ..." if len(entries) > 5 else "")
    got = "none" if image is None else image.name
    raise InputError(f"{path}: expected a depth image named by its number, one of {listed}; got {got}")


def _of_trajectory(path: Path, values: dict[Any, Any]) -> dict[Any, Any]:
    """The camera of an Open3D camera trajectory, where all have the same intrinsics."""
    cameras = values.get("parameters")
    if not isinstance(cameras, list) or not cameras or not all(isinstance(each, dict) for each in cameras):
        return values
    if any(each.get("intrinsic") != cameras[0].get("intrinsic") for each in cameras):
        raise InputError(f"{path}: expected one camera, got {len(cameras)} of several intrinsics; give a file of each")
    return cameras[0]


def intrinsics_of(path: Path, values: dict[Any, Any]) -> Intrinsics:
    """The intrinsics of a mapping, as `read_intrinsics` gives those of a file; `path`: for errors."""
    K, inner = _matrix(path, values)
    notes: list[str] = []
    P = _plain(path, values, _PROJECTIONS, 12)
    raw = None if K is None else number_array(path, K)
    if P is not None and P.any():
        P = P.reshape(3, 4)[:, :3]
        if raw is None or not raw.any():
            notes.append("K is 0 or missing: that of P, the rectified image, taken")
            raw = P
        elif raw.size == 9 and np.abs(raw.reshape(3, 3) - P).max() > _SAME * np.abs(P).max():
            off = float(np.abs(raw.ravel()[[0, 4]] / P[[0, 1], [0, 1]] - 1).max())
            notes.append(
                f"P taken, which is of the rectified image and differs from K (focal length by {off:.0%}); for an "
                "image that is not rectified give K alone"
            )
            raw = P
    if raw is None:
        keys = "camera_matrix, K, k, intrinsic_matrix, cam_K or fx, fy, cx, cy"
        raise InputError(f"{path}: expected one of {keys}; got {', '.join(map(str, values)) or 'nothing'}")
    sizes = {**values, **inner}
    distortion = _plain(path, sizes, _DISTORTIONS, None)
    if distortion is not None and distortion.any():
        notes.append(
            f"distortion (coefficients up to {np.abs(distortion).max():.3g}) is not undone: rectified images expected"
        )
    if "extrinsic" in values:
        notes.append("the extrinsic beside K is not used; give poses=")
    scale, note = depth_scale_of({**_scales(values), **sizes})
    return Intrinsics(
        checked_K(str(path), raw), _size(sizes), scale, (*notes, *note), _roi(path, values), _binning(path, values)
    )


def _matrix(path: Path, values: dict[Any, Any], depth: int = 0) -> tuple[Any, dict[Any, Any]]:
    """The entry of a mapping that is K (None if there is none), and the mapping within in which it was found."""
    for key in _MATRICES:
        matrix = values.get(key)
        if isinstance(matrix, dict) and "data" in matrix:
            return matrix["data"], values
        if isinstance(matrix, str):
            return matrix, values
        if isinstance(matrix, np.ndarray) or (isinstance(matrix, list) and matrix):
            return matrix, values
    names = ("fx", "fy", "cx", "cy")
    for prefix in ("", "_"):
        found = [values.get(prefix + name, values.get(f"pp{name[1]}" if name[0] == "c" else name)) for name in names]
        if None not in found:
            fx, fy, cx, cy = found
            skew = values.get(f"{prefix}skew", 0) or 0
            return [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], values
    for key in _INNER:
        if depth < 3 and isinstance(values.get(key), dict):
            K, inner = _matrix(path, values[key], depth + 1)
            if K is not None:
                return K, {**values, **inner}
    return None, values


def _scales(values: dict[Any, Any], depth: int = 0) -> dict[str, Any]:
    """The depth scales that stand anywhere in a mapping of mappings."""
    found = {key: values[key] for key in _SCALES if key in values}
    for entry in values.values():
        if isinstance(entry, dict) and depth < 3:
            found = {**_scales(entry, depth + 1), **found}
    return found


def depth_scale_of(values: dict[Any, Any]) -> tuple[float | None, tuple[str, ...]]:
    """m per count that a calibration states, and a line on what was taken for what.

    BOP's `depth_scale` (0.1, 1.0) is mm per count; GraspNet's and YCB-Video's `factor_depth`, Open3D's and TUM's
    `depth_scale` (1000, 5000, 10000) are counts per metre; RealSense's depth scale and `depth_units` (0.001, 0.00025)
    are m per count. Their magnitudes do not overlap.
    """
    for key in _SCALES:
        if values.get(key) is None:
            continue
        given = values[key]
        if isinstance(given, str) and given in METRES:
            return METRES[given], (f"{key} {given}: {METRES[given]:g} m per count",)
        try:
            number = float(np.squeeze(np.asarray(given, dtype=np.float64)))
        except (TypeError, ValueError, OverflowError):
            return None, (f"{key} {str(given)[:20]} is not understood and not used",)
        if 100 <= number <= 1e6:
            return 1 / number, (f"{key} {number:g} read as counts per metre: {1 / number:g} m per count",)
        if 0.01 <= number <= 10 and key in ("depth_scale", "depthScale"):
            return number * 1e-3, (
                f"{key} {number:g} read as mm per count, as BOP has it: {number * 1e-3:g} m per count",
            )
        if 1e-6 <= number < 0.01:
            return number, (f"{key} {number:g} read as m per count",)
        return None, (f"{key} {number:g} is not understood and not used; give depth_scale= in m per count",)
    return None, ()


def _size(values: dict[Any, Any]) -> tuple[int, int] | None:
    width, height = (
        str(values.get(f"image_{key}", values.get(key, values.get(f"_{key}")))) for key in ("width", "height")
    )
    digits = width.isdecimal() and height.isdecimal() and max(len(width), len(height)) < 10
    return (int(width), int(height)) if digits and int(width) and int(height) else None


def _plain(path: Path, values: dict[Any, Any], keys: tuple[str, ...], count: int | None) -> np.ndarray | None:
    """The numbers under one of the keys, in a row; None where there are none, or not `count`."""
    for key in keys:
        entry = values.get(key)
        entry = entry.get("data") if isinstance(entry, dict) else entry
        if isinstance(entry, list | np.ndarray):
            array = number_array(path, entry).ravel()
            if count in (None, array.size) and np.isfinite(array).all():
                return array
    return None


def _roi(path: Path, values: dict[Any, Any]) -> tuple[int, int, int, int] | None:
    roi = values.get("roi")
    if not isinstance(roi, dict):
        return None
    numbers = [roi.get(key, 0) for key in ("x_offset", "y_offset", "width", "height")]
    if not all(isinstance(number, int) and number >= 0 for number in numbers):
        raise InputError(f"{path}: roi: expected whole numbers x_offset, y_offset, width, height; got {numbers}")
    x, y, width, height = numbers
    return (x, y, width, height) if width and height else None


def _binning(path: Path, values: dict[Any, Any]) -> tuple[int, int]:
    both = [values.get(f"binning_{axis}", 0) for axis in "xy"]
    if not all(isinstance(number, int) and number >= 0 for number in both):
        raise InputError(f"{path}: expected whole numbers binning_x, binning_y; got {both}")
    return max(1, both[0]), max(1, both[1])
