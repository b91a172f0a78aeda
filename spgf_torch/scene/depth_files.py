"""Files of depth images: counts or metres a pixel, and the intrinsics that some have beside them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.reading import existing, npy_array, npz_arrays, npz_headers
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.images import check_pixels, image_pixels, numbers
from spgf_torch.scene.intrinsics import Intrinsics, checked_K, depth_scale_of

IMAGES = (".png", ".tif", ".tiff", ".pgm", ".pfm")
_SUFFIXES = (*IMAGES, ".npy", ".npz")
# First bytes of a file -> pillow's name of the format; PGM is read below, as pillow changes counts by their maximum.
_FORMATS = {b"\x89PNG": "PNG", b"II*\0": "TIFF", b"MM\0*": "TIFF", b"Pf": "PPM"}
_PGM = re.compile(rb"(P[25])(?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,5})\s")
_LONGEST_HEADER = 4096  # bytes
_LONGEST_WORD = 8  # bytes of a number as text, blanks included
# A 16-bit image's highest value says "too far" or "not measured" in most drivers.
_SATURATED = 65535
_DEPTHS = ("depth", "depth_image", "depth_map", "depths", "arr_0")
_KS = ("K", "k", "intrinsic_matrix", "camera_matrix", "intrinsics", "cam_K", "camera_K")
_SCALES = ("depth_scale", "factor_depth")
_SEGMENTS = ("segmap", "seg", "segmentation", "segments", "mask")
_POINTS = ("points", "xyz", "pc", "pcd")
# m per count where nothing else is given: ROS (REP 118), RealSense D400, Azure and Kinect write millimetres.
MILLIMETRES = 0.001
# Of a depth image, pixels at least on each side: fewer are columns of something else.
_LEAST_SIDE = 32


@dataclass(frozen=True)
class DepthFile:
    """A depth image as it lies on disk.

    Attributes:
        values: (H, W) counts or lengths; 0, negative or not finite: no return.
        counts: whole numbers, each of `depth_scale`; otherwise lengths in `unit`.
        intrinsics: those in the file; None: it has none.
        depth_scale: m per count that the file states.
        segments: the array of label numbers beside the depth; None: there is none.
        told: whether it must be said what a count was taken for, as arrays of whole numbers do not tell.
        notes: what was taken for what, a line each.
    """

    values: np.ndarray
    counts: bool
    intrinsics: Intrinsics | None = None
    depth_scale: float | None = None
    segments: str | None = None
    told: bool = False
    notes: tuple[str, ...] = ()


def is_depth(path: Path, config: SceneConfig) -> bool:
    """Whether a file is a depth image: by `config.intrinsics`, its suffix or, of numpy's files, what is in it."""
    suffix = path.suffix.lower()
    if config.intrinsics is not None or suffix in IMAGES:
        return True
    if suffix == ".npz":
        headers = npz_headers(path)
        return _depth_key(headers) is not None and not any(key in headers for key in _POINTS)
    if suffix != ".npy":
        return False
    array = numbers(path) if _starts(path, b"\x93NUMPY") and not _structured(path) else np.empty(0)
    return _image_shape(array.shape) and array.shape[-1] != 3


def read_depth_file(path: Path, limit: int) -> DepthFile:
    """A depth image.

    Formats: PNG, PGM and TIFF of 16 bits (or TIFF of 32-bit integers) and one channel: counts; TIFF and PFM of floats;
    .npy (H, W), (H, W, 1) or (1, H, W) of floats or of counts (whole numbers of 16 bits or more); .npz of such `depth`
    and, if known, `K`. 65535 of 16 bits counts as no return.

    Args:
        limit: pixels at most.

    Raises:
        InputError: another format, size or number of bits, a damaged file.
    """
    with existing(path).open("rb") as stream:
        head = stream.read(8)
    if head.startswith((b"P5", b"P2")):
        return _of_pixels(path, _pgm(path, limit))
    kind = next((kind for magic, kind in _FORMATS.items() if head.startswith(magic)), None)
    suffix = path.suffix.lower()
    if kind is not None or suffix in IMAGES:
        return _of_pixels(path, image_pixels(path, limit, (kind or {".png": "PNG"}.get(suffix, "TIFF"),)))
    if suffix not in _SUFFIXES:
        raise InputError(
            f"{path}: expected a depth image ({', '.join(_SUFFIXES)}), since intrinsics are given; got "
            f"{suffix or 'no suffix'} (a cloud or a mesh? then leave intrinsics out)"
        )
    if suffix == ".npz":
        return _of_npz(path, limit)
    return _of_array(path, "depth", numbers(path), limit)


