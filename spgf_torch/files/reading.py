"""Bounded readers: size and depth are checked before parsing, and no content is executed.

Readers of every format raise InputError in one line, `file: expected ..., got ...`, whatever the file holds.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree

import numpy as np
import yaml

from spgf_torch.errors import InputError, one_line
from spgf_torch.files.digests import check_seal

LARGEST_JSON = 16_000_000  # bytes; as Python objects up to twenty times as many
LARGEST_YAML = 4_000_000  # bytes; half a minute of PyYAML
DEEPEST = 50  # levels of lists and mappings
MOST_NODES = 1_000_000  # of a YAML document with every alias written out
LONGEST_REASON = 120  # characters of a library's own words
LONGEST_NUMBER = 100  # characters of a number in YAML: Python takes the square of the time for the square of them
LONGEST_KEY = 19  # characters of a number as a key: longer ones can be chosen to collide in Python's hash tables
LARGEST_XML = 16_000_000  # bytes
HEAD = 1 << 16  # bytes that a numpy file may take to describe its array
DIRECTORY = 1 << 20  # bytes of the list of what is in a .npz file: some ten thousand arrays
ENDING = 22 + (1 << 16)  # bytes in which a zip file says where its list stands
MOST_MEMBERS = 1000  # arrays of a .npz file that are looked at
MOST_FIELDS = 100  # of a record in a numpy file


def existing(path: Path) -> Path:
    """`path`, if it is a file that holds something; InputError otherwise."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: expected a file, got a folder")
        if not path.is_file():
            raise InputError(f"{path}: expected a file, got nothing there")
        if not path.stat().st_size:
            raise InputError(f"{path}: expected data, got an empty file")
    except OSError as error:  # a name too long, a folder that may not be entered
        raise InputError(f"{path}: expected a file, got {error.strerror}") from None
    return path


def text(path: Path, what: str, largest: int = LARGEST_JSON) -> str:
    """The UTF-8 text of a file that should be `what`, of `largest` bytes at most."""
    existing(path)
    if (size := path.stat().st_size) > largest:
        raise InputError(f"{path}: expected {what} of at most {largest} bytes, got {size}")
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise unreadable(path, what, error) from None


def json_values(path: Path, what: str, sealed: bool = False) -> Any:
    """The content of a JSON file that should be `what`; with `sealed` held to its digest (`digests`)."""
    content = text(path, what)
    if sealed:
        check_seal(path, what)
    return json_of(content, path, what)


def json_of(content: str | bytes, path: Path, what: str) -> Any:
    """The same for JSON that stands in the file `path`."""
    try:
        values = json.loads(content)
    except (ValueError, RecursionError) as error:  # ValueError: not JSON, not text, an integer of thousands of digits
        raise unreadable(path, what, error) from None
    if _depth(values) > DEEPEST:
        raise InputError(f"{path}: expected {what}, got more than {DEEPEST} levels of brackets")
    return values


def yaml_values(path: Path, what: str, sealed: bool = False, times: int = 1) -> Any:
    """The content of a YAML file that should be `what`: plain values; no tag makes an object.

    With `sealed` it is held to its digest; `times` as much as `LARGEST_YAML` and `MOST_NODES` is read.
    """
    content = text(path, what, times * LARGEST_YAML)
    if sealed:
        check_seal(path, what)
    return yaml_of(content, path, what, times)


def yaml_of(content: str, path: Path, what: str, times: int = 1) -> Any:
    """The same for YAML that stands in the file `path`."""
    try:
        loader = _BoundedLoader(content)
        loader.most = times * MOST_NODES
        return loader.get_single_data()
    except Exception as error:  # beside its own errors PyYAML lets through whatever a scalar's constructor raises
        raise unreadable(path, what, error) from None


