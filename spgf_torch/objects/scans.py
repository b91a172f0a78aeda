"""Scanned meshes from a folder with a manifest: what is read, what is refused, and the objects they become."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from spgf_torch.config import CollisionConfig, InputError
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.shell import PieceCheck, collision_pieces

MANIFEST = "manifest.csv"
SUFFIXES = (".ply", ".obj", ".stl", ".off", ".glb")
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
CATEGORIES = {"container": "containers", "box": "boxes", "curved": "curved"}


@dataclass(frozen=True)
class Scan:
    """A scanned object and how well its collision pieces stand for its mesh."""

    object: GraspObject
    check: PieceCheck


@dataclass(frozen=True)
class _Row:
    """One line of the manifest; `mass` in kg, None where the manifest has none."""

    name: str
    file: Path
    category: str
    mass: float | None


def load_scans(folder: Path, unit: str, collision: CollisionConfig) -> list[Scan]:
    """Read every mesh that the folder's manifest lists, sorted by name.

    Args:
        folder: holds meshes (.ply, .obj, .stl, .off, .glb) and a `manifest.csv` with the columns name, file
            (relative to the folder), class (container, box or curved) and, where known, mass in kg. Other columns
            are ignored. Without a mass an object weighs its mesh's volume times `collision.wall_density`
            (containers, whose mesh is their wall) or `collision.density` (the others, closed outer surfaces).
        unit: of the meshes: m, cm or mm.

    Returns:
        the scans; each object's frame is its mesh's, scaled to metres and otherwise untouched.

    Raises InputError, which names the file, for a folder without meshes or manifest, a manifest row that cannot be
    used, and a mesh that is unreadable, empty, not finite, of an unlikely size, not closed, or inside out.
    """
    if unit not in METRES:
        raise InputError(f"unit: expected one of {', '.join(METRES)}; got {unit}")
    rows = _manifest(Path(folder))
    return [_scan(row, unit, collision) for row in sorted(rows, key=lambda row: row.name)]


def read_mesh(path: Path, unit: str, collision: CollisionConfig) -> trimesh.Trimesh:
    """The mesh in `path` in metres, duplicate vertices merged; closed, with its normals outwards.

    Raises InputError, which names the file, as `load_scans` does.
    """
    vertices, faces = _read(path)
    if not len(faces):
        raise InputError(f"{path}: expected a mesh with faces, got {len(vertices)} vertices and no face")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(f"{path}: expected finite vertices, got {bad} of {len(vertices)} with NaN or infinity")
    vertices = vertices * METRES[unit]
    _check_size(path, float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max()), unit, collision)
    mesh = _merged(vertices, faces)
    _check_closed(path, mesh)
    return mesh


def _manifest(folder: Path) -> list[_Row]:
    if not folder.is_dir():
        got = "a file" if folder.exists() else "nothing there"
        raise InputError(f"{folder}: expected a folder of meshes, got {got}")
    if not any(path.suffix.lower() in SUFFIXES for path in folder.rglob("*")):
        raise InputError(f"{folder}: expected meshes ({', '.join(SUFFIXES)}), got none")
    path = folder / MANIFEST
    if not path.is_file():
        columns = f"name, file, class ({', '.join(CATEGORIES)})"
        raise InputError(f"{path}: expected a table with the columns {columns}; got none")
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(_rows(path, csv.DictReader(stream, restval="")))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: expected a table of comma-separated text, got {error}") from error
    if not rows:
        raise InputError(f"{path}: expected one line a mesh, got none")
    return rows


def _rows(path: Path, reader: csv.DictReader) -> Iterator[_Row]:
    missing = {"name", "file", "class"} - set(reader.fieldnames or ())
    if missing:
        got = ", ".join(reader.fieldnames or ()) or "none"
        raise InputError(f"{path}: expected the columns name, file, class; got {got}")
    seen: dict[str, int] = {}
    for record in reader:
        place = f"{path}:{reader.line_num}"
        row = _row(path.parent, place, {key: value.strip() for key, value in record.items() if isinstance(value, str)})
        if row.name in seen:
            raise InputError(f"{place}: expected each name once, got {row.name} again (line {seen[row.name]})")
        seen[row.name] = reader.line_num
        yield row


def _row(folder: Path, place: str, record: dict[str, str]) -> _Row:
    name, file, category = record["name"], Path(record["file"]), record["class"]
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise InputError(f"{place}: name: expected letters, digits, _ and -, got {name!r}")
    if category not in CATEGORIES:
        raise InputError(f"{place}: class: expected one of {', '.join(CATEGORIES)}; got {category!r}")
    if file.is_absolute() or ".." in file.parts or file.suffix.lower() not in SUFFIXES:
        raise InputError(f"{place}: file: expected a {'/'.join(SUFFIXES)} below {folder}, got {record['file']!r}")
    if not (folder / file).is_file():
        raise InputError(f"{folder / file}: expected the mesh that {place} lists, got nothing there")
    return _Row(name, folder / file, CATEGORIES[category], _mass(place, record.get("mass", "")))


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


def _scan(row: _Row, unit: str, collision: CollisionConfig) -> Scan:
    mesh = read_mesh(row.file, unit, collision)
    pieces, check = collision_pieces(mesh, collision, label=str(row.file))
    density = collision.wall_density if row.category == "containers" else collision.density
    mass = row.mass if row.mass is not None else density * float(mesh.volume)
    inertia = np.array(mesh.moment_inertia) * (mass / mesh.volume)
    return Scan(GraspObject(row.name, row.category, mesh, pieces, mass, np.array(mesh.center_mass), inertia), check)


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) float64 vertices and (F, 3) int64 triangles as the file has them; no triangles for a point cloud."""
    try:
        loaded = trimesh.load_scene(path, process=False).to_geometry()
    except Exception as error:  # each format's reader raises its own kinds for a damaged file
        raise InputError(f"{path}: expected a {path.suffix} mesh, got a damaged file ({_short(error)})") from error
    vertices = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), dtype=np.float64)
    return vertices, np.asarray(getattr(loaded, "faces", np.empty((0, 3))), dtype=np.int64)


def _short(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0][:100]


def _merged(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    """One vertex a place, as formats repeat them at texture seams or for every face; no face with a corner twice."""
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.remove_unreferenced_vertices()
    return mesh


def _check_size(path: Path, extent: float, unit: str, collision: CollisionConfig) -> None:
    low, high = collision.min_extent, collision.max_extent
    if low <= extent <= high:
        return
    fitting = [f"unit={other}" for other, metres in METRES.items() if low <= extent * metres / METRES[unit] <= high]
    hint = f"; {' or '.join(fitting)} would fit" if fitting else ""
    raise InputError(f"{path}: expected an extent of {low:g} to {high:g} m, got {extent:.4g} m with unit={unit}{hint}")


def _check_closed(path: Path, mesh: trimesh.Trimesh) -> None:
    shared = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    if (shared != 2).any():
        raise InputError(
            f"{path}: expected a closed surface, two faces at every edge; got {(shared == 1).sum()} open edges and "
            f"{(shared > 2).sum()} edges with more than two faces"
        )
    if not mesh.is_winding_consistent:
        raise InputError(f"{path}: expected all faces to turn the same way round, got a mixture")
    if mesh.volume <= 0.0:
        raise InputError(
            f"{path}: expected normals pointing outwards, got an inverted mesh (volume {mesh.volume * 1e6:.4g} cm3)"
        )
