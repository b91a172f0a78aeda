"""Small files of calibrations and poses, known by what is in them: JSON, YAML, numbers as text, numpy's, MATLAB's."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.reading import LARGEST_YAML, existing, json_of, npz_arrays, npz_headers, text, unreadable, yaml_of
from spgf_torch.scene.images import numbers

WHAT = "numbers as text, JSON, YAML or .npy"
# What `ros2 topic echo` writes between messages, without a line break after it.
_LOST = re.compile(r"A message was lost!!!\s+total count change:\s*\d+\s+total count:\s*\d+")
# Between numbers; brackets are what numpy prints around them.
_SEPARATORS = str.maketrans(",;[]", "    ")
_ASSIGNMENT = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*(?=\S)", re.MULTILINE)
_DOCUMENT = re.compile(r"^(?:---|\.\.\.)[ \t]*$", re.MULTILINE)
_MATLAB = (b"MATLAB 5.0", b"MATLAB 7.3")
_LARGEST_MATLAB = 64_000_000  # bytes, unpacked
_MOST_NUMBERS = 1_000_000  # of an array of poses


def structured(path: Path, keys: tuple[str, ...] = ()) -> Any:
    """What a file of numbers holds: a list, an array, or a mapping.

    Of several YAML documents, as `rostopic echo` writes them, the first.

    Args:
        keys: the arrays of a .npz or .mat that are wanted; others stay packed.

    Raises:
        InputError: none of the formats, damaged, too large.
    """
    with existing(path).open("rb") as stream:
        head = stream.read(16)
    if head.startswith(b"\x93NUMPY"):
        return numbers(path)
    if head.startswith(b"PK\x03\x04"):
        there = npz_headers(path)
        wanted = [key for key in keys if key in there]
        if not wanted:
            raise InputError(f"{path}: expected an array {' or '.join(keys[:4])}, got {', '.join(there) or 'nothing'}")
        return npz_arrays(path, wanted, _MOST_NUMBERS)
    if head.startswith(_MATLAB):
        return _matlab(path, keys)
    if path.suffix.lower() == ".npy":
        return numbers(path)  # which says that it is damaged
    content = text(path, WHAT)
    if content.lstrip()[:1] in ("{", "["):
        try:
            return json_of(content, path, WHAT)
        except InputError:
            if path.suffix.lower() == ".json":
                raise  # others: numbers as numpy prints them, or YAML
    rows, error = _rows(content)
    if rows is not None:
        return rows
    return _yaml(path, content, error)


def number_array(path: Path, values: Any) -> np.ndarray:
    """A float64 array; InputError where `values` are no numbers."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: expected a matrix of numbers, got {str(values)[:80]}") from None


def _rows(content: str) -> tuple[list[list[float]] | None, ValueError | None]:
    """Rows of numbers as text, or why it is none."""
    lines = [line.split("#")[0].translate(_SEPARATORS).split() for line in content.splitlines()]
    try:
        return [[float(word) for word in line] for line in lines if line], None
    except ValueError as error:
        return None, error


def _yaml(path: Path, content: str, error: ValueError | None) -> Any:
    plain = _LOST.sub("\n", content).replace("!!opencv-matrix", "").replace("\t", "  ")
    plain = re.sub(r"^%YAML.*$", "", plain, flags=re.MULTILINE)
    documents = [part for part in _DOCUMENT.split(plain) if re.sub(r"(?m)#.*$", "", part).strip()]
    if len(content) > LARGEST_YAML or not documents:
        raise InputError(f"{path}: expected {WHAT} of at most {LARGEST_YAML} bytes, got {len(content)}")
    values = yaml_of(_ASSIGNMENT.sub(r"\1: ", documents[0]), path, WHAT)
    if not isinstance(values, dict | list):
        raise unreadable(path, WHAT, error or ValueError("a word"))
    return values


def _matlab(path: Path, keys: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The arrays of numbers in a MATLAB file of version 5 that `keys` names, each no larger than a pose or two."""
    import scipy.io

    content = path.read_bytes() if path.stat().st_size <= _LARGEST_MATLAB else b""
    if not content or content.startswith(b"MATLAB 7.3") or _unpacked(content) > _LARGEST_MATLAB:
        raise InputError(
            f"{path}: expected a MATLAB file of version 5 (save -v7) of at most {_LARGEST_MATLAB} bytes, got another; "
            "write K as text"
        )
    try:
        there = {name: (shape, kind) for name, shape, kind in scipy.io.whosmat(path)}
        plain = ("double", "single", "logical", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
        wanted = [name for name in keys if name in there and there[name][1] in plain and np.prod(there[name][0]) <= 64]
        if not wanted:
            raise InputError(f"{path}: expected an array {' or '.join(keys[:4])}, got {', '.join(there) or 'nothing'}")
        loaded = scipy.io.loadmat(path, variable_names=wanted)
        return {name: np.squeeze(np.asarray(loaded[name], dtype=np.float64)) for name in wanted}
    except InputError:
        raise
    except Exception as error:  # scipy lets through what each of its parsers raises
        raise unreadable(path, "a MATLAB file", error, "a damaged one") from None


def _unpacked(content: bytes) -> int:
    """Bytes of a MATLAB file with its packed elements (type 15) unpacked, counted little beyond the limit."""
    at, total = 128, 0
    order = "<" if content[126:128] == b"IM" else ">"
    while at + 8 <= len(content) and total <= _LARGEST_MATLAB:
        kind, size = np.frombuffer(content, order + "u4", 2, at)
        total += int(size)
        if kind == 15:
            try:
                total += len(zlib.decompressobj().decompress(content[at + 8 : at + 8 + int(size)], _LARGEST_MATLAB + 1))
            except zlib.error:
                return total  # scipy says what is wrong
        at += 8 + int(size)
    return total
