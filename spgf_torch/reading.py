"""What is read from disk: bounded in size and depth before it is taken in, and nothing in it is run.

Readers of every format raise InputError in one line, `file: expected ..., got ...`, whatever the file holds.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from spgf_torch.config import InputError, one_line

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST_JSON = 16_000_000  # bytes; as Python objects up to twenty times as many
LARGEST_YAML = 4_000_000  # bytes; half a minute of PyYAML
DEEPEST = 50  # levels of lists and mappings
MOST_NODES = 1_000_000  # of a YAML document with every alias written out
LONGEST_REASON = 120  # characters of a library's own words
# Bytes of a Parquet column chunk beyond those of its rows: a dictionary of words, statistics.
CHUNK = 1 << 20
LONGEST_WORD = 200
MOST_MEMBERS = 1000  # arrays of a .npz file that are looked at
WIDEST = 64  # bytes of one value in a column


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


def json_values(path: Path, what: str) -> Any:
    """The content of a JSON file that should be `what`."""
    return json_of(text(path, what), path, what)


def json_of(content: str | bytes, path: Path, what: str) -> Any:
    """The same for JSON that stands in the file `path`."""
    try:
        values = json.loads(content)
    except (ValueError, RecursionError) as error:  # ValueError: not JSON, not text, an integer of thousands of digits
        raise unreadable(path, what, error) from None
    if _depth(values) > DEEPEST:
        raise InputError(f"{path}: expected {what}, got more than {DEEPEST} levels of brackets")
    return values


def yaml_values(path: Path, what: str) -> Any:
    """The content of a YAML file that should be `what`: plain values; no tag makes an object."""
    return yaml_of(text(path, what, LARGEST_YAML), path, what)


def yaml_of(content: str, path: Path, what: str) -> Any:
    """The same for YAML that stands in the file `path`."""
    try:
        return yaml.load(content, _BoundedLoader)
    except Exception as error:  # beside its own errors PyYAML lets through whatever a scalar's constructor raises
        raise unreadable(path, what, error) from None


class _BoundedLoader(yaml.SafeLoader):
    """A SafeLoader that looks at how large a document is with its aliases written out before it makes values of it."""

    level = 0

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
        if _nodes(node, {}) > MOST_NODES:
            raise ValueError(f"aliases that stand for more than {MOST_NODES} values")
        return self.construct_document(node)


def _nodes(node: yaml.Node, known: dict[int, int]) -> int:
    """How many nodes a YAML node stands for, itself included; ValueError for one within itself."""
    if not isinstance(node, yaml.CollectionNode):
        return 1
    if id(node) not in known:
        known[id(node)] = 0  # until all of it is known
        pairs = isinstance(node, yaml.MappingNode)
        inner = [part for pair in node.value for part in pair] if pairs else node.value
        known[id(node)] = 1 + sum(_nodes(part, known) for part in inner)
    if known[id(node)] == 0:
        raise ValueError("an alias within what it stands for")
    return known[id(node)]


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
        array = np.lib.format.open_memmap(existing(path), mode="r")
    except InputError:
        raise
    except Exception as error:  # numpy lets through what the parser of the header raises
        if "Python objects" in str(error) or _starts_with_pickle(path):
            raise _pickled(path) from None
        raise unreadable(path, "a whole numpy file of numbers", error, "a damaged one") from None
    return array


def npz_arrays(path: Path, names: Sequence[str], most: int) -> dict[str, np.ndarray]:
    """The arrays `names` of a .npz file, each of `most` numbers at most; it need have the first of them only.

    Other arrays in it stay packed.
    """
    try:
        with zipfile.ZipFile(existing(path)) as archive:
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
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    headers = {}
    try:
        with zipfile.ZipFile(existing(path)) as archive:
            for info in archive.infolist()[:MOST_MEMBERS]:
                if info.filename.endswith(".npy"):
                    with archive.open(info) as stream:
                        shape, _, dtype = readers[np.lib.format.read_magic(stream)](stream)
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


def _member(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo, most: int) -> np.ndarray:
    """An array of an archive; its header is read and believed only as far as the bytes that there are."""
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    with archive.open(info) as stream:
        shape, fortran, dtype = readers[np.lib.format.read_magic(stream)](stream)
        count, start = math.prod(shape), stream.tell()
        if dtype.hasobject:
            raise _pickled(path)
        if count > most:
            raise InputError(f"{path}: {info.filename}: expected at most {most} numbers, got {count}")
        if info.file_size != start + count * dtype.itemsize:
            raise ValueError(f"{info.file_size} bytes for an array of shape {shape}")
        content = stream.read()
    return np.frombuffer(content, dtype, count).reshape(shape, order="F" if fortran else "C")


def parquet_table(path: Path, what: str, columns: Sequence[str] | None, most: int) -> pa.Table:
    """Columns (None: all) of a Parquet file that should be `what`, of `most` rows at most.

    Columns that the file lacks are left out. Its footer says how large the rows are before any is unpacked; text stays
    a dictionary of words until these are known to be short, and what carries checksums is held to them.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(existing(path)) as file:
            about, schema = file.metadata, file.schema_arrow
            if about.num_rows > most:
                raise InputError(f"{path}: expected {what} of at most {most} rows, got {about.num_rows}")
            wanted = [name for name in schema.names if columns is None or name in columns]
            for group in range(about.num_row_groups):
                _check_chunks(path, what, about.row_group(group), wanted)
        texts = [entry.name for entry in schema if pa.types.is_string(entry.type) or pa.types.is_binary(entry.type)]
        with pq.ParquetFile(path, read_dictionary=texts, page_checksum_verification=True) as file:
            content = file.read(wanted)
        for name, values in zip(content.column_names, content.columns, strict=True):
            words = [chunk.dictionary for chunk in values.chunks if pa.types.is_dictionary(chunk.type)]
            longest = max((len(str(word)) for some in words for word in some.to_pylist()), default=0)
            if longest > LONGEST_WORD:
                raise InputError(f"{path}: {name}: expected words of {LONGEST_WORD} letters at most, got {longest}")
        return content
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        raise unreadable(path, what, error, "a damaged file") from None


def _check_chunks(path: Path, what: str, group: Any, wanted: Sequence[str]) -> None:
    for i in range(group.num_columns):
        chunk = group.column(i)
        name = chunk.path_in_schema.split(".")[0]
        if name in wanted and chunk.num_values > group.num_rows:
            raise InputError(f"{path}: {name}: expected one value a row, got {chunk.num_values} in {group.num_rows}")
        if name in wanted and chunk.total_uncompressed_size > group.num_rows * WIDEST + CHUNK:
            raise InputError(
                f"{path}: expected {what}, got {chunk.total_uncompressed_size} bytes in {group.num_rows} rows of {name}"
            )


def unreadable(path: Path, what: str, error: BaseException, got: str = "") -> InputError:
    """The error for a file that a parser gave up on."""
    words = f"{got} ({reason(error)})" if got else reason(error)
    return InputError(f"{path}: expected {what}, got {words}")


def reason(error: BaseException) -> str:
    """A library's own words in one short line; the error's kind where it has none."""
    words = one_line(str(error)) or type(error).__name__
    return words if len(words) <= LONGEST_REASON else words[:LONGEST_REASON] + " ..."
