"""Which cell of a lattice over SE(3) each grasp lies in, seen from each feature: for the operators of pairs and votes.

All poses are float64: what falls into which cell is then as the rounding of the poses themselves has it. The compiled
loops let a feature meet all grasps at once, over arrays that the processor's vector units can take: grasps come as
columns. torch's operations list the pairs within reach first. Both do the same arithmetic in the same order.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.registration import memory

# Features x grasps that torch looks at together: bounds the memory.
TOGETHER = 1 << 21


class PairCells(NamedTuple):
    """Pairs within reach, by feature, then grasp: feature, grasp (P,) int64, and the lattice's cell (P,) int64."""

    feature: Tensor
    grasp: Tensor
    cell: Tensor


def pair_cells(T_object_feature: Tensor, T_object_grasp: Tensor, lattice: SE3Grid) -> Iterator[PairCells]:
    """The pairs of features (F, 4, 4) and grasps (G, 4, 4) by torch's operations, some features after the other."""
    T, grasps = T_object_feature.double(), T_object_grasp.double()
    quaternion, grasp_quaternion = se3.quaternion_of(T), se3.quaternion_of(grasps)
    step = max(1, TOGETHER // max(1, len(grasps)))
    for first in range(0, len(T), step):
        part = slice(first, first + step)
        x, y, z = (grasps[:, axis, 3] - T[part, axis, 3:] for axis in range(3))  # (n, G)
        feature, grasp = (x * x + y * y + z * z <= lattice.reach * lattice.reach).nonzero(as_tuple=True)
        x, y, z = (along[feature, grasp] for along in (x, y, z))
        feature = feature + first
        rotation = T[:, :3, :3].index_select(0, feature)
        position = [rotation[:, 0, i] * x + rotation[:, 1, i] * y + rotation[:, 2, i] * z for i in range(3)]
        turn = conjugate_product(quaternion[feature].unbind(1), grasp_quaternion[grasp].unbind(1))
        yield PairCells(feature, grasp, lattice.index(torch.stack(position, dim=1), torch.stack(turn, dim=1)))


def conjugate_product(a: tuple[Tensor, ...], b: tuple[Tensor, ...]) -> list[Tensor]:
    """conjugate(a) * b of quaternions given by their parts w, x, y, z."""
    return [
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3],
        a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
        a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1],
        a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0],
    ]


class Features(NamedTuple):
    """Features for compiled loops, f64: poses T (F, 4, 4), and their quaternions (F, 4) wxyz."""

    T: np.ndarray
    quaternion: np.ndarray

    @staticmethod
    def of(T: Tensor) -> Features:
        return Features(memory(T, torch.float64), memory(se3.quaternion_of(T.double())))

    def at(self, part: slice) -> Features:
        return Features(self.T[part], self.quaternion[part])


class Grasps(NamedTuple):
    """Grasps for compiled loops, f64, as columns: position (3, G) m, quaternion (4, G) wxyz."""

    position: np.ndarray
    quaternion: np.ndarray

    @staticmethod
    def of(T: Tensor) -> Grasps:
        T = T.double()
        return Grasps(memory(se3.position_of(T).T), memory(se3.quaternion_of(T).T))

    def at(self, part: slice) -> Grasps:
        return Grasps(*(np.ascontiguousarray(column[:, part]) for column in self))


class Grid(NamedTuple):
    """A lattice for compiled loops: reach and voxel in m, side and edges as `SE3Grid` has them."""

    reach: float
    voxel: float
    side: int
    edges: np.ndarray

    @staticmethod
    def of(lattice: SE3Grid) -> Grid:
        return Grid(lattice.reach, lattice.voxel, lattice.side, lattice.edges.numpy())


Scratch = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@compiled
def scratch_for(size: int) -> Scratch:
    """What `cells_from` works in: arrays of their own, since rows of one keep the compiler from vector instructions."""
    return np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.empty(size)


