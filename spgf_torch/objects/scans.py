"""Scanned meshes: what is read, mended or refused, and the objects they become."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.mending import mended, open_edges, signed_volume
from spgf_torch.objects.piece_cache import kept_pieces
from spgf_torch.objects.shell import PieceCheck

SUFFIXES = (".ply", ".obj", ".stl", ".off", ".glb")
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
# In place of a unit: the mesh has none and is scaled to the gripper (`fit`).
FITTED = "fitted"
# EGAD's own scripts/prepare_meshes.py: the least side of a mesh may be this share of the gripper's width.
GRIPPED = 0.8
# m, twice volume over area: a fifth of a sheet of paper; nothing thinner can be cut into convex pieces.
MIN_THICKNESS = 2e-5
NOTHING_KEPT = Cache(None)


@dataclass(frozen=True)
class Source:
    """A mesh file and what is known of the object; `mass` in kg, None where it follows from the volume."""

    name: str
    file: Path
    category: str
    mass: float | None = None


@dataclass(frozen=True)
class Body:
    """A mesh that can be used: closed, in m, normals outwards; `mended` says in words what was put right, if any."""

    source: Source
    mesh: trimesh.Trimesh
    mended: str


@dataclass(frozen=True)
class Scan:
    """A scanned object and how well its collision pieces approximate its mesh."""

    object: GraspObject
    check: PieceCheck


def read_body(source: Source, unit: str, width: float, collision: CollisionConfig) -> Body:
    """Read a mesh and put right what can be (`mending`).

    Args:
        unit: of the mesh: m, cm, mm or FITTED.
        width: of the opened gripper, m; what a mesh without a unit is scaled to.

    Returns:
        the mesh in its own frame, scaled to metres and otherwise untouched.

    Raises InputError, which names the file, for a mesh that is unreadable, empty, not finite, of an unlikely size,
    not closed, or whose faces turn both ways round, beyond mending.
    """
    vertices, faces = _read(source.file)
    if unit == FITTED:
        vertices = vertices * fit(vertices[faces.ravel()], width)
    else:
        vertices = _metres(source.file, vertices, faces, unit, collision)
    mesh, words = mended(_merged(vertices, faces), collision.max_hole)
    _check_closed(source.file, mesh)
    return Body(source, mesh, ", ".join(words))


def scan_of(body: Body, collision: CollisionConfig, cache: Cache = NOTHING_KEPT) -> Scan:
    """Cut a mesh into collision pieces, or take those that `cache` holds.

    Without a mass an object weighs its mesh's volume times `collision.wall_density` (containers, whose mesh is their
    wall) or `collision.density` (the others, closed outer surfaces).

    Raises InputError, which names the file, where no pieces approximate the mesh well enough.
    """
    source, mesh = body.source, body.mesh
    pieces, check = kept_pieces(mesh, collision, str(source.file), cache)
    density = collision.wall_density if source.category == "containers" else collision.density
    mass = source.mass if source.mass is not None else density * float(mesh.volume)
    inertia = np.array(mesh.moment_inertia) * (mass / mesh.volume)
    return Scan(
        GraspObject(source.name, source.category, mesh, pieces, mass, np.array(mesh.center_mass), inertia), check
    )


def read_mesh(path: Path, unit: str, collision: CollisionConfig) -> trimesh.Trimesh:
    """The mesh in `path` in metres, duplicate vertices merged; closed, with its normals outwards, nothing mended.

    Raises InputError, which names the file, as `read_body` does, and for a mesh that is inside out.
    """
    vertices, faces = _read(path)
    mesh = _merged(_metres(path, vertices, faces, unit, collision), faces)
    _check_closed(path, mesh)
    return mesh


def fit(points: np.ndarray, width: float) -> float:
    """What EGAD's protocol scales a mesh with corners `points` (N, 3) by, for a gripper that opens `width` metres.

    The longest side of the least box around it becomes `width`; where the shortest would then exceed 80 % of `width`,
    it becomes that.
    """
    sides = trimesh.bounds.oriented_bounds(points)[1]
    return width * min(1.0 / sides.max(), GRIPPED / sides.min())


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """As `mesh_arrays`: at least one triangle, all vertices finite."""
    vertices, faces = mesh_arrays(path)
    if not len(faces):
        raise InputError(f"{path}: expected a mesh with faces, got {len(vertices)} vertices and no face")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(f"{path}: expected finite vertices, got {bad} of {len(vertices)} with NaN or infinity")
    return vertices, faces


def _merged(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    """One vertex a place, as formats repeat them at texture seams or for every face; no face with a corner twice."""
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.remove_unreferenced_vertices()
    return mesh


def _metres(path: Path, vertices: np.ndarray, faces: np.ndarray, unit: str, collision: CollisionConfig) -> np.ndarray:
    """The vertices in metres; an extent that says that the unit is wrong is refused."""
    extent = float(np.ptp(vertices[faces.ravel()], axis=0).max()) * METRES[unit]
    low, high = collision.min_extent, collision.max_extent
    if low <= extent <= high:
        return vertices * METRES[unit]
    fitting = [f"unit={other}" for other, metres in METRES.items() if low <= extent * metres / METRES[unit] <= high]
    hint = f"; {' or '.join(fitting)} would fit" if fitting else ""
    raise InputError(f"{path}: expected an extent of {low:g} to {high:g} m, got {extent:.4g} m with unit={unit}{hint}")


def _check_closed(path: Path, mesh: trimesh.Trimesh) -> None:
    single, several = open_edges(mesh)
    if single or several:
        raise InputError(
            f"{path}: expected a closed surface, two faces at every edge; got {single} open edges and "
            f"{several} edges with more than two faces"
        )
    if not mesh.is_winding_consistent:
        raise InputError(f"{path}: expected all faces to turn the same way round, got a mixture")
    volume = signed_volume(mesh)
    thickness = 2.0 * abs(volume) / float(mesh.area)
    if thickness < MIN_THICKNESS:
        raise InputError(f"{path}: expected a body, got a sheet {thickness * 1e3:.2g} mm thick on average")
    if volume < 0.0:
        raise InputError(
            f"{path}: expected normals pointing outwards, got an inverted mesh (volume {volume * 1e6:.4g} cm3)"
        )
