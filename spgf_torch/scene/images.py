"""Pixels and numbers of files, bounded before they are taken in."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from spgf_torch.errors import InputError
from spgf_torch.files.reading import existing, npy_array, unreadable


def image_pixels(path: Path, limit: int, formats: tuple[str, ...]) -> np.ndarray:
    """The pixels of an image, whose size is looked at first; other formats, some of which are programs, stay closed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(existing(path), formats=formats)
        with image:
            check_pixels(path, (image.height, image.width), limit)
            if image.format == "TIFF" and getattr(image, "n_frames", 1) > 1:
                raise InputError(f"{path}: expected one image, got a file of several pages; save the one alone")
            return np.asarray(image)
    except InputError:
        raise
    except Exception as error:  # each format's reader raises its own kinds for a damaged file
        raise unreadable(path, "a whole image", error, "a damaged one") from None


def check_pixels(path: Path, shape: tuple[int, ...], limit: int) -> None:
    """InputError for more than `limit` pixels."""
    if shape[0] * shape[1] > limit:
        raise InputError(f"{path}: expected at most {limit} pixels (max_points), got {shape[1]} x {shape[0]}")


def numbers(path: Path) -> np.ndarray:
    """The array of a .npy file, which holds numbers."""
    array = npy_array(path)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{path}: expected an array of numbers, got {array.dtype}")
    return array
