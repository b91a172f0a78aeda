"""Which points lie within a radius of which."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.errors import InputError
from spgf_torch.ops.registration import memory, operator, unknown_size

# Points looked at for the neighbours of one part of the cloud. What is made of a part takes some 1 MB: it stays in the
# processor's second-level cache, and the next part gets the same memory. A point that alone has more is a part of its
# own.
CANDIDATES = 1 << 16

# Cubes are wider than the radius by this share, so that rounding puts no neighbour two cubes away.
WIDER = 1e-6

# Cubes along an axis, so that three axes make one number of 64 bits.
SPAN = 1 << 20


class Neighbourhoods:
    """The points within `radius` (m) of each of N points, found for a part of them at a time: memory is bounded.

    points: (N, 3), any float type, on the CPU. Two points at the same place are neighbours of each other; a point
    is never its own. Distances are compared in float64. Points are sorted into cubes as wide as the radius, and only
    those in the 27 cubes about a point are looked at.

    Attributes:
        order: (N,) int64, the points so that close ones come together. All other numbers of points here are places in
            this order.
        parts: slices of the order that are small enough for `of`, in order.

    Raises InputError for another shape and for NaN or infinite coordinates.
    """

    def __init__(self, points: Tensor, radius: float) -> None:
        _check_shape(points)
        xyz = memory(points, torch.float64)
        self.radius = radius
        self.order, self._places = _in_cubes(xyz, radius)
        self._xyz = np.ascontiguousarray(xyz[self.order].T)
        cube, first, last = self._places
        self._longest = int((last - first).max(initial=0))
        self._candidates = np.append(0, (last - first).sum(1)[cube].cumsum())
        group = self._candidates[:-1] // CANDIDATES
        borders = [0, *(np.flatnonzero(group[1:] != group[:-1]) + 1).tolist(), len(group)]
        self.parts = [slice(a, b) for a, b in pairwise(borders) if a < b]

    def of(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Of the points in the part: their neighbours (P,) int32, one point's after the other's, and where they start
        (n + 1,) int64: those of point k of the part are neighbour[start[k] : start[k + 1]]."""
        room = self._candidates[part.stop] - self._candidates[part.start] + 1
        start, neighbour = np.zeros(part.stop - part.start + 1, np.int64), np.empty(room, np.int32)
        _within(self._xyz, self.radius**2, part.start, self._places, self._longest, start, neighbour)
        return start, neighbour[: start[-1]]


