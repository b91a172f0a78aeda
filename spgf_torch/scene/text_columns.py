"""Which column of a table of points is what: by name, else by its values."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.colours import NAMES, colour_bytes

MOST_COLUMNS = 100
_POINT, _NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
_UNIT = re.compile(r"^(.*?)[\s_]*[\[(]\s*(\w+)\s*[\])]$")
_UNIT_TAIL = re.compile(r"^([xyz])_(m|cm|mm|km|um|in|inch|ft|feet)$")
_AXIS = {"0": "x", "1": "y", "2": "z"}
_POINT_NAME = re.compile(
    r"^(?:points?|coordinates?|coords?|pos|position|p|pt|vertex)?[\s_:.]*([xyz012])(?:[\s_]*coord(?:inate)?)?$"
)
_NORMAL_NAME = re.compile(r"^(?:normals?|norm|n)[\s_:.]*([xyz012])$")
# Of the length of normals, which may be rounded.
_LENGTH_TOLERANCE = 0.1
_MOST_UNNAMED = 10


@dataclass(frozen=True)
class Layout:
    """Columns of a table.

    Attributes:
        points: the three of x y z.
        normals: the three of the normals; None: there are none. colours: the three of red, green and blue.
        unit: that the names state; None: they do not.
        notes: what was taken for what.
    """

    points: tuple[int, ...] = (0, 1, 2)
    normals: tuple[int, ...] | None = None
    unit: str | None = None
    notes: tuple[str, ...] = ()
    colours: tuple[int, ...] | None = None

    def colours_of(self, table: np.ndarray) -> np.ndarray | None:
        """(N, 3) uint8 of a table (N, C), 0 where a point has no reading; None where there are none."""
        if self.colours is None:
            return None
        known = np.isfinite(table[:, self.points]).all(axis=1)
        return colour_bytes(np.where(known[:, None], table[:, self.colours], 0.0))


def named_layout(name: str, given: Sequence[str]) -> Layout:
    """The columns by their names, as CloudCompare, ParaView, PCL, pandas and users write them.

    Raises:
        InputError: no x, y and z, two of one name, a unit that is not known.
    """
    units: dict[str, str] = {}
    names = []
    for word in given:
        plain, unit = plain_name(word)
        names.append(plain)
        if unit and plain in _POINT:
            units[plain] = unit
    twice = [axis for axis in (*_POINT, *_NORMAL) if names.count(axis) > 1]
    if twice or not set(_POINT) <= set(names):
        got = ", ".join(given)
        raise InputError(f"{name}: expected columns named x, y, z [nx, ny, nz]{' once' if twice else ''}; got {got}")
    if units and (len(set(units.values())) > 1 or len(units) < 3 or next(iter(units.values())) not in METRES):
        got = ", ".join(f"{axis} in {unit}" for axis, unit in units.items())
        raise InputError(f"{name}: expected one unit of x, y and z, {', '.join(METRES)}; got {got}")
    normals = tuple(names.index(axis) for axis in _NORMAL) if set(_NORMAL) <= set(names) else None
    tints = next((each for each in NAMES if set(each) <= set(names)), None)
    colours = None if tints is None else tuple(names.index(tint) for tint in tints)
    points = tuple(names.index(axis) for axis in _POINT)
    return Layout(points, normals, next(iter(units.values()), None), colours=colours)


def layout_by_values(name: str, table: np.ndarray, intensity: bool = False) -> Layout:
    """The columns of a table (N, C) without names: x y z first; then normals are what has length 1.

    Args:
        intensity: a fourth column may be anything, as in .pts files.

    Raises:
        InputError: it is ambiguous.
    """
    count = table.shape[1]
    table = table[np.isfinite(table[:, :3]).all(axis=1) & (table[:, :3] != 0).any(axis=1)]
    if count >= 3 and (count == 3 or not len(table)):  # without a reading anywhere: refused with the cloud
        return Layout()
    if count == 4 and (table[:, 3] == 1).all():
        return Layout(notes=("column 4, which is 1 throughout, left out (homogeneous coordinates)",))
    if count == 4 and intensity:
        return Layout(notes=("column 4 taken for an intensity",))
    if count == 6 and not _colours(table[:, 3:]):
        bare = _unit_length(table[:, 3:]) and bool((table[:, 3:] >= 0).all())
        doubt = "warning: columns 4 to 6 taken for normals; if they are colours, a first line x y z r g b says so"
        return Layout(normals=(3, 4, 5), notes=(doubt,) if bare else ())  # whose length is checked with the cloud
    starts = range(3, min(count, _MOST_UNNAMED + 1) - 2) if count <= _MOST_UNNAMED else range(0)
    units = [start for start in starts if _unit_length(table[:, start : start + 3])]
    colours = [start for start in starts if _colours(table[:, start : start + 3])]
    if len(units) == 1:
        colours = [start for start in colours if abs(start - units[0]) >= 3]
    if len(units) == 1 or (not units and colours):
        return _unnamed(count, units, colours)
    raise InputError(
        f"{name}: expected 3 columns x y z or 6 with normals (or a line of names), got {count}; write a first line "
        "such as x y z intensity, or x y z alone"
    )


def _unnamed(count: int, units: Sequence[int], colours: Sequence[int]) -> Layout:
    """The layout of `count` columns of which three from here are normals, and from one of there are colours."""
    normals = (units[0], units[0] + 1, units[0] + 2) if units else None
    tints = (colours[0], colours[0] + 1, colours[0] + 2) if len(colours) == 1 else None
    told = [
        *([f"columns {normals[0] + 1} to {normals[2] + 1}, of length 1, taken for normals"] if normals else []),
        *([f"columns {tints[0] + 1} to {tints[2] + 1} taken for colours"] if tints else []),
        *(["those after z taken for colours and the like"] if not normals and not tints else []),
    ]
    if 3 + 3 * bool(normals) + 3 * bool(tints) < count:
        told.append("the others after z left out" if normals or tints else "left out")
    return Layout(normals=normals, notes=(f"{count} columns without names: {', '.join(told)}",), colours=tints)


def plain_name(word: str) -> tuple[str, str | None]:
    """A column's name as x y z nx ny nz where it is one of these, and the unit in it."""
    name = word.strip().strip('"').lstrip("/#").strip().lower()
    unit = None
    if match := _UNIT.match(name) or _UNIT_TAIL.match(name):
        name, unit = match[1], match[2]
    if match := _NORMAL_NAME.match(name):
        return "n" + _AXIS.get(match[1], match[1]), unit
    if (match := _POINT_NAME.match(name)) and name not in _AXIS:
        return _AXIS.get(match[1], match[1]), unit
    return name, unit


def _unit_length(columns: np.ndarray) -> bool:
    """Whether the rows (N, 3) are normals: of length 1, all that are numbers and not 0, which are most."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(columns, axis=1)
    usable = np.isfinite(length) & (length > 0)
    return 2 * int(usable.sum()) >= len(columns) > 0 and bool((np.abs(length[usable] - 1) <= _LENGTH_TOLERANCE).all())


def _colours(columns: np.ndarray) -> bool:
    """Whether the rows (N, 3) are colours: whole numbers up to 255 or numbers up to 1, and no normals."""
    if _unit_length(columns) or not np.isfinite(columns).all() or not columns.any() or columns.min() < 0:
        return False
    return bool(columns.max() <= 1 or (columns.max() <= 255 and (columns == np.round(columns)).all()))
