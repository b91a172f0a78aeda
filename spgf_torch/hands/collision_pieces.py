"""Collision shapes of links as convex pieces: those that a URDF describes, and meshes, cut where not convex."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from spgf_torch.errors import InputError
from spgf_torch.extras import needed
from spgf_torch.files.mesh_files import mesh_arrays
from spgf_torch.files.reading import unreadable, xml_root
from spgf_torch.geometry.convex_pieces import MAX_HULL_VERTICES, FewPieces, convex_hull, few_convex_pieces, open_share
from spgf_torch.hands.robot import Collision
from spgf_torch.hands.urdf_files import mesh_file
from spgf_torch.hands.urdf_numbers import XML, number, numbers, pose

FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf", ".dae", ".off")
LARGEST = 2.0  # m; a larger shape of a hand is taken for millimetres without a scale
SAMPLES = 20_000  # points that stand for a surface: 1 mm apart on a finger
CUTTING = FewPieces(
    tolerance=0.001,  # as the depth below which a surface counts as convex
    inset=0.0,  # pads stay where they are
    thickness=0.005,  # ten times what PhysX lets a finger sink into an object
    max_edge=0.01,  # half the width of a finger
    coarsest=0.0051,  # the fourth step from 1 mm: more would fill the notch of a fingertip
    slack=0.0002,  # pads stay flat
    openness=0.25,  # the bottom of a slot as deep as it is wide sees 0.45, that of a screw hole less than 0.1
    most=32,  # of one mesh; PhysX's time grows with them
)


def link_collisions(path: Path, link: XML, packages: dict[str, str]) -> list[Collision]:
    """The convex pieces of all `<collision>` elements of a link, in their order.

    Raises InputError, which names the link, for a shape that is missing, unreadable or has no volume.
    """
    name, found = link.get("name", ""), []
    for element in link.findall("collision"):
        where = f"link {name}: collision"
        T = pose(path, f"{where}: origin", element.find("origin"))
        shape = element.find("geometry/*")
        if shape is None:
            raise InputError(f"{path}: {where}: expected a geometry, got none")
        if shape.tag == "mesh":
            meshes, cut = _mesh_pieces(path, where, shape, packages), True
        else:
            meshes, cut = (_primitive(path, where, shape),), False
        found += [Collision(name, cut, mesh, T) for mesh in meshes]
    return found


def _primitive(path: Path, where: str, shape: XML) -> trimesh.Trimesh:
    def size(key: str, count: int = 1) -> np.ndarray:
        values = numbers(path, f"{where}: {shape.tag} {key}", shape.get(key), count)
        if not (values > 0.0).all():
            raise InputError(f"{path}: {where}: expected a {shape.tag} of some {key}, got {shape.get(key)}")
        if (values > LARGEST).any():
            got = f"{shape.get(key)}; a URDF is in metres"
            raise InputError(f"{path}: {where}: expected a {shape.tag} of at most {LARGEST:g} m, got {key} {got}")
        return values

    if shape.tag == "box":
        return trimesh.creation.box(size("size", 3))
    if shape.tag == "cylinder":
        return trimesh.creation.cylinder(float(size("radius")[0]), float(size("length")[0]))
    if shape.tag == "sphere":
        return trimesh.creation.icosphere(radius=float(size("radius")[0]))
    if shape.tag == "capsule":
        return trimesh.creation.capsule(float(size("length")[0]), float(size("radius")[0]))
    raise InputError(f"{path}: {where}: expected a box, cylinder, sphere, capsule or mesh; got {shape.tag}")


def _mesh_pieces(path: Path, where: str, shape: XML, packages: dict[str, str]) -> tuple[trimesh.Trimesh, ...]:
    name = shape.get("filename", "")
    if not name:
        raise InputError(f"{path}: {where}: expected the filename of a mesh, got none")
    scale = numbers(path, f"{where}: scale", shape.get("scale", "1 1 1"), 3)
    if not scale.all():
        raise InputError(f"{path}: {where}: expected a scale other than 0, got {shape.get('scale')}")
    file = mesh_file(name, path, packages)
    vertices, faces = _arrays(file)
    vertices, faces = vertices * scale, faces[:, ::-1] if scale.prod() < 0.0 else faces
    used = vertices[faces.ravel()]
    if not len(faces):
        raise InputError(f"{file}: expected a mesh with faces, got none")
    if not np.isfinite(used).all():
        raise InputError(f"{file}: expected finite vertices, got NaN or infinity")
    if (extent := float(np.ptp(used, axis=0).max())) > LARGEST:
        hint = '; scale="0.001 0.001 0.001" if it is in millimetres'
        raise InputError(f"{path}: {where}: expected a mesh of at most {LARGEST:g} m, {file} has {extent:.3g} m{hint}")
    try:
        return pieces_of(vertices.tobytes(), faces.tobytes())
    except (ValueError, QhullError) as error:  # flat
        raise unreadable(file, "a mesh with a convex hull", error) from None


def _arrays(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in m, as far as the file says its unit, and faces."""
    kind = file.suffix.lower()
    if kind not in FORMATS:
        raise InputError(f"{file}: expected a mesh of {', '.join(FORMATS)}; got {kind or 'no ending'}")
    if kind != ".dae":
        return mesh_arrays(file)
    needed(f"{file}: a COLLADA mesh", "collada")
    root = xml_root(file.read_bytes(), file, "a COLLADA mesh")
    unit = root.find("{*}asset/{*}unit")
    metres = number(file, "unit", unit.get("meter", "1")) if unit is not None else 1.0
    vertices, faces = mesh_arrays(file)
    return vertices * metres, faces


