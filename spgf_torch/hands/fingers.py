"""Fingers as points and convex pieces: how far apart opposing groups are, and where they would meet.

How far apart groups are is FCL's distance of their surfaces. Which of their points are near the other side is asked of
points at most `SPACING` apart: exact for faces, within a fraction of the spacing at edges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import fcl
import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.hands.robot import Robot

SPACING = 0.002  # m between points of a finger's surface: a tenth of a fingertip's width
SKIN = 0.001  # m from the nearest point within which a surface counts as the face that closes


@dataclass(frozen=True)
class FingerShape:
    """The surface of one finger, link by link.

    Attributes:
        points: link -> (P, 3) in its frame, m.
        planes: of each convex piece its link and (F, 4) unit outward normals and offsets in its frame.
        trees: link -> its pieces' triangles, for FCL.
    """

    points: dict[str, np.ndarray]
    planes: tuple[tuple[str, np.ndarray], ...]
    trees: dict[str, fcl.CollisionObject] = field(repr=False)

    def points_at(self, links: Mapping[str, np.ndarray]) -> np.ndarray:
        """(P, 3) in the base frame, of link poses (4, 4)."""
        return np.concatenate([p @ links[link][:3, :3].T + links[link][:3, 3] for link, p in self.points.items()])

    def trees_at(self, links: Mapping[str, np.ndarray]) -> list[fcl.CollisionObject]:
        """The trees where these link poses (4, 4) put them."""
        for link, tree in self.trees.items():
            T = links[link]
            tree.setTransform(fcl.Transform(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])))
        return list(self.trees.values())


def finger_shape(robot: Robot, name: str, links: Sequence[str]) -> FingerShape:
    """The shapes of these links, and of those that fixed joints join to them; InputError where there are none."""
    body_of = robot.bodies()
    bodies = {body_of[link] for link in links}
    points: dict[str, list[np.ndarray]] = {}
    meshes: dict[str, list[trimesh.Trimesh]] = {}
    planes = []
    for collision in robot.collisions:
        if body_of[collision.link] in bodies:
            mesh = collision.mesh.copy().apply_transform(collision.T_link_shape)
            points.setdefault(collision.link, []).append(surface_points(mesh))
            meshes.setdefault(collision.link, []).append(mesh)
            normals = np.asarray(mesh.face_normals)
            offsets = np.einsum("ij,ij->i", normals, mesh.triangles[:, 0])
            planes.append((collision.link, np.column_stack([normals, offsets])))
    if not planes:
        raise InputError(f"hand.fingers.{name}: expected links with collision shapes, got none on {', '.join(links)}")
    trees = {link: fcl.CollisionObject(triangle_tree(parts)) for link, parts in meshes.items()}
    return FingerShape({link: np.concatenate(parts) for link, parts in points.items()}, tuple(planes), trees)


def triangle_tree(meshes: Sequence[trimesh.Trimesh]) -> fcl.BVHModel:
    """All triangles of the meshes as one tree for FCL."""
    mesh: trimesh.Trimesh = trimesh.util.concatenate(list(meshes))  # type: ignore[assignment]
    tree = fcl.BVHModel()
    tree.beginModel(len(mesh.faces), len(mesh.vertices))
    tree.addSubModel(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int32))
    tree.endModel()
    return tree


def surface_points(mesh: trimesh.Trimesh) -> np.ndarray:
    """(P, 3) points that cover a mesh's surface at most about `SPACING` apart; not to be written to."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    return _surface_points(vertices.tobytes(), faces.tobytes())


@lru_cache(256)
def _surface_points(vertices: bytes, faces: bytes) -> np.ndarray:
    """The same of the bytes of vertices and faces: a hand's meshes are the same with each of its settings."""
    mesh = trimesh.Trimesh(
        np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, np.int64).reshape(-1, 3), process=False
    )
    if float(mesh.edges_unique_length.max()) <= SPACING:
        found = np.array(mesh.triangles_center)
    else:
        divided, corners = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, SPACING, max_iter=20)
        centres = divided[corners].mean(axis=1)
        _, first = np.unique(np.floor(centres / SPACING).astype(np.int64), axis=0, return_index=True)
        found = centres[np.sort(first)]
    found.setflags(write=False)
    return found


def distances(points: np.ndarray, shapes: Sequence[FingerShape], links: Mapping[str, np.ndarray]) -> np.ndarray:
    """(P,) m from points (P, 3) in the base frame to the nearest of the pieces; negative inside."""
    nearest = np.full(len(points), np.inf)
    for shape in shapes:
        for link, planes in shape.planes:
            T = links[link]
            local = (points - T[:3, 3]) @ T[:3, :3]
            nearest = np.minimum(nearest, (local @ planes[:, :3].T - planes[:, 3]).max(axis=1))
    return nearest


def separation(groups: Sequence[Sequence[FingerShape]], links: Mapping[str, np.ndarray]) -> float:
    """m between the two groups that are nearest to each other; 0 where their surfaces cut."""
    trees = [[tree for shape in group for tree in shape.trees_at(links)] for group in groups]
    pairs = [(a, b) for k, group in enumerate(trees) for other in trees[:k] for a in group for b in other]
    return min(max(fcl.distance(a, b, _DISTANCE, fcl.DistanceResult()), 0.0) for a, b in pairs)


_DISTANCE = fcl.DistanceRequest()


def closing_face(shape: FingerShape, others: Sequence[FingerShape], links: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3,) in the base frame: the middle of what of a finger is nearest to what it closes on."""
    points = shape.points_at(links)
    away = distances(points, others, links)
    face = points[away <= away.min() + SKIN]
    middle = (face.min(axis=0) + face.max(axis=0)) / 2
    on_surface = projected(middle, shape, links)
    if np.linalg.norm(on_surface - middle) < SKIN:
        return on_surface
    return np.asarray(face[np.linalg.norm(face - middle, axis=1).argmin()])


def projected(point: np.ndarray, shape: FingerShape, links: Mapping[str, np.ndarray]) -> np.ndarray:
    """The point (3,), moved onto the nearest face of the piece that it is deepest in, or nearest to."""
    best, moved = np.inf, point
    for link, planes in shape.planes:
        T = links[link]
        beyond = planes[:, :3] @ (T[:3, :3].T @ (point - T[:3, 3])) - planes[:, 3]
        face = int(beyond.argmax())
        if beyond[face] < best:
            best, moved = float(beyond[face]), point - beyond[face] * (T[:3, :3] @ planes[face, :3])
    return np.asarray(moved)
