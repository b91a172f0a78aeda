"""What can be wrong with a surface and has one right answer: doubled faces, pinholes, faces that turn the other way.

Everything else is left as it is, for `scans` to refuse: a wide hole may be an opening that is meant, and where three
faces meet at an edge nobody can say which side is inside.
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def mended(mesh: trimesh.Trimesh, max_hole: float) -> tuple[trimesh.Trimesh, list[str]]:
    """The mesh with the following put right, and words for each thing that was; a sound mesh as it is, and no words.

    Doubled faces: of those over the same corners one stays, none where they face each other. Holes whose rim has no
    extent above `max_hole` (m): a fan to the rim's middle. Faces of one body that turn both ways round. A surface
    whose volume is negative: inside out as a whole.
    """
    words = []
    single = _without_doubles(mesh)
    if len(single.faces) != len(mesh.faces):
        words.append(f"{len(mesh.faces) - len(single.faces)} doubled faces left out")
    closed, holes = _without_pinholes(single, max_hole)
    if holes:
        words.append(f"{holes} holes of up to {max_hole * 1e3:g} mm closed")
    if not _is_closed(closed):
        return closed, words
    flipped = 0
    if not closed.is_winding_consistent and closed.body_count == 1:
        before, closed = closed.faces.copy(), closed.copy()
        trimesh.repair.fix_winding(closed)
        flipped = int((_orientation(before) != _orientation(closed.faces)).sum())
    if closed.is_winding_consistent and signed_volume(closed) < 0.0:
        closed = trimesh.Trimesh(closed.vertices, closed.faces[:, ::-1], process=False)
        flipped = len(closed.faces) - flipped
    if flipped:
        words.append(f"{flipped} of {len(closed.faces)} faces turned outwards")
    return closed, words


def open_edges(mesh: trimesh.Trimesh) -> tuple[int, int]:
    """How many edges have one face, and how many have more than two; (0, 0) of a closed surface."""
    shared = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    return int((shared == 1).sum()), int((shared > 2).sum())


def signed_volume(mesh: trimesh.Trimesh) -> float:
    """m3, below 0 where the faces of a closed surface turn inwards; trimesh's own warns where it is 0."""
    a, b, c = np.moveaxis(mesh.triangles - mesh.bounds.mean(axis=0), 1, 0)
    return float((a * np.cross(b, c)).sum() / 6.0)


def _is_closed(mesh: trimesh.Trimesh) -> bool:
    return open_edges(mesh) == (0, 0)


def _orientation(faces: np.ndarray) -> np.ndarray:
    """(F,) +1 or -1: whether the corners' order is an even or an odd permutation of their indices."""
    a, b, c = np.asarray(faces).T
    return np.sign(b - a) * np.sign(c - b) * np.sign(c - a)


def _without_doubles(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    faces = np.asarray(mesh.faces)
    _, group = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
    if group.max() + 1 == len(faces):
        return mesh
    sign = _orientation(faces)
    net = np.sign(np.bincount(group, weights=sign))
    agrees = np.flatnonzero(sign == net[group])
    kept = np.sort(agrees[np.unique(group[agrees], return_index=True)[1]])
    if not len(kept):  # nothing but a sheet with two sides
        return mesh
    return trimesh.Trimesh(mesh.vertices, faces[kept], process=False)


def _without_pinholes(mesh: trimesh.Trimesh, max_hole: float) -> tuple[trimesh.Trimesh, int]:
    """The mesh with its small holes closed, and how many those were."""
    order = np.lexsort(mesh.edges_sorted.T)
    edges = mesh.edges_sorted[order]
    first = np.r_[True, (edges[1:] != edges[:-1]).any(axis=1)]
    single = first & np.r_[first[1:], True]
    rim = mesh.edges[order[single]]
    if not len(rim):
        return mesh, 0
    size = len(mesh.vertices)
    _, hole_of_vertex = connected_components(coo_array((np.ones(len(rim)), rim.T), shape=(size, size)), directed=False)
    vertices, faces, holes = [np.asarray(mesh.vertices)], [np.asarray(mesh.faces)], 0
    for hole in np.unique(hole_of_vertex[rim[:, 0]]):
        edge = rim[hole_of_vertex[rim[:, 0]] == hole]
        corners = mesh.vertices[np.unique(edge)]
        if np.ptp(corners, axis=0).max() > max_hole:
            continue
        middle = np.full(len(edge), size + holes)
        faces.append(np.column_stack([edge[:, 1], edge[:, 0], middle]))
        vertices.append(corners.mean(axis=0)[None])
        holes += 1
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False), holes