def in_metres(
    file: DepthFile, scale: float | None, unit: str, stated: Intrinsics | None
) -> tuple[np.ndarray, list[str]]:
    """(H, W) float64 depth, m, and lines on what a count was taken for.

    Args:
        scale: m per count that the user gives, which wins; None: what the camera's file says, else a millimetre.
        unit: of lengths, m, cm or mm; of counts too where it is not m.
        stated: the camera's file.
    """
    if not file.counts and scale is not None:
        raise InputError(
            f"depth_scale: expected with whole numbers, which are counts, got {scale:g} for floats; unit= is theirs"
        )
    used = metres_a_count(file, scale, unit, stated)
    if used is None:
        return file.values.astype(np.float64) * METRES[unit], []
    known, wanted = _stated(file, stated), _wanted(scale, unit)
    notes = []
    if wanted is not None and known is not None and not np.isclose(wanted, known):
        key = f"depth_scale={scale:g}" if scale is not None else f"unit={unit}"
        notes.append(f"{key} taken: {wanted:g} m per count; the camera's file says {known:g}")
    elif scale is None and wanted not in (None, MILLIMETRES):
        notes.append(f"unit={unit} taken: {wanted:g} m per count")
    if file.told:
        notes.append(f"depth of whole numbers taken as counts of {used:g} m")
    values = file.values.astype(np.float64)
    if file.values.dtype.itemsize == 2 or file.values.max(initial=0) == _SATURATED:
        values = np.where(values == _SATURATED, 0.0, values)
    return values * used, notes


def metres_a_count(file: DepthFile, scale: float | None, unit: str, stated: Intrinsics | None) -> float | None:
    """m that a count is taken for, arguments as of `in_metres`; None: the numbers are lengths."""
    told = _wanted(scale, unit), _stated(file, stated), MILLIMETRES
    return next(each for each in told if each is not None) if file.counts else None


def _wanted(scale: float | None, unit: str) -> float | None:
    return scale if scale is not None else METRES[unit] if unit != "m" else None


def _stated(file: DepthFile, stated: Intrinsics | None) -> float | None:
    return file.depth_scale if stated is None or stated.depth_scale is None else stated.depth_scale


def counts_array(name: str, array: np.ndarray) -> bool:
    """Whether numbers are counts (whole numbers) or lengths (floats); InputError for what can be neither."""
    if array.dtype.kind == "f":
        return False
    if array.dtype.kind not in "iu" or array.dtype.itemsize < 2:
        raise InputError(f"{name}: expected floats or whole numbers of 16 bits or more, got {array.dtype}")
    return True


def flat(name: str, array: np.ndarray) -> np.ndarray:
    """(H, W) of a depth image (H, W), (H, W, 1) or (1, H, W); InputError for another shape."""
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    elif array.ndim == 3 and array.shape[0] == 1:
        array = array[0]
    if array.ndim != 2:
        raise InputError(f"{name}: expected a depth image (H, W), (H, W, 1) or (1, H, W), got shape {array.shape}")
    return array


def _of_pixels(path: Path, pixels: np.ndarray) -> DepthFile:
    if pixels.ndim != 2 or (pixels.dtype.kind != "f" and pixels.dtype.itemsize < 2):
        bits, channels = 8 * pixels.dtype.itemsize, pixels.shape[2] if pixels.ndim == 3 else 1
        remedy = "depth packed into colours? unpack it" if channels > 1 else "made to be looked at? write the depth"
        raise InputError(
            f"{path}: expected 16 bits and one channel, got {bits} bits and {channels} channels; {remedy} as a 16-bit "
            "PNG or as .npy in m"
        )
    return DepthFile(pixels, pixels.dtype.kind in "iu")