class _BoundedLoader(yaml.SafeLoader):
    """A SafeLoader that looks at how large a document is with its aliases written out before it makes values of it."""

    level, most = 0, MOST_NODES

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """A key that stands twice would hide one of its values."""
        own = [(key.value, key.start_mark.line + 1) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        seen: dict[str, int] = {}
        for key, line in own:
            if key in seen and key != "<<":
                raise ValueError(f"the key {key} twice, in lines {seen[key]} and {line}")
            seen[key] = line
        return super().construct_mapping(node, deep)

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self.level += 1
        if self.level > DEEPEST:
            raise ValueError(f"more than {DEEPEST} levels")
        node = super().compose_node(parent, index)
        self.level -= 1
        return node

    def get_single_data(self) -> Any:
        node = self.get_single_node()
        if node is None:
            return None
        count, depth = _size(node, {})
        if count > self.most:
            raise ValueError(f"aliases that stand for more than {self.most} values")
        if depth > DEEPEST:
            raise ValueError(f"aliases that make more than {DEEPEST} levels")
        return self.construct_document(node)

    def short(self, node: yaml.Node) -> Any:
        """A number. PyYAML adds up those with colons (base 60) digit by digit."""
        if isinstance(node, yaml.ScalarNode) and len(node.value) > LONGEST_NUMBER:
            raise ValueError(f"a number of {len(node.value)} characters, more than {LONGEST_NUMBER}")
        whole = node.tag.endswith("int")
        return self.construct_yaml_int(node) if whole else self.construct_yaml_float(node)  # type: ignore[no-untyped-call]


for _kind in ("int", "float"):
    _BoundedLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", _BoundedLoader.short)


def _size(node: yaml.Node, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Count the nodes of a YAML node with aliases written out, and their levels; ValueError for one within itself."""
    if not isinstance(node, yaml.CollectionNode):
        return 1, 0
    if id(node) not in known:
        known[id(node)] = 0, 0  # until all of it is known
        if isinstance(node, yaml.MappingNode):
            _check_keys(node)
        pairs = isinstance(node, yaml.MappingNode)
        inner = [part for pair in node.value for part in pair] if pairs else node.value
        sizes = [_size(part, known) for part in inner]
        known[id(node)] = 1 + sum(count for count, _ in sizes), 1 + max((depth for _, depth in sizes), default=0)
    if known[id(node)] == (0, 0):
        raise ValueError("an alias within what it stands for")
    return known[id(node)]


def _check_keys(node: yaml.MappingNode) -> None:
    for key, _ in node.value:
        number = isinstance(key, yaml.ScalarNode) and key.tag.endswith((":int", ":float"))
        if number and (len(key.value) > LONGEST_KEY or key.value.lower().endswith(("inf", "nan"))):
            raise ValueError(f"a key that is no number of at most {LONGEST_KEY} characters")


def _depth(values: Any) -> int:
    """Levels of lists and mappings."""
    depth, level = 0, [values]
    while level := [part for part in level if isinstance(part, dict | list)]:
        depth += 1
        if depth > DEEPEST:
            break
        level = [part for outer in level for part in (outer.values() if isinstance(outer, dict) else outer)]
    return depth


def npy_array(path: Path) -> np.ndarray:
    """The array of a .npy file, mapped, not yet read: whatever its header says, it is no larger than the file."""
    try:
        with existing(path).open("rb") as stream:
            if _npy_header(stream)[2].hasobject:
                raise _pickled(path)
        array = np.lib.format.open_memmap(path, mode="r")
    except InputError:
        raise
    except Exception as error:  # numpy lets through what the parser of the header raises
        if "Python objects" in str(error) or _starts_with_pickle(path):
            raise _pickled(path) from None
        raise unreadable(path, "a whole numpy file of numbers", error, "a damaged one") from None
    return array


def npz_arrays(path: Path, names: Sequence[str], most: int) -> dict[str, np.ndarray]:
    """The arrays `names` of a .npz file, each of `most` plain numbers at most; it need have the first of them only.

    Other arrays in it stay packed.
    """
    try:
        _check_directory(existing(path))
        with zipfile.ZipFile(path) as archive:
            members = {Path(info.filename).stem: info for info in archive.infolist() if info.filename.endswith(".npy")}
            arrays = {name: _member(path, archive, members[name], most) for name in names if name in members}
    except InputError:
        raise
    except Exception as error:  # zip, its compressions and numpy each have errors of their own
        raise unreadable(path, "a whole numpy file of numbers", error, "a damaged one") from None
    if names[0] not in arrays:
        raise InputError(f"{path}: expected an array named {names[0]}, got {', '.join(members) or 'none'}")
    return arrays


def npz_headers(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    """Shape and type of each array of a .npz file, as their headers say; none is unpacked."""
    headers = {}
    try:
        _check_directory(existing(path))
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist()[:MOST_MEMBERS]:
                if info.filename.endswith(".npy"):
                    with archive.open(info) as stream:
                        shape, _, dtype = _npy_header(stream)
                    headers[Path(info.filename).stem] = (shape, dtype)
    except InputError:
        raise
    except Exception as error:  # zip, its compressions and numpy each have errors of their own
        if _starts_with_pickle(path):
            raise _pickled(path) from None
        raise unreadable(path, "a whole numpy file of numbers", error, "a damaged one") from None
    return headers


def _starts_with_pickle(path: Path) -> bool:
    """Whether a file begins as pickles of the protocols 2 to 5 do."""
    with path.open("rb") as stream:
        head = stream.read(2)
    return len(head) == 2 and head[0] == 0x80 and 2 <= head[1] <= 5


def _pickled(path: Path) -> InputError:
    return InputError(
        f"{path}: expected arrays of numbers, got pickled Python objects, which can run code when they are read; if "
        "you trust the file, load it with numpy and write its arrays with np.savez"
    )


def _check_directory(path: Path) -> None:
    """ValueError for a zip file with a list of more than `DIRECTORY` bytes: all of it would become objects."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(max(0, size - ENDING))
        end = stream.read()
    start = end.rfind(b"PK\5\6")
    if start < 0 or start + 16 > len(end):
        raise ValueError("no end of a zip file")
    length = int.from_bytes(end[start + 12 : start + 16], "little")
    if length > DIRECTORY:
        raise ValueError(f"a list of {length} bytes, more than {DIRECTORY}, of what is in it")


def _npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type of the array that follows in `stream`; ValueError where they take more than `HEAD`."""
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(stream)
    length = stream.read(4)
    if version not in ((2, 0), (3, 0)) or int.from_bytes(length, "little") > HEAD:
        raise ValueError(f"a header of version {version} with {int.from_bytes(length, 'little')} bytes")
    head = io.BytesIO(length + stream.read(int.from_bytes(length, "little")))
    return np.lib.format.read_array_header_2_0(head)


def _plain_numbers(dtype: np.dtype) -> bool:
    """Whether an array is of single numbers, or of records of such."""
    fields = [dtype[name] for name in dtype.names] if dtype.names else [dtype]
    return len(fields) <= MOST_FIELDS and all(field.kind in "biuf" and field.subdtype is None for field in fields)


def _member(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo, most: int) -> np.ndarray:
    """An array of an archive; its header is read and believed only as far as the bytes that there are."""
    with archive.open(info) as stream:
        shape, fortran, dtype = _npy_header(stream)
        count, start = math.prod(shape), stream.tell()
        if dtype.hasobject:
            raise _pickled(path)
        if not _plain_numbers(dtype):
            raise InputError(f"{path}: {info.filename}: expected plain numbers, got {str(dtype)[:40]}")
        if (numbers := count * max(1, len(dtype.names or ()))) > most:
            raise InputError(f"{path}: {info.filename}: expected at most {most} numbers, got {numbers}")
        if info.file_size != start + count * dtype.itemsize:
            raise ValueError(f"{info.file_size} bytes for an array of shape {shape}")
        content = stream.read(count * dtype.itemsize)
    return np.frombuffer(content, dtype, count).reshape(shape, order="F" if fortran else "C")


def xml_root(content: bytes, path: Path, what: str) -> ElementTree.Element:
    """The root of XML that stands in the file `path`; a document type, which could name files, is refused."""
    if len(content) > LARGEST_XML:
        raise InputError(f"{path}: expected {what} of at most {LARGEST_XML} bytes, got {len(content)}")
    builder = ElementTree.XMLParser(target=_NoDoctype())
    try:
        builder.feed(content)
        root: ElementTree.Element = builder.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        raise unreadable(path, what, error) from None
    if depth_of(root) > DEEPEST:
        raise InputError(f"{path}: expected {what}, got more than {DEEPEST} levels of elements")
    return root


class _NoDoctype(ElementTree.TreeBuilder):
    def doctype(self, *_: Any) -> None:
        raise ValueError("a document type (<!DOCTYPE), which is not read")


def depth_of(root: ElementTree.Element) -> int:
    """Levels of elements, as far as they are bounded."""
    depth, level = 0, [root]
    while level and depth <= DEEPEST:
        depth, level = depth + 1, [part for element in level for part in element]
    return depth


def unreadable(path: Path, what: str, error: BaseException, got: str = "") -> InputError:
    """The error for a file that a parser gave up on."""
    words = f"{got} ({reason(error)})" if got else reason(error)
    return InputError(f"{path}: expected {what}, got {words}")


def reason(error: BaseException) -> str:
    """A library's own words in one short line; the error's kind where it has none."""
    words = one_line(str(error)) or type(error).__name__
    return words if len(words) <= LONGEST_REASON else words[:LONGEST_REASON] + " ..."
