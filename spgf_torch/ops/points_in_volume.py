"""Which hands hold a point: grasps and points, and the open hand as convex pieces -> one bool a grasp."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import lean
from spgf_torch.ops.registration import memory, operator
from spgf_torch.threads import in_parts

# Pairs of a grasp and a point that torch looks at together: bounds the memory.
TOGETHER = 1 << 20

# Grasps of one part of the work on a CPU.
GRASPS_TOGETHER = 128


@operator("points_in_volume(Tensor points, Tensor T_object_tcp, Tensor planes, SymInt[] end, Tensor bounds) -> Tensor")
def points_in_volume(points: Tensor, T_object_tcp: Tensor, planes: Tensor, end: list[int], bounds: Tensor) -> Tensor:
    """(G,) bool: a point (N, 3), m, lies within the volume, placed at each of T_object_tcp (G, 4, 4). In float64.

    Args:
        planes: (F, 4), p is on the inner side where planes[:, :3] @ p <= planes[:, 3], in the TCP's frame.
        end: the volume is the union of pieces; those of piece i end at end[i].
        bounds: (2, 3), lowest and highest corner of a box about all pieces, m.
    """
    points, T, planes, bounds = points.double(), T_object_tcp.double(), planes.double(), bounds.double()
    hit = torch.zeros(len(T), dtype=torch.bool, device=T.device)
    step = max(1, TOGETHER // max(1, len(points)))
    for start in range(0, len(T), step):
        part = T[start : start + step]
        a, b, c = (points[:, axis] - part[:, axis, 3:] for axis in range(3))  # (n, N)
        local = [part[:, 0, i, None] * a + part[:, 1, i, None] * b + part[:, 2, i, None] * c for i in range(3)]
        within = torch.ones_like(local[0], dtype=torch.bool)
        for i in range(3):
            within &= (local[i] >= bounds[0, i]) & (local[i] <= bounds[1, i])
        grasp, point = within.nonzero(as_tuple=True)
        x, y, z = (along[grasp, point] for along in local)
        hit[start + grasp[in_a_piece(x, y, z, planes, end)]] = True
    return hit


def in_a_piece(x: Tensor, y: Tensor, z: Tensor, planes: Tensor, end: list[int]) -> Tensor:
    """(n,) bool: points x, y, z (n,) f64 in the TCP's frame are within a piece, by torch's operations."""
    within = torch.zeros_like(x, dtype=torch.bool)
    for first, last in zip([0, *end], end, strict=False):
        nx, ny, nz, offset = planes[first:last].unsqueeze(2).unbind(1)
        within |= (nx * x + ny * y + nz * z <= offset).all(0)
    return within


@points_in_volume.on_cpu
def _in_loops(points: Tensor, T_object_tcp: Tensor, planes: Tensor, end: list[int], bounds: Tensor) -> Tensor:
    hit, T = np.zeros(len(T_object_tcp), np.bool_), memory(T_object_tcp, torch.float64)
    xyz, sides, box = (memory(tensor, torch.float64) for tensor in (points, planes, bounds))
    ends = np.array(end)

    def work(first: int) -> None:
        part = slice(first, first + GRASPS_TOGETHER)
        _hold(xyz, T[part], box, sides, ends, hit[part])

    list(in_parts(work, range(0, len(hit), GRASPS_TOGETHER)))
    return torch.from_numpy(hit)


@points_in_volume.fake
def _shapes(points: Tensor, T_object_tcp: Tensor, planes: Tensor, end: list[int], bounds: Tensor) -> Tensor:
    return T_object_tcp.new_empty(T_object_tcp.shape[0], dtype=torch.bool)


@lean
def _hold(
    points: np.ndarray, T: np.ndarray, bounds: np.ndarray, planes: np.ndarray, end: np.ndarray, hit: np.ndarray
) -> None:
    """Out: hit (G,), True where a point is within the volume at T (G, 4, 4); what it holds elsewhere stays."""
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
            if _within_a_piece(x, y, z, planes, end):
                hit[g] = True
                break


@lean
def _within_a_piece(x: float, y: float, z: float, planes: np.ndarray, end: np.ndarray) -> bool:
    first = 0
    for last in end:
        inside = True
        for f in range(first, last):
            if planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z > planes[f, 3]:
                inside = False
                break
        if inside:
            return True
        first = last
    return False
