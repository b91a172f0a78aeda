"""Mesh data sets as they lie on disk: which layout a folder has, and which file stands for each object.

Where an object has several files, the one of the first of a layout's patterns is taken. About 16,000 faces are
preferred. On YCB's bowl, whose wall is 0.9 mm, collision pieces of 16,000, 65,000 and 262,000 faces differ by 1 to 2 %
of the volume and take 4, 8 and 19 s to cut; 5,000 faces by decimation lose 2 % of the volume, 800 lose 21 % of it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import FITTED, SUFFIXES

DEPTH = 3  # folders and file below the root, at most, in any of the layouts


@dataclass(frozen=True)
class Layout:
    """How a data set arranges its files.

    Attributes:
        name: the common one.
        unit: of its meshes: m, mm, or FITTED where they have none.
        patterns: regular expressions of paths below the root, without regard to case, the preferred ones first;
            the group `name` is the object's, `variant` is what tells one pattern's files from another's.
    """

    name: str
    unit: str
    patterns: tuple[str, ...]


@dataclass(frozen=True)
class Found:
    """A folder's layout, and of each object, by name, the preferred file and which variant that is."""

    layout: Layout
    files: Mapping[str, Path]
    variants: Mapping[str, str]

    def words(self, names: Iterable[str]) -> str:
        """The variants of the objects `names` with how many there are of each."""
        counted = Counter(self.variants[name] for name in names)
        return ", ".join(f"{variant} ({count})" for variant, count in counted.items())


YCB = Layout(
    "YCB",
    "m",
    tuple(
        rf"(?P<name>\d{{3}}[-_][^/]+)/(?P<variant>{folder}/{re.escape(file)})"
        for folder in ("google_16k", "google_64k", "google_512k", "poisson", "tsdf")
        for file in ("nontextured.ply", "nontextured.stl", "textured.obj")
    ),
)
KIT = Layout(
    "KIT",
    "mm",
    tuple(
        rf"(?P<name>[^/]+)/meshes/[^/]+(?P<variant>_{size}{texture}\.obj)"
        for size in ("25k", "5k", "Orig", "800")
        for texture in ("", "_tex")
    ),
)
GSO = Layout(
    "Google Scanned Objects",
    "m",
    (r"(?P<name>[^/]+)/(?P<variant>meshes/model\.obj)", r"(?P<name>[^/]+)/(?P<variant>model\.obj)"),
)
# A0 to G6 are the evaluation set, A00_0 to Y24_9 the training set.
EGAD = Layout("EGAD", FITTED, (r"(?P<name>[A-G][0-6]|[A-Y]\d\d_\d)(?P<variant>\.(obj|stl))",))
FLAT = Layout("flat", "m", tuple(rf"(?P<name>[^/]+)(?P<variant>\{suffix})" for suffix in SUFFIXES))
# Of layouts that fit equally many objects the first is taken.
LAYOUTS = (YCB, KIT, GSO, EGAD, FLAT)


def recognise(folder: Path) -> Found:
    """The layout that most objects in `folder` follow, and their files, sorted by name.

    Names are those on disk, with `_` for what is not a letter, a digit, `_` or `-`.

    Raises InputError for a folder without meshes, with meshes in no known layout, or with two objects of one name.
    """
    paths = sorted(path.relative_to(folder).as_posix() for path in _meshes(folder))
    found = max((_matched(folder, layout, paths) for layout in LAYOUTS), key=lambda found: len(found.files))
    if not found.files:
        raise InputError(
            f"{folder}: expected meshes ({', '.join(SUFFIXES)}), got "
            + (f"{paths[0]} and no layout of {', '.join(layout.name for layout in LAYOUTS)}" if paths else "none")
        )
    return found


def has_meshes(folder: Path) -> bool:
    """Whether there are mesh files where a layout would have them."""
    return next(_meshes(folder), None) is not None


def _meshes(folder: Path) -> Iterator[Path]:
    for depth in range(1, DEPTH + 1):
        for path in folder.glob("/".join("*" * depth)):
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file():
                yield path


def _matched(folder: Path, layout: Layout, paths: list[str]) -> Found:
    best: dict[str, tuple[int, str, str, str]] = {}
    for path in paths:
        for rank, pattern in enumerate(layout.patterns):
            match = re.fullmatch(pattern, path, re.IGNORECASE)
            if match is None:
                continue
            name, entry = re.sub(r"[^A-Za-z0-9_-]", "_", match["name"]), (rank, path, match["name"], match["variant"])
            if name in best and best[name][2] != match["name"]:
                raise InputError(f"{folder}: expected each name once, got {best[name][1]} and {path} as {name}")
            best[name] = min(best.get(name, entry), entry)
            break
    names = sorted(best)
    return Found(layout, {n: folder / best[n][1] for n in names}, {n: best[n][3] for n in names})
