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

from spgf_torch.compiled import compiled
from spgf_torch.geometry import se3
from spgf_torch.threads import in_parts

# Pairs of a grasp and a point looked at together on an accelerator: bounds the memory.
CHUNK = 1 << 24

# Grasps of one part of the work on a CPU.
GRASPS_TOGETHER = 128


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
    if points.device.type != "cpu":
        return collision_at_once(points, T_object_tcp, volume)
    hit, T = np.zeros(len(T_object_tcp), np.bool_), T_object_tcp.double().contiguous().numpy()
    inside = points.double().contiguous().numpy()
    bounds = torch.stack([volume.low, volume.high]).double().cpu().numpy()
    planes = torch.cat(volume.planes).double().cpu().numpy()
    end = np.cumsum([len(piece) for piece in volume.planes])

    def work(first: int) -> None:
        part = slice(first, first + GRASPS_TOGETHER)
        touched(inside, T[part], bounds, planes, end, hit[part])

    list(in_parts(work, range(0, len(hit), GRASPS_TOGETHER)))
    return torch.from_numpy(hit)


@compiled
def touched(
    points: np.ndarray, T: np.ndarray, bounds: np.ndarray, planes: np.ndarray, end: np.ndarray, hit: np.ndarray
) -> None:
    """Set hit (G,) where a point (N, 3) is within bounds (2, 3) and all planes of a piece, which end at `end`."""
    for g in range(len(T)):
        r00, r01, r02, r10, r11, r12 = T[g, 0, 0], T[g, 0, 1], T[g, 0, 2], T[g, 1, 0], T[g, 1, 1], T[g, 1, 2]
        r20, r21, r22, tx, ty, tz = T[g, 2, 0], T[g, 2, 1], T[g, 2, 2], T[g, 0, 3], T[g, 1, 3], T[g, 2, 3]
        for i in range(len(points)):
            a, b, c = points[i, 0] - tx, points[i, 1] - ty, points[i, 2] - tz
            x, y, z = r00 * a + r10 * b + r20 * c, r01 * a + r11 * b + r21 * c, r02 * a + r12 * b + r22 * c
            if x < bounds[0, 0] or x > bounds[1, 0] or y < bounds[0, 1] or y > bounds[1, 1]:
                continue
            if z < bounds[0, 2] or z > bounds[1, 2]:
                continue
            first, inside = 0, False
            for last in end:
                inside = True
                for f in range(first, last):
                    if planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z > planes[f, 3]:
                        inside = False
                        break
                if inside:
                    break
                first = last
            if inside:
                hit[g] = True
                break


def collision_at_once(points: Tensor, T_object_tcp: Tensor, volume: HandVolume) -> Tensor:
    """The same by torch's operations: an accelerator's way."""
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
