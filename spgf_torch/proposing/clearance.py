"""What the open hand would touch: sensed points, and a table; and whether there is anything to close on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from torch import Tensor

from spgf_torch.affordance.sensed_collision import HandVolume, sensed_collision
from spgf_torch.config import GRASP_TYPES, InputError
from spgf_torch.geometry import se3


@dataclass(frozen=True)
class Plane:
    """A table: nothing of the hand may be where normal @ p < offset.

    Attributes:
        normal (3,) f32: unit, to the free side, in the frame of the texlets.
        offset: m.
    """

    normal: Tensor
    offset: float

    @staticmethod
    def of(normal: Tensor | tuple[float, float, float], offset: float) -> Plane:
        """Raises InputError for a normal that is not a unit vector."""
        vector = torch.as_tensor(normal, dtype=torch.float32)
        if vector.shape != (3,) or not abs(float(vector.norm()) - 1) < 1e-3:
            raise InputError(f"plane: expected a unit normal of three numbers, got {vector.tolist()}")
        return Plane(vector, float(offset))


@dataclass(frozen=True)
class Clearance:
    """The open hand of each grasp type, how far it stays from a table, and where it looks for something to close on.

    Attributes:
        volumes: grasp type -> volume of the open hand in the TCP frame.
        plane_clearance: m.
        between: m about the TCP, across closing and approach, as far as a point counts as between the pads.
    """

    volumes: Mapping[str, HandVolume]
    plane_clearance: float
    between: float

    @cached_property
    def corners(self) -> dict[str, Tensor]:
        """Grasp type -> corners (C, 3) f32 of the open hand's convex hull, in the TCP frame."""
        return {kind: hull_corners(volume) for kind, volume in self.volumes.items()}

    @cached_property
    def gaps(self) -> dict[str, HandVolume]:
        """Grasp type -> the space between the pads, as a box in the TCP frame."""
        return {kind: _box(half_opening(volume), self.between) for kind, volume in self.volumes.items()}

    def closes_on_points(self, points: Tensor, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """(G,) bool: a point (N, 3) lies between the pads at the grasps (G, 4, 4) of types (G,).

        Without any points nothing is known of what there is, and all may.
        """
        closes = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
        if not len(points):
            return closes
        for code, kind in enumerate(GRASP_TYPES):
            of_type = grasp_type == code
            closes[of_type] = sensed_collision(points.float(), T_object_tcp[of_type].float(), self.gaps[kind])
        return closes

    def free_of_points(self, points: Tensor, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """(G,) bool: no point (N, 3) lies inside the open hand at the grasps (G, 4, 4) of types (G,)."""
        free = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
        for code, kind in enumerate(GRASP_TYPES):
            of_type = grasp_type == code
            free[of_type] = ~sensed_collision(points.float(), T_object_tcp[of_type].float(), self.volumes[kind])
        return free

    def free_of_plane(self, plane: Plane, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """(G,) bool: the whole open hand at the grasps (G, 4, 4) of types (G,) is above the plane, with clearance."""
        free = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
        for code, kind in enumerate(GRASP_TYPES):
            of_type = grasp_type == code
            normal = plane.normal.to(T_object_tcp)
            corners = self.corners[kind].to(T_object_tcp)
            lowest = (normal @ se3.rotation_of(T_object_tcp[of_type]) @ corners.T).amin(1)  # below the TCP, m
            height = se3.position_of(T_object_tcp[of_type]) @ normal - plane.offset
            free[of_type] = height + lowest >= self.plane_clearance
        return free


def half_opening(volume: HandVolume) -> float:
    """m from the TCP to the nearest piece of the open hand along the closing axis."""
    reached = []
    for planes in volume.planes:
        slope, offset = planes[:, 0].double(), planes[:, 3].double()
        if bool((offset[slope == 0] < 0).any()):
            continue  # the axis passes beside this piece
        enters = (offset / slope)[slope < 0].amax()
        leaves = (offset / slope)[slope > 0].amin()
        if enters <= leaves:
            reached.append(min(abs(float(enters)), abs(float(leaves))))
    if not reached:
        raise InputError("hand: expected pads on the closing axis through the TCP, got none")
    return min(reached)


def _box(x: float, yz: float) -> HandVolume:
    half = torch.tensor([x, yz, yz])
    planes = torch.cat([torch.eye(3), -torch.eye(3)])
    return HandVolume((torch.cat([planes, half.repeat(2)[:, None]], dim=1),), -half, half)


def hull_corners(volume: HandVolume) -> Tensor:
    """Corners (C, 3) f32 of the convex hull of all pieces of a hand, in the TCP frame."""
    corners = np.concatenate([_corners(planes.double().cpu().numpy()) for planes in volume.planes])
    return torch.from_numpy(corners[ConvexHull(corners).vertices]).float()


def _corners(planes: np.ndarray) -> np.ndarray:
    """Corners (C, 3) of the polytope planes[:, :3] @ p <= planes[:, 3], unit normals."""
    # The point farthest inside (Chebyshev centre): maximise r with normal @ p + r <= offset for every plane.
    rows = np.hstack([planes[:, :3], np.ones((len(planes), 1))])
    inside = linprog([0, 0, 0, -1], A_ub=rows, b_ub=planes[:, 3], bounds=[(None, None)] * 4).x[:3]
    return HalfspaceIntersection(np.hstack([planes[:, :3], -planes[:, 3:]]), inside).intersections
