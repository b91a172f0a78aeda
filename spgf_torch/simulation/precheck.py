"""Does the open hand already touch the object, or meet it or a table on its way there? (FCL.)

Without this PhysX would push the object out of the hand.
"""

from __future__ import annotations

import fcl
import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.hands.preshape import Preshape
from spgf_torch.objects.grasp_object import GraspObject


class PreCheck:
    """Surface-surface test of one open hand against one object, both as triangle trees.

    Surfaces suffice: the hand is too large to lie inside a part, and a part too large to lie inside one of its links.
    """

    def __init__(self, obj: GraspObject, preshape: Preshape) -> None:
        self._object = fcl.CollisionObject(triangle_tree([hull(part) for part in obj.parts]))
        self._hand = fcl.CollisionObject(triangle_tree(preshape.shapes))
        self._request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)

    def collides(self, T_object_tcp: np.ndarray) -> bool:
        """Whether the open hand at T_object_tcp (4, 4) cuts the object."""
        return self.cuts(self._hand, T_object_tcp)

    def cuts(self, shapes: fcl.CollisionObject, T_object_tcp: np.ndarray) -> bool:
        """Whether such shapes in the TCP's frame cut the object."""
        T = np.asarray(T_object_tcp, dtype=np.float64)
        shapes.setTransform(fcl.Transform(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])))
        return fcl.collide(shapes, self._object, self._request, fcl.CollisionResult()) > 0


class ApproachCheck:
    """What a hand that comes straight along its approach meets, by geometry alone."""

    def __init__(self, obj: GraspObject, preshape: Preshape, way: float) -> None:
        """`way`: m that the hand comes; all that it sweeps counts."""
        self.there, self._way = PreCheck(obj, preshape), way
        self._swept = fcl.CollisionObject(triangle_tree([_swept(shape, way) for shape in preshape.shapes]))
        self._points = np.concatenate([np.asarray(shape.vertices) for shape in preshape.shapes])

    def met(self, T_object_tcp: np.ndarray, up: np.ndarray, height: float | None) -> str | None:
        """One of `label.CAUSES`, or None; the table is all below `height` (m) along `up` (3,), None: there is none."""
        if height is not None and self._lowest(T_object_tcp, up) < height:
            return "object" if self.there.collides(T_object_tcp) else "table"
        if not self.there.cuts(self._swept, T_object_tcp):
            return None
        return "object" if self.there.collides(T_object_tcp) else "way"

    def _lowest(self, T_object_tcp: np.ndarray, up: np.ndarray) -> float:
        """m along `up`, of the hand anywhere on its way."""
        along = up @ T_object_tcp[:3, :3]
        there = float((self._points @ along).min() + up @ T_object_tcp[:3, 3])
        return min(there, there - self._way * float(along[2]))


def _swept(shape: trimesh.Trimesh, way: float) -> trimesh.Trimesh:
    """All that a convex shape in the TCP's frame passes on the last `way` m of its approach: convex, too."""
    points = np.asarray(shape.vertices)
    return hull(np.concatenate([points, points - [0.0, 0.0, way]]))


def hull(points: np.ndarray) -> trimesh.Trimesh:
    """The convex hull of points (V, 3), all of which stay vertices."""
    return trimesh.Trimesh(points, ConvexHull(points).simplices, process=False)


def trees_touch(first: fcl.BVHModel | None, second: fcl.BVHModel | None) -> bool:
    """Whether two surfaces cut each other; nothing touches None."""
    if first is None or second is None:
        return False
    pair = fcl.CollisionObject(first), fcl.CollisionObject(second)
    return fcl.collide(*pair, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
