"""What is a target: masks and label images of depth images, and masks and labels of a cloud's points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.reading import npz_arrays, npz_headers, text
from spgf_torch.scene.cloud import check_count
from spgf_torch.scene.images import check_pixels, image_pixels, numbers

# Formats of masks; pillow reads others, such as PostScript, by running programs.
MASKS = ("PNG", "JPEG", "BMP", "TIFF", "PPM")
# JPEG changes values: good enough for a mask, not for numbers.
LABEL_IMAGES = ("PNG", "BMP", "TIFF", "PPM")
# A mask that marks a smaller or a larger share is noted: it may be of something else, or inverted.
_LEAST, _MOST = 0.001, 0.9
_LABEL_KEYS = ("segmap", "seg", "segments", "labels", "label", "mask", "arr_0")


def read_mask(path: Path, limit: int) -> np.ndarray:
    """(H, W) bool, or (N,) for a cloud's points: which of a mask's values are not 0.

    An image (PNG, JPEG, BMP, TIFF, PPM) whose colours say nothing and whose alpha channel does is a mask by alpha.

    Args:
        path: an image; .npy or .npz of (H, W), (H, W, 1), (1, H, W) or (N,); text of one number a point.
        limit: pixels at most.
    """
    values = _values(path, limit, MASKS)
    if values.ndim == 3:
        values = _one_channel(path, values)
    return np.nan_to_num(values) != 0


def read_labels(path: Path, limit: int) -> np.ndarray:
    """(H, W) or (N,) int32: the number of the target that each pixel or point is of, 0: an obstacle.

    Args:
        path: an image of one channel, 8 or 16 bits; .npy or .npz of (H, W), (H, W, 1), (1, H, W) or (N,); text.
        limit: pixels at most.
    """
    values = _values(path, limit, LABEL_IMAGES)
    if values.ndim == 3:
        raise InputError(f"{path}: expected labels of one channel, a number a pixel, got {values.shape[2]} (colours?)")
    return label_array(str(path), values)


def label_array(name: str, values: np.ndarray) -> np.ndarray:
    """Whole numbers as int32, what is below 0 as 0: of no target."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name}: expected labels that are whole numbers, got {array.dtype}")
    if array.dtype.kind == "f" and not (np.isfinite(array).all() and (array == np.round(array)).all()):
        raise InputError(f"{name}: expected labels that are whole numbers, got fractions, NaN or infinity")
    if array.size and array.max() > np.iinfo(np.int32).max:
        raise InputError(f"{name}: expected labels below 2^31, got {array.max():g}")
    return np.maximum(array, 0).astype(np.int32)


def fitting(name: str, values: np.ndarray, shape: tuple[int, ...], whose: str) -> np.ndarray:
    """`values` in `shape`, (H, W) or (N,): axes of length 1 are added or left out; InputError for another shape."""
    trimmed = tuple(n for n in values.shape if n != 1)
    flat = values.ndim == 1 and values.size == np.prod(shape)
    if not flat and trimmed != tuple(n for n in shape if n != 1):
        what = "pixels" if len(shape) == 2 else "values"
        raise InputError(f"{name}: expected {shape} {what} as {whose} has, got {values.shape}")
    return values.reshape(shape)


def marked(name: str, mask: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Labels of a mask, 1 where it marks the target, and a line where it marks everything or nearly nothing.

    Raises:
        InputError: it marks nothing.
    """
    share = float(mask.mean()) if mask.size else 0.0
    if not share:
        raise InputError(f"{name}: expected pixels above 0, which mark the target; got none")
    notes: tuple[str, ...] = ()
    if not _LEAST <= share <= _MOST:
        inverted = "; inverted?" if share > _MOST else ""
        notes = (f"mask {name} marks {int(mask.sum())} of {mask.size} values as the target{inverted}",)
    return mask.astype(np.int32), notes


def numbered(name: str, labels: np.ndarray, among: str = "") -> np.ndarray:
    """Labels with at least one target in them; InputError otherwise, which says among what none is."""
    if not (labels > 0).any():
        where = f" among the {among}" if among else ""
        raise InputError(f"{name}: expected labels above 0, which number the targets; got none{where}")
    return labels


def _values(path: Path, limit: int, formats: tuple[str, ...]) -> np.ndarray:
    """(H, W), (H, W, channels) or (N,) values of a mask or label file."""
    suffix = path.suffix.lower()
    if suffix in (".txt", ".csv", ".xyz", ".labels"):
        return _words(path, limit)
    if suffix not in (".npy", ".npz"):
        return image_pixels(path, limit, formats)
    if suffix == ".npy":
        values = numbers(path)
    else:
        there = npz_headers(path)
        key = next((key for key in _LABEL_KEYS if key in there), None)
        if key is None:
            raise InputError(f"{path}: expected one of {', '.join(_LABEL_KEYS)}; got {', '.join(there) or 'nothing'}")
        values = npz_arrays(path, (key,), limit)[key]
    if values.ndim == 3 and 1 in (values.shape[0], values.shape[2]):
        values = values.reshape(values.shape[1:] if values.shape[0] == 1 else values.shape[:2])
    if values.ndim not in (1, 2, 3) or not values.size or values.dtype.kind not in "fiub":
        raise InputError(f"{path}: expected numbers (H, W) or one a point, got {values.dtype} of shape {values.shape}")
    if values.ndim > 1:
        check_pixels(path, values.shape, limit)
    else:
        check_count(path, len(values), limit)
    return np.asarray(values)


def _words(path: Path, limit: int) -> np.ndarray:
    words = text(path, "one number a point").replace(",", " ").split()
    check_count(path, len(words), limit)
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        raise InputError(f"{path}: expected one number a point, got other words") from None


def _one_channel(path: Path, pixels: np.ndarray) -> np.ndarray:
    """(H, W) that is not 0 where a colour is; where no colour tells two pixels apart, the alpha channel's values."""
    colours, alpha = pixels[..., :3], pixels[..., 3:]
    if pixels.shape[2] == 2:  # grey and alpha
        colours, alpha = pixels[..., :1], pixels[..., 1:]
    if pixels.shape[2] > 4:
        raise InputError(f"{path}: expected a mask (H, W), got shape {pixels.shape}")
    constant = (colours == colours[:1, :1]).all()
    if constant and alpha.size and (alpha != alpha[:1, :1]).any():
        return alpha[..., 0]
    return np.any(colours != 0, axis=-1)
