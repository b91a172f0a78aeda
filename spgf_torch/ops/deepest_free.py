"""The search along the approach: hands pushed forward until they touch something -> where they are free.

What is far from a hand is passed over by its place in the hand's frame, with room for rounding; exact decisions are
those of `points_in_volume`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.ops.points_in_volume import in_a_piece
from spgf_torch.ops.push_loops import CELL, ROOM, Volumes, push
from spgf_torch.ops.registration import memory, operator

# Pairs of a frame and a point that torch looks at together: bounds the memory.
TOGETHER = 1 << 19


class Volume(NamedTuple):
    """Convex pieces.

    Attributes:
        bounds: (2, 3) f64, lowest and highest corner of a box about all, m. planes: (F, 4) f64, as in
            `points_in_volume`. end: (pieces,) int64, where each piece's planes end.
        cells: (X, Y, Z) int32, of cells of side `CELL` from `ROOM` below the box: bit i where piece i may reach into
            one, by as much again; those from `push_loops.PIECES` on share a bit. The outermost are empty.
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
        return cells.flatten()[index] != 0

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
    kept, kinds = torch.zeros_like(possible), [Volume(*volumes[4 * i : 4 * i + 4]) for i in range(len(points))]
    columns, start = memory(torch.cat(points).T), np.cumsum([0, *map(len, points)])
    push(memory(T), memory(where), memory(possible), back, (columns, start), _together(kinds), kept.numpy())
    return kept


def _together(kinds: list[Volume]) -> Volumes:
    """The volumes of all kinds in arrays."""
    faces = torch.cat([kind.end.diff(prepend=kind.end.new_zeros(1)) for kind in kinds])
    return (
        memory(torch.stack([kind.bounds for kind in kinds])),
        memory(torch.cat([kind.planes for kind in kinds])),
        np.cumsum([0, *faces.tolist()]),
        np.cumsum([0, *(len(kind.end) for kind in kinds)]),
        memory(torch.cat([kind.cells.flatten() for kind in kinds])),
        np.cumsum([0, *(kind.cells.numel() for kind in kinds)]),
        np.array([kind.cells.shape for kind in kinds]),
    )


@deepest_free.fake
def _shapes(
    T: Tensor, where: Tensor, possible: Tensor, back: int, points: list[Tensor], volumes: list[Tensor]
) -> Tensor:
    return torch.empty_like(possible)