def _of_array(path: Path, name: str, array: np.ndarray, limit: int) -> DepthFile:
    array = flat(str(path), array)
    check_pixels(path, array.shape, limit)
    if array.shape[1] == 3 < array.shape[0]:
        raise InputError(f"{path}: expected a depth image (H, W), got {len(array)} points; leave intrinsics out")
    if not counts_array(f"{path}: {name}", array):
        return DepthFile(array, False)
    return DepthFile(array, True, told=True)


def _of_npz(path: Path, limit: int) -> DepthFile:
    headers = npz_headers(path)
    key = _depth_key(headers)
    if key is None:
        got = ", ".join(f"{name} {shape}" for name, (shape, _) in headers.items()) or "nothing"
        raise InputError(f"{path}: expected an array named depth of shape (H, W), got {got}")
    beside = [name for name in (*_KS, *_SCALES) if name in headers and np.prod(headers[name][0]) <= 16]
    arrays = npz_arrays(path, (key, *beside), limit)
    if arrays[key].dtype.kind not in "fiub":
        raise InputError(f"{path}: {key}: expected numbers, got {arrays[key].dtype}")
    file = _of_array(path, key, arrays[key], limit)
    scale, notes = depth_scale_of({name: arrays[name] for name in _SCALES if name in arrays})
    K = next((arrays[name] for name in _KS if name in arrays and arrays[name].dtype.kind in "fiu"), None)
    segments = next((name for name in _SEGMENTS if name in headers), None)
    intrinsics = None if K is None else Intrinsics(checked_K(f"{path}: K", K))
    return replace(file, intrinsics=intrinsics, depth_scale=scale, segments=segments, notes=(*file.notes, *notes))


def _depth_key(headers: dict[str, tuple[tuple[int, ...], np.dtype]]) -> str | None:
    """The array of a .npz file that is a depth image."""
    named = next((key for key in _DEPTHS if key in headers and key != "arr_0"), None)
    if named is None and _image_shape(headers.get("arr_0", ((),))[0]):
        return "arr_0"
    return named


def _image_shape(shape: tuple[int, ...]) -> bool:
    sides = (
        shape[:2] if len(shape) == 3 and shape[2] == 1 else shape[1:] if len(shape) == 3 and shape[0] == 1 else shape
    )
    return len(sides) == 2 and min(sides) >= _LEAST_SIDE


def _pgm(path: Path, limit: int) -> np.ndarray:
    """(H, W) counts of a portable grey map as they stand there."""
    with path.open("rb") as stream:
        header = _PGM.match(stream.read(_LONGEST_HEADER))
        if not header:
            raise InputError(f"{path}: expected a whole image, got a damaged one (no PGM header)")
        width, height, most = (int(number) for number in header.groups()[1:])
        check_pixels(path, (height, width), limit)
        if not 255 < most <= 65535:
            raise InputError(f"{path}: expected 16 bits and one channel, got a PGM of values up to {most}")
        stream.seek(header.end())
        body = stream.read((2 if header[1] == b"P5" else _LONGEST_WORD) * width * height)
    if header[1] == b"P5":
        values = np.frombuffer(body[: len(body) // 2 * 2], ">u2").astype(np.uint16)
    else:
        values = np.array([int(word) if word.isdigit() and len(word) < 6 else 0 for word in body.split()])
        values = values.clip(0, 65535).astype(np.uint16)
    if len(values) < width * height:
        raise InputError(f"{path}: expected {width} x {height} pixels, got {len(values)}: the file is cut")
    return values[: width * height].reshape(height, width)


def _starts(path: Path, magic: bytes) -> bool:
    with existing(path).open("rb") as stream:
        return stream.read(len(magic)) == magic


def _structured(path: Path) -> bool:
    return npy_array(path).dtype.kind not in "fiub"
