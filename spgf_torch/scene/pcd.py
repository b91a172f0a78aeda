"""Point Cloud Data files of the Point Cloud Library, version 0.7: ascii, binary and binary_compressed.

Source: "The PCD (Point Cloud Data) file format", Point Cloud Library documentation; LibLZF 3.6 for the compression.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.ply import number_words
from spgf_torch.scene.cloud import Cloud, check_count, pixels_of
from spgf_torch.scene.colours import unpacked_colours

POINT, NORMAL = ("x", "y", "z"), ("normal_x", "normal_y", "normal_z")
COLOUR = ("rgb", "rgba")  # PCL's: 0xRRGGBB, with or without alpha above it, as the bits of a float or a whole number
_TYPES = {
    (k, s): f"<{k.lower()}{s}" for k, sizes in (("F", (4, 8)), ("I", (1, 2, 4, 8)), ("U", (1, 2, 4, 8))) for s in sizes
}
_LONGEST_HEADER = 1 << 16  # bytes
_LONGEST_NUMBER = 12  # digits; there are no more points than that
_IDENTITY = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Header:
    """What stands before the data.

    Attributes:
        fields: names, as written; `_` is padding.
        dtypes: numpy's, one a field.
        counts: values a field.
        width, height: height above 1: an image of points.
        viewpoint: translation and quaternion wxyz of the sensor, in the frame and unit of the points.
        data: ascii, binary or binary_compressed.
        size: bytes of the header, its last line break included.
    """

    fields: tuple[str, ...]
    dtypes: tuple[str, ...]
    counts: tuple[int, ...]
    width: int
    height: int
    viewpoint: tuple[float, ...]
    data: str
    size: int

    @property
    def points(self) -> int:
        return self.width * self.height


def read_pcd(path: Path, limit: int) -> Cloud:
    """The points of a PCD file, not yet checked, with its normals (normal_x or nx, ...) and viewpoint, in its unit.

    The identity VIEWPOINT is what writers put when they know none: it does not count.

    Args:
        limit: points at most.

    Raises:
        InputError: a header or data that are not as the specification says, x, y or z missing, a file cut in half.
    """
    with path.open("rb") as stream:
        header = _header(path, stream.read(_LONGEST_HEADER))
        check_count(path, header.points, limit)
        stream.seek(header.size)
        body = stream.read()
    names = [re.sub("^n(?=[xyz]$)", "normal_", field.lower()) for field in header.fields]
    if not set(POINT) <= set(names):
        raise InputError(f"{path}: FIELDS: expected x y z, got {' '.join(header.fields)}")
    wanted = POINT + NORMAL if set(NORMAL) <= set(names) else POINT
    for name in wanted:
        count = header.counts[names.index(name)]
        if count != 1 or names.count(name) > 1:
            got = f"got {count}" if count != 1 else f"got {names.count(name)} fields of this name"
            raise InputError(f"{path}: COUNT of {name}: expected 1, {got}")
    packed = [name for name in COLOUR if names.count(name) == 1 and _packs(header, names.index(name))][:1]
    header = _with_bits(header, [names.index(name) for name in packed])
    columns = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}[header.data](
        path, body, header, [names.index(name) for name in (*wanted, *packed)]
    )
    colours = _colours(columns[:, -1], header, names.index(packed[0])) if packed else None
    pixels = pixels_of((header.height, header.width, 3)) if header.height > 1 else None
    normals = columns[:, 3:6] if len(wanted) == 6 else None
    return Cloud(columns[:, :3], normals, _known(header.viewpoint), str(path), pixels=pixels, colours=colours)


def _packs(header: Header, index: int) -> bool:
    """Whether a field can hold a colour: one value of four bytes."""
    return header.counts[index] == 1 and np.dtype(header.dtypes[index]).itemsize == 4


def _colours(values: np.ndarray, header: Header, field: int) -> np.ndarray:
    """(N, 3) uint8 of a column of packed colours; in an ascii file a float is written as the number that it is."""
    if header.data == "ascii" and header.dtypes[field] == "<f4":
        values = values.astype(np.float32).view(np.uint32)
    return unpacked_colours(values)


def _with_bits(header: Header, fields: list[int]) -> Header:
    """The header with these fields as whole numbers of four bytes: read as floats, some colours are NaN and change."""
    if header.data == "ascii":
        return header
    return replace(header, dtypes=tuple("<u4" if i in fields else kind for i, kind in enumerate(header.dtypes)))


def _known(viewpoint: tuple[float, ...]) -> np.ndarray | None:
    """(1, 3) where the sensor was; None for the identity, and for a quaternion of zeros, with no translation."""
    origin, rotation = np.array(viewpoint[:3]), np.abs(viewpoint[3:])
    return None if not origin.any() and not rotation[1:].any() else origin[None]


def _header(path: Path, content: bytes) -> Header:
    entries: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in entries:
        end = content.find(b"\n", start)
        if end < 0:
            raise InputError(
                f"{path}: expected a PCD header that ends with DATA, got {'none' if not entries else 'a part of one'}"
            )
        words = content[start:end].decode("ascii", errors="replace").split("#")[0].split()
        if words:
            entries[words[0].upper()] = words[1:]
        start = end + 1
    fields = tuple(entries.get("FIELDS", entries.get("COLUMNS", [])))
    if not fields:
        raise InputError(f"{path}: expected a PCD header with FIELDS, got {', '.join(entries)}")
    sizes, counts = _integers(path, entries, "SIZE", len(fields)), [1] * len(fields)
    if "COUNT" in entries:
        counts = _integers(path, entries, "COUNT", len(fields))
    kinds = [word.upper() for word in _words(path, entries, "TYPE", len(fields))]
    unknown = [
        f"{name} {kind}{size}"
        for name, kind, size in zip(fields, kinds, sizes, strict=True)
        if (kind, size) not in _TYPES
    ]
    if unknown:
        raise InputError(f"{path}: expected fields of TYPE and SIZE F 4/8 or I/U 1/2/4/8, got {', '.join(unknown)}")
    width, height = (_integers(path, entries, key, 1)[0] for key in ("WIDTH", "HEIGHT"))
    points = _integers(path, entries, "POINTS", 1)[0] if "POINTS" in entries else width * height
    if points != width * height:
        raise InputError(f"{path}: expected POINTS = WIDTH x HEIGHT = {width * height}, got {points}")
    data = _words(path, entries, "DATA", 1)[0].lower()
    if data not in ("ascii", "binary", "binary_compressed"):
        raise InputError(f"{path}: DATA: expected ascii, binary or binary_compressed, got {data}")
    dtypes = tuple(_TYPES[kind, size] for kind, size in zip(kinds, sizes, strict=True))
    return Header(fields, dtypes, tuple(counts), width, height, _viewpoint(path, entries), data, start)


def _words(path: Path, entries: dict[str, list[str]], key: str, count: int) -> list[str]:
    words = entries.get(key, [])
    if len(words) != count:
        raise InputError(f"{path}: {key}: expected {count} values in the PCD header, got {len(words)}")
    return words


def _integers(path: Path, entries: dict[str, list[str]], key: str, count: int) -> list[int]:
    words = _words(path, entries, key, count)
    if not all(word.isdecimal() and len(word) <= _LONGEST_NUMBER for word in words):
        raise InputError(f"{path}: {key}: expected whole numbers, got {' '.join(words)}")
    return [int(word) for word in words]


def _viewpoint(path: Path, entries: dict[str, list[str]]) -> tuple[float, ...]:
    if "VIEWPOINT" not in entries:
        return _IDENTITY
    words = _words(path, entries, "VIEWPOINT", 7)
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if not numbers or not np.isfinite(numbers).all():
        raise InputError(f"{path}: VIEWPOINT: expected seven numbers, got {' '.join(words)}")
    return numbers


def _ascii(path: Path, body: bytes, header: Header, wanted: list[int]) -> np.ndarray:
    per_row = sum(header.counts)
    try:
        values = number_words(body)
    except ValueError:
        raise InputError(f"{path}: expected numbers after DATA ascii, got other words") from None
    if len(values) != header.points * per_row:
        raise _cut(path, f"{header.points} rows of {per_row} values", f"{len(values)} values")
    first = np.cumsum([0, *header.counts])[wanted]
    return values.reshape(header.points, per_row)[:, first]


def _binary(path: Path, body: bytes, header: Header, wanted: list[int]) -> np.ndarray:
    row = np.dtype([(str(i), d, (n,)) for i, (d, n) in enumerate(zip(header.dtypes, header.counts, strict=True))])
    if len(body) < header.points * row.itemsize:
        raise _cut(path, f"{header.points * row.itemsize} bytes of data", f"{len(body)}")
    rows = np.frombuffer(body, row, header.points)
    return np.stack([rows[str(i)][:, 0].astype(np.float64) for i in wanted], axis=1)


def _compressed(path: Path, body: bytes, header: Header, wanted: list[int]) -> np.ndarray:
    """Two sizes (uint32), then one LZF block in which the fields stand one after another, not point by point."""
    sizes = [np.dtype(d).itemsize * n * header.points for d, n in zip(header.dtypes, header.counts, strict=True)]
    packed, unpacked = struct.unpack_from("<II", body) if len(body) >= 8 else (0, 0)
    if len(body) < 8 or len(body) - 8 < packed:
        raise _cut(path, f"{packed + 8} bytes of data", f"{len(body)}")
    if unpacked != sum(sizes):
        raise InputError(f"{path}: expected {sum(sizes)} bytes of decompressed data, got {unpacked}")
    try:
        plain = lzf_decompress(body[8 : 8 + packed], unpacked)
    except ValueError as error:
        raise InputError(f"{path}: expected LZF compressed data, got damaged ones ({error})") from None
    first = np.cumsum([0, *sizes])
    columns = [np.frombuffer(plain, header.dtypes[i], header.points, int(first[i])) for i in wanted]
    return np.stack(columns, axis=1).astype(np.float64)


def lzf_decompress(packed: bytes, size: int) -> bytes:
    """The `size` bytes that LibLZF made `packed` of.

    A control byte c < 32 stands before c + 1 literal bytes. Otherwise the upper three bits are a length (7: the next
    byte adds to it) and the lower five, with the next byte, a distance: length + 2 bytes are repeated that begin
    distance + 1 back, and may run into themselves.

    Raises:
        ValueError: the data end too early, or are more or fewer than `size`.
    """
    out, at, end = bytearray(), 0, len(packed)
    try:
        while at < end:
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            distance = ((control & 31) << 8 | packed[at]) + 1
            at += 1
            length += 2
            begin = len(out) - distance
            if begin < 0:
                raise ValueError("a repetition from before the beginning")
            piece = out[begin : begin + length]
            out += (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        raise ValueError("it ends within an instruction") from None
    if at != end or len(out) != size:
        raise ValueError(f"{len(out)} bytes instead of {size}")
    return bytes(out)


def _cut(path: Path, expected: str, got: str) -> InputError:
    return InputError(f"{path}: expected {expected}, got {got}: the file is cut or its header is of another")
