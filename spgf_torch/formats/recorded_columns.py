"""The columns of a table of recorded trials, CSV or Parquet: which there are, and their values as written."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.files.checks import LARGEST
from spgf_torch.files.parquet import parquet_table
from spgf_torch.files.reading import reason, text

WHAT = "a table of recorded trials"
MOST_ROWS = 1_000_000
POSITION, QUATERNION, VIEW = ("x", "y", "z"), ("qw", "qx", "qy", "qz"), ("view_x", "view_y", "view_z")
MATRIX = tuple(f"t{row}{column}" for row in range(3) for column in range(4))
COLUMNS = ("object", "success", "type", "frame", "cloud", "class", *POSITION, *QUATERNION, *MATRIX, *VIEW)


def read_columns(path: Path) -> tuple[dict[str, list[Any]], tuple[str, ...]]:
    """The known columns that a table has, by name, and the names of the others. An empty value is None.

    A file whose name does not end with .parquet is read as CSV.
    """
    if path.suffix.lower() == ".parquet":
        content = parquet_table(path, WHAT, None, MOST_ROWS)
        given = {name: values.to_pylist() for name, values in zip(content.column_names, content.columns, strict=True)}
    else:
        given = _csv(path)
    known: dict[str, list[Any]] = {}
    for name, values in given.items():
        if (plain := name.strip().lower()) in COLUMNS:
            if plain in known:
                raise InputError(f"{path}: expected each column once, got {plain} twice")
            known[plain] = [_value(value) for value in values]
    return known, tuple(name for name in given if name.strip().lower() not in COLUMNS)


def _value(value: Any) -> Any:
    if isinstance(value, str):
        return value.strip() or None
    return None if isinstance(value, float) and math.isnan(value) else value


def _csv(path: Path) -> dict[str, list[Any]]:
    content = text(path, WHAT, LARGEST).removeprefix("\ufeff")
    try:
        rows = list(csv.reader(io.StringIO(content), strict=True))
    except csv.Error as error:
        raise InputError(f"{path}: expected {WHAT}, got {reason(error)}") from None
    names, rows = (rows[0], [row for row in rows[1:] if row]) if rows else ([], [])
    if len(rows) > MOST_ROWS:
        raise InputError(f"{path}: expected {WHAT} of at most {MOST_ROWS} rows, got {len(rows)}")
    for number, row in enumerate(rows, 1):
        if len(row) != len(names):
            raise InputError(f"{path}: row {number}: expected {len(names)} values, got {len(row)}")
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def check_columns(path: Path, columns: Mapping[str, Any], types: Sequence[str]) -> None:
    """InputError for a table that lacks what every trial needs, or has two poses a row."""
    poses = [all(name in columns for name in form) for form in ((*POSITION, *QUATERNION), MATRIX)]
    missing = [name for name in ("object", "success") if name not in columns]
    if not missing and "type" not in columns and len(types) > 1:
        missing = [f"type ({', '.join(types)})"]
    if not any(poses):
        missing.append("x, y, z, qw, qx, qy, qz (or t00 to t23)")
    if missing:
        got = ", ".join(columns) or "none of them"
        raise InputError(f"{path}: expected {WHAT} with the columns {', '.join(missing)}; got {got}")
    if all(poses):
        raise InputError(f"{path}: expected one pose a row, got a quaternion and a matrix")


def rows_of(columns: Mapping[str, list[Any]]) -> Iterator[dict[str, Any]]:
    """Column -> value of each row, where there is one."""
    for values in zip(*columns.values(), strict=True):
        yield {name: value for name, value in zip(columns, values, strict=True) if value is not None}
