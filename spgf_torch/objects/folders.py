"""A folder of objects, whatever lies in it: descriptions of ours, meshes with a manifest, or a data set's layout."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from joblib import Parallel, delayed

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.config import CLASSES, CollisionConfig, ObjectsConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.layouts import Found, has_meshes, recognise
from spgf_torch.objects.library import load_objects
from spgf_torch.objects.manifest import CATEGORIES, MANIFEST, Entry, read_manifest
from spgf_torch.objects.scans import FITTED, NOTHING_KEPT, Body, Scan, Source, read_body, scan_of
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter

AUTO = "auto"  # unit: the layout's own
LISTED = "manifest"  # category: what the manifest says
MANY = 8  # meshes; fewer are read before other processes have started


@dataclass(frozen=True)
class Objects:
    """What a folder held.

    Attributes:
        objects: sorted by name.
        scans: the same with the checks of their collision pieces, where the folder held meshes.
        notes: a line each on what the folder was taken for and on what was mended or left out.
    """

    objects: list[GraspObject]
    scans: list[Scan]
    notes: list[str]


def read_objects(config: ObjectsConfig, stages: ProgressReporter, cache: Cache = NOTHING_KEPT) -> Objects:
    """Every object of the folder `config.objects`.

    Descriptions (*.yaml, `library`), or meshes: those that `manifest.csv` names with their files, else those of the
    layout that is recognised (`layouts`), of which a manifest without the column `file` may list some. A mesh's class
    is the manifest's, else `config.category`. Its unit is `config.unit`, else the layout's, else m. Collision pieces
    are taken from `cache` and kept there.

    Raises InputError in one line for a folder with neither, or with both; for a manifest that cannot be used; for
    objects without a class; and for the first mesh that cannot be used, unless `config.skip_bad`.
    """
    folder = find(config.objects)
    described = sorted(folder.glob("*.yaml"))
    if described and has_meshes(folder):
        raise InputError(f"{folder}: expected descriptions or meshes, got both ({described[0].name} among them)")
    if described:
        objects = load_objects(folder)
        return Objects(objects, [], [f"{folder}: {_count(len(objects), 'described object')}"])
    sources, unit, note = _meshes(folder, config)
    with stages.stage("objects", len(sources), "meshes") as advance:
        scans, notes = _scans(sources, unit, config, cache, advance)
    return Objects([scan.object for scan in scans], scans, [note, *notes])


def _meshes(folder: Path, config: ObjectsConfig) -> tuple[list[Source], str, str]:
    """The meshes of a folder, sorted by name, their unit, and a line on what the folder was taken for."""
    if not folder.is_dir():
        got = "a file" if folder.exists() else "nothing there"
        raise InputError(f"{folder}: expected a folder of objects, got {got}")
    manifest = folder / MANIFEST
    entries = read_manifest(manifest) if manifest.is_file() else []
    if entries and entries[0].file is not None:
        files, kind, unit, details = {entry.name: entry.file for entry in entries if entry.file}, MANIFEST, "m", ""
    else:
        found = recognise(folder)
        entries = entries or [Entry(str(file), name, None, None, None) for name, file in found.files.items()]
        files, kind, unit = _listed(entries, found), f"{found.layout.name} layout", found.layout.unit
        details = f": {found.words(files)}"
    unit = unit if config.unit == AUTO else config.unit
    scale = f"scaled to the hand's {_width(config) * 1e3:g} mm" if unit == FITTED else f"unit {unit}"
    note = f"{folder}: {kind}, {_count(len(files), 'object')}, {scale}{details}"
    sources = [Source(entry.name, files[entry.name], _category(folder, entry, config), entry.mass) for entry in entries]
    return sorted(sources, key=lambda source: source.name), unit, note


def _listed(entries: Sequence[Entry], found: Found) -> dict[str, Path]:
    """The files that a layout has for the objects of a manifest without files."""
    for entry in entries:
        if entry.name not in found.files:
            raise InputError(
                f"{entry.place}: name: expected an object of the {found.layout.name} layout beside it, got {entry.name}"
            )
    return {entry.name: found.files[entry.name] for entry in entries}


def _category(folder: Path, entry: Entry, config: ObjectsConfig) -> str:
    if entry.category is not None:
        return entry.category
    if config.category == LISTED:
        raise InputError(
            f"{folder}: expected a class for {entry.name}: category={'|'.join(CLASSES)} for all, or a {MANIFEST} "
            f"with the columns name and class ({', '.join(CATEGORIES)}); got neither"
        )
    return config.category


def _scans(
    sources: Sequence[Source], unit: str, config: ObjectsConfig, cache: Cache, advance: Callable[[int], None]
) -> tuple[list[Scan], list[str]]:
    """The scans of the meshes that can be used, and a line on each that was mended or left out."""
    bodies, scans, notes = [], [], []
    for source in sources:  # all are looked at before the first is cut into pieces, which takes longer
        try:
            bodies.append(read_body(source, unit, _width(config), config.collision))
        except InputError as error:
            if not config.skip_bad:
                raise _with_hint(error, len(sources)) from None
            notes.append(f"left out: {error}")
            advance(1)
    notes += [f"mended: {body.source.file}: {body.mended}" for body in bodies if body.mended]
    for cut in _cut(bodies, config, cache):
        if isinstance(cut, InputError):
            notes.append(f"left out: {cut}")
        else:
            scans.append(cut)
        advance(1)
    if not scans:
        raise InputError(f"{config.objects}: expected a mesh that can be used, got none; {notes[0]}")
    return scans, notes


def _cut(bodies: Sequence[Body], config: ObjectsConfig, cache: Cache) -> Iterator[Scan | InputError]:
    """Each mesh cut into pieces, or why it cannot be, in order; by several processes where there are many."""
    workers = 1 if len(bodies) < MANY else config.workers or -1
    settings = config.collision, config.skip_bad, cache.folder, cache.limit
    try:
        yield from Parallel(workers, return_as="generator")(delayed(_cut_one)(body, *settings) for body in bodies)
    except InputError as error:
        raise _with_hint(error, len(bodies)) from None


def _cut_one(body: Body, collision: CollisionConfig, skip: bool, kept_in: Path | None, limit: int) -> Scan | InputError:
    try:
        return scan_of(body, collision, Cache(kept_in, limit / 1e9))
    except InputError as error:
        if skip:
            return error
        raise


def _with_hint(error: InputError, meshes: int) -> InputError:
    return InputError(f"{error} (skip_bad=true goes on without it)") if meshes > 1 else error


def _width(config: ObjectsConfig) -> float:
    """How far the hand opens in its widest preshape, m."""
    return max(preshape.opening for preshape in load_hand(config.hand).preshapes.values())


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