@lean
def cells_from(features: Features, i: int, grasps: Grasps, grid: Grid, scratch: Scratch, cell: np.ndarray) -> None:
    """Out: cell (G,) int32, `SE3Grid.index` of inverse(features[i]) @ each grasp; -1 beyond reach.

    scratch: (G,) f64 each.
    """
    first, second, third, rotation, place = scratch
    _place(features.T, i, grasps.position, grid, place)
    _turn(features.quaternion, i, grasps.quaternion, rotation, first, second, third)
    for ratio in (first, second, third):
        _add_digit(ratio, grid.edges, rotation)
    voxels = float(grid.side * grid.side * grid.side)
    for j in range(len(cell)):
        cell[j] = np.int32(rotation[j] * voxels + place[j]) if place[j] >= 0 else np.int32(-1)


@lean
def _place(T: np.ndarray, i: int, position: np.ndarray, grid: Grid, place: np.ndarray) -> None:
    """Out: place (G,) f64, `SE3Grid.voxel_index` of each position (3, G) in the frame of T[i]; -1 beyond reach."""
    r00, r01, r02, r10, r11, r12 = T[i, 0, 0], T[i, 0, 1], T[i, 0, 2], T[i, 1, 0], T[i, 1, 1], T[i, 1, 2]
    r20, r21, r22, tx, ty, tz = T[i, 2, 0], T[i, 2, 1], T[i, 2, 2], T[i, 0, 3], T[i, 1, 3], T[i, 2, 3]
    scale, half, last, reach, side = 1.0 / grid.voxel, grid.side / 2.0, grid.side - 2.0, grid.reach, grid.side
    for j in range(len(place)):
        x, y, z = position[0, j] - tx, position[1, j] - ty, position[2, j] - tz
        u = min(max(np.floor((r00 * x + r10 * y + r20 * z) * scale + half), 1.0), last)
        v = min(max(np.floor((r01 * x + r11 * y + r21 * z) * scale + half), 1.0), last)
        w = min(max(np.floor((r02 * x + r12 * y + r22 * z) * scale + half), 1.0), last)
        place[j] = (u * side + v) * side + w if x * x + y * y + z * z <= reach * reach else -1.0


@lean
def _turn(
    feature: np.ndarray,
    i: int,
    grasp: np.ndarray,
    chart: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    third: np.ndarray,
) -> None:
    """Out: chart (G,) of the rotation from feature[i] to each grasp (4, G), and the other three parts over its own.

    These are arrays of their own: in one they keep the compiler from vector instructions.
    """
    a0, a1, a2, a3 = feature[i, 0], feature[i, 1], feature[i, 2], feature[i, 3]
    for j in range(len(chart)):
        b0, b1, b2, b3 = grasp[0, j], grasp[1, j], grasp[2, j], grasp[3, j]
        q0 = a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3  # conjugate(a) * b
        q1 = a0 * b1 - a1 * b0 - a2 * b3 + a3 * b2
        q2 = a0 * b2 + a1 * b3 - a2 * b0 - a3 * b1
        q3 = a0 * b3 - a1 * b2 + a2 * b1 - a3 * b0
        largest = max(max(abs(q0), abs(q1)), max(abs(q2), abs(q3)))
        is0, is1, is2 = abs(q0) == largest, abs(q1) == largest, abs(q2) == largest
        chart[j] = 0.0 if is0 else (1.0 if is1 else (2.0 if is2 else 3.0))
        scale = 1.0 / (q0 if is0 else (q1 if is1 else (q2 if is2 else q3)))
        first[j] = (q1 if is0 else q0) * scale
        second[j] = (q2 if is0 or is1 else q1) * scale
        third[j] = (q3 if is0 or is1 or is2 else q2) * scale


@lean
def _add_digit(ratio: np.ndarray, edges: np.ndarray, rotation: np.ndarray) -> None:
    """In and out: rotation (G,) gets one more digit: how many edges are no greater than each ratio (G,)."""
    for j in range(len(ratio)):
        rotation[j] *= len(edges) + 1.0
    for edge in edges:
        for j in range(len(ratio)):
            rotation[j] += 1.0 if ratio[j] >= edge else 0.0
