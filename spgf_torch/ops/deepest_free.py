"""The search along the approach: hands pushed forward until they touch something -> where they are free.

What is far from a hand is passed over by its place in the hand's frame, with room for rounding; exact decisions are
those of `points_in_volume`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.points_in_volume import in_a_piece
from spgf_torch.ops.registration import memory, operator

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ids = NDArray[np.int64]
# Of a volume (`Volume`) the arrays.
Pieces = tuple[Doubles, Doubles, Ids, Bools]
# Points as columns (3, N), and what may not touch them.
Things = tuple[Floats, Pieces]
# Texlets, obstacles, and hidden places.
Kinds = tuple[Things, Things, Things]
# Those of the points that a volume may touch near one pose: coordinates (3, N) in its frame, in cells; indices (N,);
# and (2,) how many, -1 before they are looked for, and which of them was touched last.
Near = tuple[Floats, Ids, Ids]

# m; by so much a point's f32 coordinates in a hand's frame may be off.
ROOM = 1e-4
# m; side of the cells.
CELL = 0.004
SCALE = np.float32(1 / CELL)

# Pairs of a frame and a point that torch looks at together: bounds the memory.
TOGETHER = 1 << 19


class Volume(NamedTuple):
    """Convex pieces.

    Attributes:
        bounds: (2, 3) f64, lowest and highest corner of a box about all, m. planes: (F, 4) f64, as in
            `points_in_volume`. end: (pieces,) int64, where each piece's planes end.
        cells: (X, Y, Z) bool, those of side `CELL` from `ROOM` below the box that they may reach into, by as much
            again; the outermost are empty.
    """

    bounds: Tensor
    planes: Tensor
    end: Tensor
    cells: Tensor


@operator(
    "deepest_free(Tensor T, Tensor where, Tensor possible, int back, Tensor[] points, Tensor[] volumes) -> Tensor"
)
def deepest_free(
    T: Tensor, where: Tensor, possible: Tensor, back: int, points: list[Tensor], volumes: list[Tensor]
) -> Tensor:
    """(F, D, P) bool: the first place along D that is possible and touches nothing, and the one `back` after it.

    Hands have the rotations of T (F, 4, 4) and stand at where (F, D, P, 3), m; the latter place too is only marked
    where it is possible and touches nothing.

    Args:
        points: of three kinds (texlets, obstacles, hidden places) those (N, 3) f32 that a hand may not touch.
        volumes: the hand's `Volume` for each kind, one after the other.
    """
    kept = torch.zeros_like(possible)
    step = max(1, TOGETHER // max(1, *map(len, points)))
    for start in range(0, len(T), step):
        part = slice(start, start + step)
        near = [_Nearby.of(T[part], each, Volume(*volumes[4 * i : 4 * i + 4])) for i, each in enumerate(points)]
        kept[part] = _along(where[part], possible[part], back, near)
    return kept


def _along(where: Tensor, possible: Tensor, back: int, near: list[_Nearby]) -> Tensor:
    """Some frames of `deepest_free`, all of them place by place."""
    kept = torch.zeros_like(possible)
    deepest = torch.full_like(possible[:, 0], -1, dtype=torch.int64)  # (F, P)
    touched = [torch.zeros_like(deepest) for _ in near]  # by the place before: it often still is
    for k in range(possible.shape[1]):
        behind = (deepest >= 0) & (deepest == k - back)
        f, p = (possible[:, k] & ((deepest < 0) | behind)).nonzero(as_tuple=True)
        free = torch.ones_like(f, dtype=torch.bool)
        for things, last in zip(near, touched, strict=True):
            left = free.nonzero()[:, 0]
            hand, place = f[left], p[left]
            last[hand, place], free[left] = things.touched(hand, where[hand, k, place], last[hand, place])
        kept[f, k, p] = free
        deepest[kept[:, k] & (deepest < 0)] = k
    return kept


class _Nearby(NamedTuple):
    """Points about the hands of some frames T (F, 4, 4): in their axes at (F, 3, N), in cells, and as they are."""

    T: Tensor
    at: Tensor
    points: Tensor
    volume: Volume

    @staticmethod
    def of(T: Tensor, points: Tensor, volume: Volume) -> _Nearby:
        a, b, c = (points[:, axis] - T[:, axis, 3:] for axis in range(3))
        at = [T[:, 0, i, None] * a + T[:, 1, i, None] * b + T[:, 2, i, None] * c for i in range(3)]
        return _Nearby(T, torch.stack(at, dim=1) / CELL, points, volume)

    def touched(self, frame: Tensor, place: Tensor, first: Tensor) -> tuple[Tensor, Tensor]:
        """A point (G,) that hands of a frame (G,) at places (G, 3) touch, and that they do not: `first` is tried first.

        That of a hand that touches none says nothing.
        """
        if not len(self.points):
            return first, torch.ones_like(first, dtype=torch.bool)
        free, found = ~self._inside(frame, place, first), first.clone()
        left = free.nonzero()[:, 0]
        hand, point = self._maybe(frame[left], place[left]).nonzero(as_tuple=True)
        sure = self._inside(frame[left[hand]], place[left[hand]], point)
        free[left[hand[sure]]], found[left[hand[sure]]] = False, point[sure]
        return found, free

    def _maybe(self, frame: Tensor, place: Tensor) -> Tensor:
        """(G, N) bool: the cell that a point lies in is not empty."""
        T, cells = self.T[frame], self.volume.cells
        offset = ((place - T[:, :3, 3]).unsqueeze(1) @ T[:, :3, :3])[:, 0]
        corner = ((self.volume.bounds[0] + offset - ROOM) / CELL - 1).float()
        index = torch.zeros_like(self.at[frame, 0], dtype=torch.int32)
        for axis, size in enumerate(cells.shape):
            along = self.at[frame, axis] - corner[:, axis, None]
            index = index * size + along.clamp(0, size - 1).int()
        return cells.flatten()[index]

    def _inside(self, frame: Tensor, place: Tensor, point: Tensor) -> Tensor:
        """(G,) bool: a point of each hand is within its volume."""
        T, away = self.T[frame, :3, :3].double(), self.points[point].double() - place.double()
        local = [T[:, 0, i] * away[:, 0] + T[:, 1, i] * away[:, 1] + T[:, 2, i] * away[:, 2] for i in range(3)]
        low, high = self.volume.bounds
        within = torch.ones_like(point, dtype=torch.bool)
        for i in range(3):
            within &= (local[i] >= low[i]) & (local[i] <= high[i])
        near = within.nonzero()[:, 0]
        x, y, z = (along[near] for along in local)
        within[near] = in_a_piece(x, y, z, self.volume.planes, self.volume.end.tolist())
        return within


@deepest_free.on_cpu
def _in_loops(
    T: Tensor, where: Tensor, possible: Tensor, back: int, points: list[Tensor], volumes: list[Tensor]
) -> Tensor:
    kept = torch.zeros_like(possible)
    sensed, others, hidden = (_arrays(each, Volume(*volumes[4 * i : 4 * i + 4])) for i, each in enumerate(points))
    push(memory(T), memory(where), memory(possible), back, (sensed, others, hidden), kept.numpy())
    return kept


def _arrays(points: Tensor, volume: Volume) -> Things:
    bounds, planes, end, cells = map(memory, volume)
    return memory(points.T), (bounds, planes, end, cells)


@deepest_free.fake
def _shapes(
    T: Tensor, where: Tensor, possible: Tensor, back: int, points: list[Tensor], volumes: list[Tensor]
) -> Tensor:
    return torch.empty_like(possible)


@compiled
def push(T: Floats, where: Floats, possible: Bools, back: int, things: Kinds, kept: Bools) -> None:
    """Out: kept (F, D, P), from False."""
    D, P = possible.shape[1:]
    offset, box = np.empty((D, P, 3)), np.empty((2, 3))
    near = (_room_for(things[0]), _room_for(things[1]), _room_for(things[2]))
    for f in range(len(T)):
        if not _offsets_of(T[f], where[f], possible[f], offset, box):
            continue
        for t in range(3):
            near[t][2][0], near[t][2][1] = -1, 0  # to a slice it would take seconds to compile
        for p in range(P):
            k, found = 0, False
            while k < D:  # asked at one place in the code: each call is inlined, and takes seconds to compile
                free = possible[f, k, p] and _free_at(T[f], where[f, k, p], offset[k, p], box, things, near)
                kept[f, k, p] = free
                if found:
                    break
                found = free
                k += back if free else 1


@compiled
def _room_for(things: Things) -> Near:
    """Arrays for as many as there are."""
    count = things[0].shape[1]
    return np.empty((3, count), np.float32), np.empty(count, np.int64), np.empty(2, np.int64)


@compiled
def _offsets_of(pose: Floats, where: Floats, possible: Bools, offset: Doubles, box: Doubles) -> bool:
    """Places (D, P, 3) in the axes of a pose (4, 4), and the box (2, 3) of those that are possible; none: False."""
    box[0], box[1] = np.inf, -np.inf
    for k in range(possible.shape[0]):
        for p in range(possible.shape[1]):
            if possible[k, p]:
                for axis in range(3):
                    along = 0.0
                    for j in range(3):
                        along += pose[j, axis] * (where[k, p, j] - pose[j, 3])
                    offset[k, p, axis] = along
                    box[0, axis], box[1, axis] = min(box[0, axis], along), max(box[1, axis], along)
    return bool(box[0, 0] <= box[1, 0])


@compiled
def _free_at(
    pose: Floats, place: Floats, offset: Doubles, box: Doubles, things: Kinds, near: tuple[Near, Near, Near]
) -> bool:
    """Whether hands at a place, `offset` from their pose in its axes, touch nothing."""
    for t in range(3):
        if near[t][2][0] < 0:
            _gather(pose, box, things[t], near[t])
        if _touching(pose, place, offset, things[t], near[t]):
            return False
    return True


@compiled
def _gather(pose: Floats, box: Doubles, things: Things, near: Near) -> None:
    """Those that the volume may touch at places within the box (2, 3) about the pose, in its axes."""
    columns, (bounds, _, _, _) = things
    coordinates, ids, state = near
    low, high = np.empty(3, np.float32), np.empty(3, np.float32)
    for axis in range(3):
        low[axis], high[axis] = bounds[0, axis] + box[0, axis] - ROOM, bounds[1, axis] + box[1, axis] + ROOM
    x, y, z = coordinates[0], coordinates[1], coordinates[2]
    a, b, c = columns[0], columns[1], columns[2]
    for axis in range(3):
        along = coordinates[axis]
        r0, r1, r2 = pose[0, axis], pose[1, axis], pose[2, axis]
        t0, t1, t2 = pose[0, 3], pose[1, 3], pose[2, 3]
        for i in range(len(a)):
            along[i] = r0 * (a[i] - t0) + r1 * (b[i] - t1) + r2 * (c[i] - t2)
    count = 0
    for i in range(len(a)):
        x0, y0, z0 = x[i], y[i], z[i]
        x[count], y[count], z[count], ids[count] = x0 * SCALE, y0 * SCALE, z0 * SCALE, i
        count += (
            (x0 > low[0]) & (x0 < high[0]) & (y0 > low[1]) & (y0 < high[1]) & (z0 > low[2]) & (z0 < high[2])
        )  # without a branch, which would be guessed wrong half of the time
    state[0], state[1] = count, 0


@compiled
def _touching(pose: Floats, place: Floats, offset: Doubles, things: Things, near: Near) -> bool:
    """Whether the volume touches one of those near; looked for from the one that it touched last: it often still is."""
    columns, (bounds, planes, end, cells) = things
    coordinates, ids, state = near
    x0 = np.float32((bounds[0, 0] + offset[0] - ROOM) / CELL - 1)
    y0 = np.float32((bounds[0, 1] + offset[1] - ROOM) / CELL - 1)
    z0 = np.float32((bounds[0, 2] + offset[2] - ROOM) / CELL - 1)
    x1, y1, z1 = np.float32(cells.shape[0] - 1), np.float32(cells.shape[1] - 1), np.float32(cells.shape[2] - 1)
    nothing = np.float32(0)
    m = state[1]
    for _ in range(state[0]):
        x = min(max(coordinates[0, m] - x0, nothing), x1)
        y = min(max(coordinates[1, m] - y0, nothing), y1)
        z = min(max(coordinates[2, m] - z0, nothing), z1)
        maybe = cells[np.uint32(x), np.uint32(y), np.uint32(z)]
        if maybe and _inside(pose, place, columns[:, ids[m]], bounds, planes, end):
            state[1] = m
            return True
        m = m + 1 if m + 1 < state[0] else 0
    return False


@compiled
def _inside(pose: Floats, place: Floats, point: Floats, bounds: Doubles, planes: Doubles, end: Ids) -> bool:
    """Whether a point lies in a volume at a place with a pose's rotation: the arithmetic of `points_in_volume`."""
    a = np.float64(point[0]) - np.float64(place[0])
    b = np.float64(point[1]) - np.float64(place[1])
    c = np.float64(point[2]) - np.float64(place[2])
    x = np.float64(pose[0, 0]) * a + np.float64(pose[1, 0]) * b + np.float64(pose[2, 0]) * c
    y = np.float64(pose[0, 1]) * a + np.float64(pose[1, 1]) * b + np.float64(pose[2, 1]) * c
    z = np.float64(pose[0, 2]) * a + np.float64(pose[1, 2]) * b + np.float64(pose[2, 2]) * c
    if x < bounds[0, 0] or x > bounds[1, 0] or y < bounds[0, 1] or y > bounds[1, 1]:
        return False
    if z < bounds[0, 2] or z > bounds[1, 2]:
        return False
    first = 0
    for last in end:
        within = True
        for f in range(first, last):
            if planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z > planes[f, 3]:
                within = False
                break
        if within:
            return True
        first = last
    return False
