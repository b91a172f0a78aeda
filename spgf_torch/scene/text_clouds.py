"""Point clouds as text: rows of numbers, with or without names of their columns, as many programs write them."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.reading import reason
from spgf_torch.scene.cloud import Cloud, check_count
from spgf_torch.scene.text_columns import MOST_COLUMNS, Layout, layout_by_values, named_layout, plain_name

TEXT = (".xyz", ".xyzn", ".xyzrgb", ".txt", ".csv", ".tsv", ".asc", ".pts")
# Six columns without names in such a file are points and colours.
COLOURED = ".xyzrgb"
COLOURS = Layout(colours=(3, 4, 5), notes=("columns 4 to 6 taken for colours",))
_COMMENTS = ("#", "//")
_LONGEST_LINE = 1 << 16
_SAMPLE = 50  # rows from which the layout is found
_MOST_LINES = 1000  # of comments and of these
_NOTHING = 1 << 30  # lines to skip: all
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
# NaN and infinity as C libraries, Windows and databases write them.
_NO_NUMBER = re.compile(r"[+-]?(?:1\.#\w+|nan\(.*\)|nan|inf|infinity|null|none|na|n/a|-)?", re.IGNORECASE)

_WINDOWS_NAN = re.compile(r"[+-]?1\.#\w+")


@dataclass(frozen=True)
class _Form:
    """How a table is written: names of its columns ([] if none), delimiter (None: white space), lines to skip, decimal
    comma, the number of rows that its first line says, whether numbers stand in quotes."""

    names: list[str]
    delimiter: str | None
    skipped: int
    comma: bool
    said: int | None
    quoted: bool = False


def read_table(path: Path, limit: int) -> tuple[Cloud, str | None]:
    """The cloud in a text file, not yet checked, and the unit that its column names state.

    Raises:
        InputError: words that are no numbers, ambiguous columns, rows of different length, too many.
    """
    try:
        form = _form(path)
        layout = named_layout(str(path), form.names) if form.names else None
        layout, table = _named(path, form, layout, limit) if layout else (None, _numbers(path, form, None, limit))
    except InputError:
        raise
    except ValueError as error:  # a word that is no number, rows of different length, not text
        raise InputError(f"{path}: expected rows of numbers x y z [nx ny nz], got {reason(error)}") from None
    check_count(path, len(table), limit)
    if form.said not in (None, len(table)):
        raise InputError(f"{path}: expected {form.said} rows as its first line says, got {len(table)}")
    if layout is None:
        table = _without_empty_end(table)
        shown = path.suffix.lower() == COLOURED and table.shape[1] == 6
        layout = COLOURS if shown else layout_by_values(str(path), table, intensity=form.said is not None)
    notes = (*layout.notes, *(("decimal commas read as points",) if form.comma else ()))
    normals = None if layout.normals is None else table[:, layout.normals]
    cloud = Cloud(table[:, layout.points], normals, None, str(path), notes=notes, colours=layout.colours_of(table))
    return cloud, layout.unit


def _named(path: Path, form: _Form, layout: Layout, limit: int) -> tuple[Layout, np.ndarray]:
    """Only the columns that the names tell of, and which of these is what; without colours that are no numbers."""
    shown = layout.colours or ()
    wanted = (*layout.points, *(layout.normals or ()))
    try:
        table = _numbers(path, form, (*wanted, *shown), limit)
    except ValueError:
        if not shown:
            raise
        table, shown = _numbers(path, form, wanted, limit), ()
    own = tuple(range(len(wanted), len(wanted) + 3)) if shown else None
    return replace(layout, points=(0, 1, 2), normals=(3, 4, 5) if layout.normals else None, colours=own), table


def _form(path: Path) -> _Form:
    """How the table in a file is written, by its first lines."""
    comments, lines = _first_lines(path)
    said = None
    if len(lines) > 1 and re.fullmatch(r"\d{1,12}", lines[0][1]) and len(_words(lines[1][1])[0]) > 1:
        said = int(lines.pop(0)[1])
    names: list[str] = []
    if lines and not all(map(_is_number, _words(lines[0][1])[0])):
        names = _header_words(lines.pop(0)[1])
    if not lines:
        return _Form(names, None, _NOTHING, False, said)
    words, delimiter, comma = _style([text for _, text in lines])
    if len(words) > MOST_COLUMNS:  # numpy makes room for as many in every row that there may be
        raise ValueError(f"{len(words)} columns")
    if names and len(names) != len(words):
        got = f"{len(names)} names ({', '.join(names)[:80]}) of {len(words)}"
        raise InputError(f"{path}: expected a name for each column, x, y, z [nx, ny, nz]; got {got}")
    for comment in () if names else comments:
        told = _header_words(comment.lstrip("/#"))
        if len(told) == len(words) and {"x", "y", "z"} <= {plain_name(word)[0] for word in told}:
            names = told
    return _Form(names, delimiter, lines[0][0], comma, said, any('"' in text for _, text in lines))


def _first_lines(path: Path) -> tuple[list[str], list[tuple[int, str]]]:
    """The comments before the first row, and the first rows with their numbers in the file."""
    comments: list[str] = []
    lines: list[tuple[int, str]] = []
    with path.open(encoding="utf-8-sig") as stream:
        for number in range(_MOST_LINES):
            line = stream.readline(_LONGEST_LINE)
            if not line or len(lines) >= _SAMPLE:
                break
            text = line.strip()
            if text.startswith(_COMMENTS):
                comments += [] if lines else [text]
            elif text:
                lines.append((number, text))
    return comments, lines


def _style(lines: list[str]) -> tuple[list[str], str | None, bool]:
    """The first line's words, the delimiter, and whether a comma is the decimal point."""
    mark = ";" if any(";" in line for line in lines) else None
    split = [[word.strip() for word in line.split(mark)] for line in lines]
    comma = any(_DECIMAL_COMMA.fullmatch(word) for words in split for word in words)
    if comma and (mark or all(len(words) > 1 and not any(w.endswith(",") for w in words) for words in split)):
        return split[0], mark, True
    words, delimiter = _words(lines[0])
    return words, delimiter, False