@dataclass(frozen=True)
class NeighbourhoodsInTorch:
    """`Neighbourhoods` by torch's operations, on any device: the same order, the same pairs in the same sequence."""

    order: Tensor
    xyz: Tensor  # (N, 3) f64, in this order
    cube: Tensor
    first: Tensor
    last: Tensor
    radius: float

    @staticmethod
    def of(points: Tensor, radius: float) -> NeighbourhoodsInTorch:
        _check_shape(points)
        if not torch.isfinite(points).all():
            raise _not_finite()
        xyz = points.detach().double()
        if len(xyz) == 0:
            none = torch.zeros(0, dtype=torch.int64, device=xyz.device)
            return NeighbourhoodsInTorch(none, xyz, none, none.view(0, 9), none.view(0, 9), radius)
        steps = ((xyz - xyz.amin(0).clamp(max=0)) / ((1 + WIDER) * radius)).floor()
        if steps.max() > SPAN:
            steps = torch.stack([_compact_in_torch(axis) for axis in steps.unbind(1)], dim=1)
        _, ny, nz = (int(most) + 3 for most in steps.amax(0))  # none beside the first and last
        x, y, z = steps.long().unbind(1)
        key, order = torch.sort((x * ny + y) * nz + z, stable=True)
        cubes, cube, counts = torch.unique_consecutive(key, return_inverse=True, return_counts=True)
        places = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
        rows = torch.tensor([(x * ny + y) * nz for x in (-1, 0, 1) for y in (-1, 0, 1)], device=key.device)
        middle = cubes[:, None] + rows
        first, last = torch.searchsorted(cubes, middle - 1), torch.searchsorted(cubes, middle + 1, right=True)
        return NeighbourhoodsInTorch(order, xyz[order], cube, places[first], places[last], radius)

    @property
    def parts(self) -> list[slice]:
        candidates = (self.last - self.first).sum(1)[self.cube].cumsum(0)
        ends = torch.unique_consecutive(candidates // CANDIDATES, return_counts=True)[1].cumsum(0).tolist()
        return [slice(a, b) for a, b in pairwise([0, *ends])]

    def of_part(self, part: slice) -> tuple[Tensor, Tensor]:
        """How many neighbours (n,) int64 each point of the part has, and these (P,) int64, places in the order."""
        first, size = self.first[self.cube[part]], (self.last - self.first)[self.cube[part]]
        ends = size.flatten().cumsum(0)
        row = torch.arange(size.numel(), device=size.device).repeat_interleave(size.flatten())
        neighbour = torch.arange(len(row), device=row.device) + (first.flatten() - ends + size.flatten())[row]
        centre = row // 9
        x, y, z = (self.xyz[neighbour] - self.xyz[part][centre]).unbind(1)
        near = (x * x + y * y + z * z <= self.radius**2) & (neighbour != centre + part.start)
        return torch.bincount(centre[near], minlength=len(size)), neighbour[near]


@operator("radius_pairs(Tensor points, float radius) -> (Tensor centre, Tensor neighbour)")
def radius_pairs(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Every ordered pair of different points at most `radius` (m) apart, as in `Neighbourhoods`.

    Returns (centre, neighbour), each (P,) int64, sorted by centre and then by neighbour; each pair occurs both ways
    round. Raises InputError for another shape than (N, 3), and for coordinates that are not finite.
    """
    near = NeighbourhoodsInTorch.of(points, radius)
    found = [near.order[:0]]
    for part in near.parts:
        counts, neighbour = near.of_part(part)
        found.append(near.order[part].repeat_interleave(counts) << 32 | near.order[neighbour])
    key = torch.cat(found).sort().values
    return key >> 32, key & 0xFFFFFFFF


@radius_pairs.on_cpu
def _radius_pairs_in_loops(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    near = Neighbourhoods(points, radius)
    found = [np.empty(0, np.int64)]
    for part in near.parts:
        start, neighbour = near.of(part)
        centre = near.order[part].repeat(np.diff(start))
        found.append(centre << 32 | near.order[neighbour])
    key = torch.from_numpy(np.sort(np.concatenate(found)))  # one key sorts faster than two columns
    return key >> 32, key & 0xFFFFFFFF


@radius_pairs.fake
def _radius_pairs_shapes(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    P = unknown_size()
    return points.new_empty(P, dtype=torch.int64), points.new_empty(P, dtype=torch.int64)


def _check_shape(points: Tensor) -> None:
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points: expected shape (N, 3), got {tuple(points.shape)}")


def _not_finite() -> InputError:
    return InputError("points: expected finite coordinates, got NaN or infinite values")


def _compact_in_torch(cube: Tensor) -> Tensor:
    """`_compact` by torch's operations."""
    values, place = torch.unique(cube, return_inverse=True)
    compact: Tensor = values.diff(prepend=values[:1]).clamp(max=2).cumsum(0)[place]
    return compact


class Places(NamedTuple):
    """The cube of each point (N,), and the points first (C, 9) : last (C, 9) of the nine rows of three about a cube."""

    cube: np.ndarray
    first: np.ndarray
    last: np.ndarray


def _in_cubes(xyz: np.ndarray, radius: float) -> tuple[np.ndarray, Places]:
    """The points' order, and their places in it."""
    finite, steps, most = _steps(xyz, (1 + WIDER) * radius)
    if not finite:
        raise _not_finite()
    if most.max() > SPAN:
        steps = np.stack([_compact(axis) for axis in steps.T], axis=1)
        most = steps.max(0)
    ny, nz = int(most[1]) + 3, int(most[2]) + 3  # none beside the first and last
    key = _keys(steps, ny, nz)
    order = np.argsort(key, kind="stable")
    return order, Places(*_places(key[order], ny, nz))


@compiled
def _steps(xyz: np.ndarray, width: float) -> tuple[bool, np.ndarray, np.ndarray]:
    """Whether all points are finite; how many cubes each lies from the lowest, (N, 3) whole numbers; the most (3,)."""
    finite, low, steps, most = True, np.zeros(3), np.empty_like(xyz), np.zeros(3)
    for i in range(len(xyz)):
        for axis in range(3):
            finite &= np.isfinite(xyz[i, axis])
            low[axis] = min(low[axis], xyz[i, axis])
    for i in range(len(xyz)):
        for axis in range(3):
            steps[i, axis] = np.floor((xyz[i, axis] - low[axis]) / width)
            most[axis] = max(most[axis], steps[i, axis])
    return finite, steps, most


@compiled
def _keys(steps: np.ndarray, ny: int, nz: int) -> np.ndarray:
    """A number (N,) int64 for each cube; those of a row along z follow one another."""
    key = np.empty(len(steps), np.int64)
    for i in range(len(steps)):
        key[i] = (np.int64(steps[i, 0]) * ny + np.int64(steps[i, 1])) * nz + np.int64(steps[i, 2])
    return key


@compiled
def _places(key: np.ndarray, ny: int, nz: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`Places` of sorted keys (N,)."""
    cube, begin = np.empty(len(key), np.int64), np.empty(len(key) + 1, np.int64)
    cubes = 0
    for i in range(len(key)):
        if i == 0 or key[i] != key[i - 1]:
            begin[cubes] = i
            cubes += 1
        cube[i] = cubes - 1
    begin[cubes] = len(key)
    first, last = np.empty((cubes, 9), np.int64), np.empty((cubes, 9), np.int64)
    for row in range(9):
        low, high, step = 0, 0, ((row // 3 - 1) * ny + row % 3 - 1) * nz
        for k in range(cubes):
            middle = key[begin[k]] + step
            while low < cubes and key[begin[low]] < middle - 1:
                low += 1
            while high < cubes and key[begin[high]] <= middle + 1:
                high += 1
            first[k, row], last[k, row] = begin[low], begin[high]
    return cube, first, last


def _compact(cube: np.ndarray) -> np.ndarray:
    """Whole numbers (N,) with the same order and neighbours, and no gap wider than one: they stay small."""
    values, place = np.unique(cube, return_inverse=True)
    return np.minimum(np.diff(values, prepend=values[:1]), 2).cumsum()[place]


@compiled
def _within(
    xyz: np.ndarray,
    square: float,
    begin: int,
    places: Places,
    longest: int,
    start: np.ndarray,
    neighbour: np.ndarray,
) -> None:
    """Out: start, neighbour of the points from `begin` on; `longest`: points of a row of cubes at most.

    Branch-free: every candidate is written; the cursor advances only for those within the radius.
    """
    cube, first, last = places
    X, Y, Z = xyz[0], xyz[1], xyz[2]
    apart = np.empty(longest, np.float64)  # squared distances to the points of a row of cubes
    found = 0
    for k in range(len(start) - 1):
        i = begin + k
        x, y, z = X[i], Y[i], Z[i]
        for row in range(9):
            a, b = first[cube[i], row], last[cube[i], row]
            xs, ys, zs = X[a:b], Y[a:b], Z[a:b]
            for j in range(b - a):
                dx, dy, dz = xs[j] - x, ys[j] - y, zs[j] - z
                apart[j] = dx * dx + dy * dy + dz * dz
            if a <= i < b:
                apart[i - a] = np.inf
            for j in range(b - a):
                neighbour[found] = a + j
                found += apart[j] <= square
        start[k + 1] = found
