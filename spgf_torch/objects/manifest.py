"""`manifest.csv` beside meshes: which of them are objects, and what is known of each."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import SUFFIXES

MANIFEST = "manifest.csv"
CATEGORIES = {"container": "containers", "box": "boxes", "curved": "curved"}
LONGEST_NAME = 100  # characters; files have names of 255


@dataclass(frozen=True)
class Entry:
    """One line of a manifest; None where it says nothing.

    Attributes:
        place: file and line, for messages.
        file: the mesh; it exists.
        category: one of `config.CLASSES`.
        mass: kg.
    """

    place: str
    name: str
    file: Path | None
    category: str | None
    mass: float | None


def read_manifest(path: Path) -> list[Entry]:
    """The lines of a table with the columns name, file (relative to the table), class and mass; others are ignored.

    Raises InputError, which names the file and line, for what is no such table, a line that cannot be used, and a
    name that occurs twice.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            entries = list(_entries(path, csv.DictReader(stream, restval="")))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: expected a table of comma-separated text, got {error}") from error
    if not entries:
        raise InputError(f"{path}: expected one line a mesh, got none")
    return entries


def _entries(path: Path, reader: csv.DictReader) -> Iterator[Entry]:
    if "name" not in (reader.fieldnames or ()):
        got = ", ".join(reader.fieldnames or ()) or "none"
        raise InputError(f"{path}: expected the columns name, file, class; got {got}")
    seen: dict[str, int] = {}
    for record in reader:
        place = f"{path}:{reader.line_num}"
        values = {key: value.strip() for key, value in record.items() if isinstance(value, str)}
        entry = _entry(path.parent, place, values)
        if entry.name in seen:
            raise InputError(f"{place}: expected each name once, got {entry.name} again (line {seen[entry.name]})")
        seen[entry.name] = reader.line_num
        yield entry


def _entry(folder: Path, place: str, record: dict[str, str]) -> Entry:
    name, category = record["name"], record.get("class", "")
    check_name(name, f"{place}: name")
    if category and category not in CATEGORIES:
        raise InputError(f"{place}: class: expected one of {', '.join(CATEGORIES)}; got {category!r}")
    file = _file(folder, place, record["file"]) if "file" in record else None
    return Entry(place, name, file, CATEGORIES.get(category), _mass(place, record.get("mass", "")))


def check_name(name: str, where: str) -> None:
    """InputError for a name that could not be part of a file's: other characters, none, or too many."""
    if len(name) > LONGEST_NAME:
        raise InputError(f"{where}: expected at most {LONGEST_NAME} characters, got {len(name)}")
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise InputError(f"{where}: expected letters, digits, _ and -, got {name!r}")


def _file(folder: Path, place: str, text: str) -> Path:
    file = Path(text)
    if file.is_absolute() or ".." in file.parts or file.suffix.lower() not in SUFFIXES:
        raise InputError(f"{place}: file: expected a {'/'.join(SUFFIXES)} below {folder}, got {text!r}")
    try:
        there = (folder / file).is_file()
    except OSError:  # a name too long
        there = False
    if not there:
        raise InputError(f"{folder / file}: expected the mesh that {place} lists, got nothing there")
    return folder / file


def _mass(place: str, text: str) -> float | None:
    if not text:
        return None
    try:
        mass = float(text)
    except ValueError:
        mass = math.nan
    if not 0.0 < mass < math.inf:
        raise InputError(f"{place}: mass: expected kilograms above 0, got {text!r}")
    return mass
