"""Fingers as points and convex pieces: how far apart opposing groups are, and where they would meet.

Distances are from points of one side's surface, at most `SPACING` apart, to the other side's convex pieces: exact for
faces, within a fraction of the spacing at edges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
    """

    points: dict[str, np.ndarray]
    planes: tuple[tuple[str, np.ndarray], ...]

    def points_at(self, links: Mapping[str, np.ndarray]) -> np.ndarray:
        """(P, 3) in the base frame, of link poses (4, 4)."""
        return np.concatenate([p @ links[link][:3, :3].T + links[link][:3, 3] for link, p in self.points.items()])


def finger_shape(robot: Robot, name: str, links: Sequence[str]) -> FingerShape:
    """The shapes of these links, and of those that fixed joints join to them; InputError where there are none."""
    body_of = robot.bodies()
    bodies = {body_of[link] for link in links}
    points: dict[str, list[np.ndarray]] = {}
    planes = []
    for collision in robot.collisions:
        if body_of[collision.link] in bodies:
            mesh = collision.mesh.copy().apply_transform(collision.T_link_shape)
            points.setdefault(collision.link, []).append(surface_points(mesh))
            normals = np.asarray(mesh.face_normals)
            offsets = np.einsum("ij,ij->i", normals, mesh.triangles[:, 0])
            planes.append((collision.link, np.column_stack([normals, offsets])))
    if not planes:
        raise InputError(f"hand.fingers.{name}: expected links with collision shapes, got none on {', '.join(links)}")
    return FingerShape({link: np.concatenate(parts) for link, parts in points.items()}, tuple(planes))


def surface_points(mesh: trimesh.Trimesh) -> np.ndarray:
    """(P, 3) points that cover a mesh's surface at most about `SPACING` apart."""
    longest = float(mesh.edges_unique_length.max())
    if longest <= SPACING:
        return np.asarray(mesh.triangles_center)
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, SPACING, max_iter=20)
    centres = vertices[faces].mean(axis=1)
    _, first = np.unique(np.floor(centres / SPACING).astype(np.int64), axis=0, return_index=True)
    return np.asarray(centres[np.sort(first)])


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
    """m between the two groups that are nearest to each other; negative where they overlap."""
    least = np.inf
    for index, group in enumerate(groups):
        others = [shape for other, shapes in enumerate(groups) if other != index for shape in shapes]
        for shape in group:
            least = min(least, float(distances(shape.points_at(links), others, links).min()))
    return least


def closing_face(shape: FingerShape, others: Sequence[FingerShape], links: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3,) in the base frame: the middle of what of a finger is nearest to what it closes on."""
    points = shape.points_at(links)
    away = distances(points, others, links)
    face = points[away <= away.min() + SKIN]
    middle = (face.min(axis=0) + face.max(axis=0)) / 2
    if abs(float(distances(middle[None], [shape], links)[0])) < SKIN / 2:
        return np.asarray(middle)
    return np.asarray(face[np.linalg.norm(face - middle, axis=1).argmin()])
