"""Does the open hand already touch the object? (FCL.) Without this PhysX would push the object out of the hand."""

from __future__ import annotations

import fcl
import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from spgf_torch.hands.preshape import Preshape
from spgf_torch.objects.grasp_object import GraspObject


class PreCheck:
    """Surface-surface test of one open hand against one object, both as triangle trees.

    Surfaces suffice: the hand is too large to lie inside a part, and a part too large to lie inside one of its links.
    """

    def __init__(self, obj: GraspObject, preshape: Preshape) -> None:
        self._object = fcl.CollisionObject(tree([_hull(part) for part in obj.parts]))
        self._hand = fcl.CollisionObject(tree(list(preshape.shapes)))
        self._request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)

    def collides(self, T_object_tcp: np.ndarray) -> bool:
        """Whether the open hand at T_object_tcp (4, 4) cuts the object."""
        T = np.asarray(T_object_tcp, dtype=np.float64)
        self._hand.setTransform(fcl.Transform(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])))
        return fcl.collide(self._hand, self._object, self._request, fcl.CollisionResult()) > 0


def _hull(points: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(points, ConvexHull(points).simplices, process=False)


def tree(meshes: list[trimesh.Trimesh]) -> fcl.BVHModel:
    """The triangles of all meshes, as FCL searches them."""
    mesh: trimesh.Trimesh = trimesh.util.concatenate(meshes)  # type: ignore[assignment]
    model = fcl.BVHModel()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addSubModel(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int32))
    model.endModel()
    return model


def trees_touch(first: fcl.BVHModel | None, second: fcl.BVHModel | None) -> bool:
    """Whether two surfaces cut each other; nothing touches None."""
    if first is None or second is None:
        return False
    pair = fcl.CollisionObject(first), fcl.CollisionObject(second)
    return fcl.collide(*pair, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