@lru_cache(maxsize=256)
def pieces_of(vertices: bytes, faces: bytes) -> tuple[trimesh.Trimesh, ...]:
    """Convex pieces of a mesh of float64 vertices and int64 faces, each closed, of at most MAX_HULL_VERTICES corners.

    One, its hull, where no point of the surface that anything could reach lies deeper below it than the tolerance;
    else those of `geometry.few_convex_pieces`.
    """
    mesh = _merged(np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, dtype=np.int64).reshape(-1, 3))
    hull = _hull(mesh.vertices)
    if hull is not None and _depth(mesh, hull) <= CUTTING.tolerance:
        return (hull,)
    pieces = few_convex_pieces(mesh, CUTTING)
    return tuple(trimesh.Trimesh(piece).convex_hull for piece in pieces)


def _merged(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    """One vertex a place; each part of a surface that is not closed, or inside out, turned to its more open side."""
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    mesh.remove_unreferenced_vertices()
    if mesh.is_volume:  # closed, turning the same way round, outwards
        return mesh
    trimesh.repair.fix_winding(mesh)
    sides = [open_share(mesh, mesh.triangles_center, sign * mesh.face_normals) for sign in (1, -1)]
    behind = (sides[1] - sides[0]) * mesh.area_faces
    turned = mesh.faces.copy()
    for part in trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(turned))):
        if behind[part].sum() > 0.0:
            turned[part] = turned[part][:, ::-1]
    return trimesh.Trimesh(mesh.vertices, turned, process=False)


def _depth(mesh: trimesh.Trimesh, hull: trimesh.Trimesh) -> float:
    """How deep the surface lies below its convex hull, m, where anything gets there."""
    points, face = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
    points = points[open_share(mesh, points, mesh.face_normals[face]) >= CUTTING.openness]
    above = [(points - corner) @ normal for corner, normal in zip(hull.triangles[:, 0], hull.face_normals, strict=True)]
    return float(-np.max(above, axis=0).min(initial=0.0))


def _hull(points: np.ndarray) -> trimesh.Trimesh | None:
    """The hull of `points`, of as few corners as PhysX takes: those that stand out least are left out.

    None where corners would be left out that stand out by more than the tolerance.
    """
    corners, slack = points[ConvexHull(points).vertices], 1e-5
    while len(corners) > MAX_HULL_VERTICES and slack <= CUTTING.tolerance:
        corners = points[convex_hull(points, slack).vertices]
        slack *= 1.5
    return trimesh.Trimesh(corners).convex_hull if len(corners) <= MAX_HULL_VERTICES else None
