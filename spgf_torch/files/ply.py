"""PLY files by their header: which elements and properties there are, and the scalar properties of a few elements.

Source: G. Turk, "The PLY Polygon File Format", 1998.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.reading import existing

_LONGEST_HEADER = 1 << 16  # bytes
_LONGEST_LIST = 1000  # values, of lists that are taken to be all of one length
TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
# What older Windows programs write for NaN and infinity.
_WINDOWS_NAN = re.compile(rb"[+-]?1\.#\w+|[+-]?nan\(\w+\)", re.IGNORECASE)


@dataclass(frozen=True)
class Property:
    """A scalar (`length` is None) or a list whose length has the type `length`; types are numpy's."""

    name: str
    kind: str
    length: str | None = None


@dataclass(frozen=True)
class Element:
    """Rows of properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def lists(self) -> bool:
        return any(each.length for each in self.properties)


@dataclass(frozen=True)
class Header:
    """What stands before the data; `size` in bytes, its last line break included."""

    form: str
    elements: tuple[Element, ...]
    size: int


def read_header(path: Path) -> Header:
    """The header of a PLY file, names in lower case.

    Raises:
        InputError: none, a format, a type or a count that the format does not have.
    """
    with existing(path).open("rb") as stream:
        head = stream.read(_LONGEST_HEADER)
    found = re.search(rb"^end_header(\r\n|\n|\r)", head, re.MULTILINE) or re.search(
        rb"[\r\n]end_header(\r\n|\n|\r)", head
    )
    if not head.startswith(b"ply") or not found:
        got = "a part of one" if head.startswith(b"ply") else "none"
        raise InputError(f"{path}: expected a PLY header that ends with end_header, got {got}")
    form, elements = "", []
    for line in head[: found.start()].decode("ascii", errors="replace").splitlines():
        words = line.split()
        match words:
            case ["format", kind, *_] if kind in _ORDERS:
                form = kind
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(Element(name.lower(), int(count), ()))
            case ["property", *rest] if elements:
                last = elements[-1]
                elements[-1] = Element(last.name, last.count, (*last.properties, _property(path, line, rest)))
            case ["format" | "element" | "property", *_]:
                raise InputError(f"{path}: expected a PLY header, got the line {line.strip()!r}")
    if not form:
        raise InputError(f"{path}: expected a line format {', '.join(_ORDERS)} in the PLY header, got none")
    return Header(form, tuple(elements), found.end())


def read_elements(path: Path, header: Header, wanted: Sequence[str]) -> dict[str, dict[str, np.ndarray]]:
    """The scalar properties (N,) float64 of elements by name, those that stand before any later element with lists.

    Raises:
        InputError: fewer data than the header says, words that are no numbers.
    """
    with path.open("rb") as stream:
        stream.seek(header.size)
        body = stream.read()
    tokens = _numbers(path, body) if header.form == "ascii" else np.empty(0)
    columns: dict[str, dict[str, np.ndarray]] = {}
    at = 0
    for element in header.elements:
        if all(name in columns for name in wanted) or (element.lists and wanted[0] in columns):
            break
        if header.form == "ascii":
            table, at = _ascii(path, tokens, at, element)
        else:
            table, at = _binary(path, body, at, element, _ORDERS[header.form])
        columns[element.name] = table
    return {name: columns[name] for name in wanted if name in columns}


def _property(path: Path, line: str, words: Sequence[str]) -> Property:
    types, name = words[:-1], words[-1].lower() if words else ""
    unknown = [word for word in types if word not in TYPES and word != "list"]
    if unknown:
        raise InputError(
            f"{path}: property {name}: expected a type of the PLY format ({', '.join(TYPES)}), got {unknown[0]}; write "
            "the file without this property"
        )
    if len(types) == 1 and types[0] != "list":
        return Property(name, TYPES[types[0]])
    if len(types) == 3 and types[0] == "list" and "list" not in types[1:] and TYPES[types[1]][0] != "f":
        return Property(name, TYPES[types[2]], TYPES[types[1]])
    raise InputError(f"{path}: expected a PLY header, got the line {line.strip()!r}")


def number_words(body: bytes) -> np.ndarray:
    """Numbers that white space of any kind separates, NaN as any program writes it; ValueError for other words."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how numpy tells of a word that is no number
        try:
            return np.fromstring(_WINDOWS_NAN.sub(b"nan", body), dtype=np.float64, sep=" ")
        except DeprecationWarning as error:
            raise ValueError("words that are no numbers") from error


def _numbers(path: Path, body: bytes) -> np.ndarray:
    try:
        return number_words(body)
    except ValueError:
        raise InputError(f"{path}: expected numbers after the header of an ascii PLY, got other words") from None


