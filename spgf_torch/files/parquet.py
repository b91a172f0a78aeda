"""Parquet files: their sizes are known before anything is unpacked, from the pages themselves.

The footer of a file says how large its columns are, but nothing holds it to that: a page of a kilobyte may unpack to a
gigabyte. Every page stands behind a header of its own, by whose sizes Arrow goes; these are read here and added up.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.errors import InputError
from spgf_torch.files.reading import existing, unreadable

if TYPE_CHECKING:
    import pyarrow as pa

FOOTER = 4_000_000  # bytes
COLUMNS = 64
GROUPS = 1000  # of rows
MOST_PAGES = 100_000
# Bytes of a column chunk beyond those of its rows: a dictionary of words, statistics.
CHUNK = 1 << 20
LONGEST_WORD = 200
WIDEST = 64  # bytes of one value in a column

# Thrift's compact protocol, in which page headers are written: kinds of fields.
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
LEVELS = 8  # of structures within each other; page headers have three


def parquet_table(path: Path, what: str, columns: Sequence[str] | None, most: int) -> pa.Table:
    """Columns (None: all) of a Parquet file that should be `what`, of `most` rows at most: numbers and words.

    Columns that the file lacks are left out. Text stays a dictionary of words until these are known to be short, and
    what carries checksums is held to them.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        _check_footer(existing(path), what)
        with pq.ParquetFile(path) as file:
            wanted = _checked(path, what, file, columns, most)
            texts = [entry.name for entry in file.schema_arrow if pa.types.is_string(entry.type)]
        with pq.ParquetFile(path, read_dictionary=texts, page_checksum_verification=True) as file:
            content = file.read(wanted)
        _check_words(path, content)
        return content
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, LookupError, MemoryError) as error:  # LookupError: no such page
        raise unreadable(path, what, error, "a damaged file") from None


def _check_footer(path: Path, what: str) -> None:
    with path.open("rb") as stream:
        stream.seek(max(0, path.stat().st_size - 8))
        length = int.from_bytes(stream.read(4), "little")
        if stream.read(4) == b"PAR1" and length > FOOTER:
            raise InputError(f"{path}: expected {what} with a footer of at most {FOOTER} bytes, got {length}")


def _checked(path: Path, what: str, file: Any, columns: Sequence[str] | None, most: int) -> list[str]:
    """The columns to read, of plain kinds and within bounds."""
    about, schema = file.metadata, file.schema_arrow
    if about.num_rows > most:
        raise InputError(f"{path}: expected {what} of at most {most} rows, got {about.num_rows}")
    if about.num_columns > COLUMNS or about.num_row_groups > GROUPS:
        got = f"{about.num_columns} and {about.num_row_groups}"
        raise InputError(f"{path}: expected {what} of at most {COLUMNS} columns and {GROUPS} groups of rows, got {got}")
    wanted = [name for name in schema.names if columns is None or name in columns]
    for entry in schema:
        if entry.name in wanted and not _plain(entry.type):
            raise InputError(f"{path}: {entry.name}: expected one value a row, got {str(entry.type)[:60]}")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for group in range(about.num_row_groups):
            _check_chunks(path, what, content, about.row_group(group), wanted)
    return wanted


def _plain(kind: pa.DataType) -> bool:
    """Whether values of a type are numbers, or words that can stay a dictionary."""
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_primitive(kind) or pa.types.is_null(kind))


def _check_chunks(path: Path, what: str, content: mmap.mmap, group: Any, wanted: Sequence[str]) -> None:
    for i in range(group.num_columns):
        chunk = group.column(i)
        name = chunk.path_in_schema.split(".")[0]
        if name not in wanted:
            continue
        if chunk.num_values > group.num_rows:
            raise InputError(f"{path}: {name}: expected one value a row, got {chunk.num_values} in {group.num_rows}")
        size = max(chunk.total_uncompressed_size, _unpacked(content, chunk) if group.num_rows else 0)
        if size > group.num_rows * WIDEST + CHUNK:
            raise InputError(f"{path}: expected {what}, got {size} bytes in {group.num_rows} rows of {name}")


def _unpacked(content: mmap.mmap, chunk: Any) -> int:
    """Bytes of a column chunk as its pages' headers tell them. ValueError for what are no pages."""
    at = chunk.data_page_offset
    if chunk.has_dictionary_page and 0 < (chunk.dictionary_page_offset or 0) < at:
        at = chunk.dictionary_page_offset
    end, total, pages = at + chunk.total_compressed_size, 0, 0
    if not 0 <= at <= end <= len(content):
        raise ValueError("a column outside the file")
    while at < end:
        at, sizes = _page(content, at)
        unpacked, packed = sizes.get(2, -1), sizes.get(3, -1)
        pages += 1
        if unpacked < 0 or packed < 0 or pages > MOST_PAGES:
            raise ValueError("a page without a size" if pages <= MOST_PAGES else f"more than {MOST_PAGES} pages")
        total, at = total + unpacked, at + packed
    return total


def _page(content: mmap.mmap, at: int) -> tuple[int, dict[int, int]]:
    """Where a page begins behind its header at `at`, and the header's whole numbers: 2 unpacked, 3 packed bytes."""
    numbers: dict[int, int] = {}
    known = 0
    while True:
        kind, known, at = _field(content, at, known)
        if not kind:
            return at, numbers
        if kind in (I16, I32, I64):
            value, at = _varint(content, at)
            numbers[known] = value >> 1 if value % 2 == 0 else -(value + 1 >> 1)
        else:
            at = _behind(content, at, kind, 1)


def _field(content: mmap.mmap, at: int, before: int) -> tuple[int, int, int]:
    """Kind (0: no more) and number of a field, and where its value stands."""
    head = content[at]
    if head >> 4 or not head:
        return head & 15, before + (head >> 4), at + 1
    number, at = _varint(content, at + 1)
    return head & 15, number >> 1, at


def _varint(content: mmap.mmap, at: int) -> tuple[int, int]:
    value = 0
    for step in range(10):
        byte = content[at + step]
        value |= (byte & 127) << 7 * step
        if byte < 128:
            return value, at + step + 1
    raise ValueError("a number of more than ten bytes in the header of a page")


def _behind(content: mmap.mmap, at: int, kind: int, level: int) -> int:
    """Where the value of a field ends."""
    if level > LEVELS:
        raise ValueError("the header of a page is too deep")
    if kind in (TRUE, FALSE):
        return at
    if kind in (BYTE, I16, I32, I64):
        return at + 1 if kind == BYTE else _varint(content, at)[1]
    if kind == DOUBLE:
        return at + 8
    if kind == BINARY:
        length, at = _varint(content, at)
        return at + length
    if kind == STRUCT:
        known = 0
        while True:
            inner, known, at = _field(content, at, known)
            if not inner:
                return at
            at = _behind(content, at, inner, level + 1)
    raise ValueError(f"a field of kind {kind} in the header of a page")


def _check_words(path: Path, content: pa.Table) -> None:
    """InputError for words that are long, or would steer a terminal."""
    import pyarrow as pa

    for name, values in zip(content.column_names, content.columns, strict=True):
        chunks = [chunk.dictionary for chunk in values.chunks if pa.types.is_dictionary(chunk.type)]
        for word in (name, *(str(word) for chunk in chunks for word in chunk.to_pylist())):
            if len(word) > LONGEST_WORD:
                raise InputError(
                    f"{path}: {name:.60}: expected words of {LONGEST_WORD} letters at most, got {len(word)}"
                )
            if not word.isprintable():
                raise InputError(f"{path}: {name:.60}: expected words of printable letters, got {word:.60}")