def _words(line: str) -> tuple[list[str], str | None]:
    delimiter = next((mark for mark in ";," if mark in line), None)
    words = [word.strip().strip('"') for word in line.split(delimiter)]
    if delimiter == "," and len(line.split()) > 2 and all(_DECIMAL_COMMA.fullmatch(word) for word in line.split()):
        return [word.replace(",", ".") for word in line.split()], None
    if delimiter == ";":
        words = [word.replace(",", ".") if _DECIMAL_COMMA.fullmatch(word) else word for word in words]
    return words, delimiter


def _header_words(line: str) -> list[str]:
    delimiter = next((mark for mark in ";,\t" if mark in line), None)
    joined = line if delimiter else re.sub(r"\s+([\[(])", r"\1", line)
    return [word.strip().strip('"') for word in joined.split(delimiter)]


def _is_number(word: str) -> bool:
    try:
        _number(word)
    except ValueError:
        return False
    return True


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        if _NO_NUMBER.fullmatch(word.strip()):
            return float("nan")
        raise


def _numbers(path: Path, form: _Form, wanted: tuple[int, ...] | None, limit: int) -> np.ndarray:
    """(N, C) the columns `wanted` (None: all) of a table; slower where it has words that numpy does not read."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*contained no data")
        settings: dict[str, Any] = {
            "delimiter": form.delimiter,
            "skiprows": form.skipped,
            "comments": "#" if form.quoted else _COMMENTS,  # numpy has no quotes beside longer marks of comments
            "ndmin": 2,
            "max_rows": limit + 1,
            "encoding": "utf-8-sig",
            "usecols": wanted,
            "quotechar": '"' if form.quoted else None,
        }
        if not form.comma:
            try:
                return np.loadtxt(path, **settings)
            except ValueError:
                pass
        with path.open(encoding="utf-8-sig") as stream:  # the # in what Windows writes for NaN begins no comment
            lines = (_WINDOWS_NAN.sub("nan", line) for line in stream)
            return np.loadtxt(lines, converters=_with_comma if form.comma else _number, **settings)


def _with_comma(word: str) -> float:
    return _number(word.replace(",", "."))


def _without_empty_end(table: np.ndarray) -> np.ndarray:
    """The table without a last column of nothing, as a delimiter at the end of each line makes it."""
    return table[:, :-1] if table.shape[1] > 3 and np.isnan(table[:, -1]).all() else table
