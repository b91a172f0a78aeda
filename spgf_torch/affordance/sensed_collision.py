"""Which grasps would start in collision, as far as the sensed points tell.

A sensed point inside the open hand's volume is a sure sign; no such point proves nothing, since views leave holes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from torch import Tensor

from spgf_torch.geometry import se3

# Pairs of a grasp and a point looked at together: bounds the memory.
CHUNK = 1 << 18


@dataclass(frozen=True)
class HandVolume:
    """The open hand as a union of convex pieces in the TCP frame.

    Attributes:
        planes: of each piece (F, 4) f32; p is inside where planes[:, :3] @ p <= planes[:, 3] for all of them.
        low (3,), high (3,) f32: bounding box of all pieces, m.
    """

    planes: tuple[Tensor, ...]
    low: Tensor
    high: Tensor


def hand_volume(shapes: Sequence[trimesh.Trimesh]) -> HandVolume:
    """The volume of convex meshes in the TCP frame, m."""
    planes = []
    for mesh in shapes:
        offset = (mesh.face_normals * mesh.triangles[:, 0]).sum(axis=1, keepdims=True)
        planes.append(np.unique(np.round(np.hstack([mesh.face_normals, offset]), 9), axis=0))
    bounds = np.stack([mesh.bounds for mesh in shapes])
    return HandVolume(
        tuple(torch.from_numpy(p).float() for p in planes),
        torch.from_numpy(bounds[:, 0].min(axis=0)).float(),
        torch.from_numpy(bounds[:, 1].max(axis=0)).float(),
    )


def sensed_collision(points: Tensor, T_object_tcp: Tensor, volume: HandVolume) -> Tensor:
    """Whether any of the points (N, 3) lies inside the open hand at each of the grasps (G, 4, 4) -> (G,) bool."""
    hit = torch.zeros(len(T_object_tcp), dtype=torch.bool, device=points.device)
    low, high = (bound.tolist() for bound in (volume.low, volume.high))
    T_tcp_object = se3.inverse(T_object_tcp)
    step = max(1, CHUNK // max(1, len(points)))
    for start in range(0, len(T_object_tcp), step):
        T = T_tcp_object[start : start + step]
        local = (T[:, :3, :3].reshape(-1, 3) @ points.T).view(len(T), 3, len(points)) + T[:, :3, 3:]  # (C, 3, N)
        inside = (local[:, 0] >= low[0]) & (local[:, 0] <= high[0])  # axis by axis: `all` over three is slow
        for axis in (1, 2):
            inside &= (local[:, axis] >= low[axis]) & (local[:, axis] <= high[axis])
        grasp, point = inside.nonzero(as_tuple=True)
        near = torch.stack([local[:, axis][grasp, point] for axis in range(3)])  # (3, P)
        grasp = grasp + start
        for planes in volume.planes:
            plane = planes.to(points.device)
            outside = torch.addmm(plane[:, 3:], plane[:, :3], near, beta=-1).amax(0)  # m beyond the piece, if > 0
            hit[grasp[outside <= 0]] = True
    return hit