def _ascii(path: Path, tokens: np.ndarray, at: int, element: Element) -> tuple[dict[str, np.ndarray], int]:
    """Columns of an element of numbers as text, wherever its lines are broken, and where the next begins."""
    width = len(element.properties)
    if not element.lists:
        end = at + element.count * width
        if end > len(tokens):
            raise _cut(path, element, (len(tokens) - at) // max(width, 1))
        table = tokens[at:end].reshape(element.count, width)
        return {each.name: table[:, i] for i, each in enumerate(element.properties)}, end
    if (regular := _regular_rows(tokens[at:], element)) is not None:
        return regular[0], at + element.count * regular[1]
    columns: dict[str, list[float]] = {each.name: [] for each in element.properties if not each.length}
    for row in range(element.count):
        for each in element.properties:
            if at >= len(tokens) or (not tokens[at] >= 0 and each.length):
                raise _cut(path, element, row)
            if each.length:
                at += 1 + int(min(tokens[at], len(tokens)))
            else:
                columns[each.name].append(float(tokens[at]))
                at += 1
    if at > len(tokens):
        raise _cut(path, element, element.count - 1)
    return {name: np.array(values) for name, values in columns.items()}, at


def _binary(path: Path, body: bytes, at: int, element: Element, order: str) -> tuple[dict[str, np.ndarray], int]:
    """The same for an element of binary numbers."""
    if not element.lists:
        row = np.dtype([(str(i), order + each.kind) for i, each in enumerate(element.properties)])
        end = at + element.count * row.itemsize
        if end > len(body):
            raise _cut(path, element, (len(body) - at) // max(row.itemsize, 1))
        if not row.itemsize:
            return {}, at
        table = np.frombuffer(body, row, element.count, at)
        return {each.name: table[str(i)].astype(np.float64) for i, each in enumerate(element.properties)}, end
    if (packed := _regular_bytes(body, at, element, order)) is not None:
        return packed[0], at + element.count * packed[1]
    columns: dict[str, list[float]] = {each.name: [] for each in element.properties if not each.length}
    for row_number in range(element.count):
        for each in element.properties:
            first = np.dtype(order + (each.length or each.kind))
            if at + first.itemsize > len(body):
                raise _cut(path, element, row_number)
            value = np.frombuffer(body, first, 1, at)[0]
            at += first.itemsize
            if each.length:
                at += max(0, int(value)) * np.dtype(each.kind).itemsize
            else:
                columns[each.name].append(float(value))
    if at > len(body):
        raise _cut(path, element, element.count - 1)
    return {name: np.array(values) for name, values in columns.items()}, at


def _regular_rows(tokens: np.ndarray, element: Element) -> tuple[dict[str, np.ndarray], int] | None:
    """Columns and values a row of an element all of whose lists are as long as those of its first row; else None."""
    places, width = [], 0
    for each in element.properties:
        if width >= len(tokens) or (each.length and not 0 <= tokens[width] <= _LONGEST_LIST):
            return None
        places.append(width)
        width += 1 + (int(tokens[width]) if each.length else 0)
    if element.count * width > len(tokens):
        return None
    table = tokens[: element.count * width].reshape(element.count, width)
    both = list(zip(element.properties, places, strict=True))
    if any(each.length and (table[:, at] != table[0, at]).any() for each, at in both):
        return None
    return {each.name: table[:, at] for each, at in both if not each.length}, width


def _regular_bytes(body: bytes, at: int, element: Element, order: str) -> tuple[dict[str, np.ndarray], int] | None:
    """The same in bytes."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    first = at
    for i, each in enumerate(element.properties):
        kind = np.dtype(order + (each.length or each.kind))
        if first + kind.itemsize > len(body):
            return None
        fields.append((str(i), kind.str))
        length = int(np.frombuffer(body, kind, 1, first)[0]) if each.length else 0
        first += kind.itemsize + length * np.dtype(each.kind).itemsize
        if not 0 <= length <= _LONGEST_LIST:
            return None
        if each.length:
            fields.append((f"{i} values", order + each.kind, (length,)))
    row = np.dtype(fields)
    if at + element.count * row.itemsize > len(body):
        return None
    table = np.frombuffer(body, row, element.count, at)
    named = {str(i): each for i, each in enumerate(element.properties)}
    if any(each.length and (table[i] != table[i][0]).any() for i, each in named.items()):
        return None
    return {each.name: table[i].astype(np.float64) for i, each in named.items() if not each.length}, row.itemsize


def _cut(path: Path, element: Element, got: int) -> InputError:
    return InputError(
        f"{path}: expected {element.count} of {element.name} as its header says, got {got}: the file is cut"
    )
