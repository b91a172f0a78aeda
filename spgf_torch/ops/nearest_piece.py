"""How near the pieces of hands are to points: hands and the points about them -> one distance a hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.ops.registration import memory, operator

# m; rounding of f32 coordinates makes distances differ by less.
SLACK = 1e-4


class Blocks(NamedTuple):
    """Points in blocks that lie close together: the distance to a plane differs by a block's reach at most.

    Attributes:
        order: (N,) int64, indices of points, block by block, each block's middle one first.
        start: (B + 1,) int64, where in `order` each block begins; the last is N.
        reach: (B,) f32, m from the middle point to the farthest of its block.
    """

    order: Tensor
    start: Tensor
    reach: Tensor

    @staticmethod
    def of(points: Tensor, side: float) -> Blocks:
        """Points (N, 3) on the CPU in cells of a side, m."""
        xyz = points.double().numpy()
        _, cell, count = np.unique(
            np.floor(xyz / side).astype(np.int64), axis=0, return_inverse=True, return_counts=True
        )
        cell = cell.reshape(-1)
        mean = np.stack([np.bincount(cell, column, len(count)) for column in xyz.T], axis=1) / count[:, None]
        order = np.lexsort((((xyz - mean[cell]) ** 2).sum(axis=1), cell))
        start = np.concatenate([[0], np.cumsum(count)])
        middle = order[start[:-1]].repeat(count)
        away = np.sqrt(((xyz[order] - xyz[middle]) ** 2).sum(axis=1))
        reach = np.maximum.reduceat(away, start[:-1]) if len(away) else away
        return Blocks(*map(torch.from_numpy, (order, start, reach.astype(np.float32))))


@operator("nearest_piece(Tensor at, Tensor normals, Tensor offsets, float most, Tensor[] blocks) -> Tensor")
def nearest_piece(at: Tensor, normals: Tensor, offsets: Tensor, most: float, blocks: Blocks) -> Tensor:
    """(G,) f32 least signed distance of convex pieces to points at (G, 3, N), m: negative inside; at most `most`.

    A piece has faces of unit normals (P, F, 3), offsets (P, F, 1); the distance to it is that to the plane of the
    farthest. Of `blocks` that are further than the nearest their middle point alone need be looked at.
    """
    x, y, z = at.unbind(1)
    closest = at.new_full((len(at), at.shape[2] + 1), most)
    for sides, ends in zip(normals, offsets, strict=True):
        beyond = torch.full_like(x, -torch.inf)
        for (a, b, c), offset in zip(sides.unbind(0), ends[:, 0].unbind(0), strict=True):
            beyond = torch.maximum(beyond, a * x + b * y + c * z - offset)
        closest[:, 1:] = torch.minimum(closest[:, 1:], beyond)
    return closest.amin(1)


@nearest_piece.on_cpu
def _in_loops(at: Tensor, normals: Tensor, offsets: Tensor, most: float, blocks: Blocks) -> Tensor:
    least = np.full(len(at), most, np.float32)
    order, start, reach = map(memory, blocks)
    _lower(memory(at), (memory(normals), memory(offsets)), order, start, reach, least)
    return torch.from_numpy(least)


@nearest_piece.fake
def _shapes(at: Tensor, normals: Tensor, offsets: Tensor, most: float, blocks: Blocks) -> Tensor:
    return at.new_empty(at.shape[0])


@compiled
def _lower(
    at: np.ndarray,
    planes: tuple[np.ndarray, np.ndarray],
    order: np.ndarray,
    start: np.ndarray,
    reach: np.ndarray,
    least: np.ndarray,
) -> None:
    """Lower `least` (G,) to the least signed distance: to the middles of blocks, then to what may be nearer."""
    count = at.shape[2]
    xyz, closest, beyond = np.empty((3, count), np.float32), np.empty(count, np.float32), np.empty(count, np.float32)
    on = np.empty(count, np.int64)
    for g in range(len(at)):
        chosen, blocks = order[start[:-1]], len(reach)
        for _ in range(2):  # asked at one place in the code: each call is inlined, and takes seconds to compile
            for axis in range(3):
                for i in range(len(chosen)):
                    xyz[axis, i] = at[g, axis, chosen[i]]
            _distances(xyz, planes, closest[: len(chosen)], beyond)
            for i in range(len(chosen)):
                least[g] = min(least[g], closest[i])
            near = 0
            for b in range(blocks):
                if closest[b] - reach[b] - np.float32(SLACK) < least[g]:
                    for i in range(start[b] + 1, start[b + 1]):
                        on[near] = order[i]
                        near += 1
            chosen, blocks = on[:near], 0


@lean
def _distances(xyz: np.ndarray, planes: tuple[np.ndarray, np.ndarray], closest: np.ndarray, beyond: np.ndarray) -> None:
    """Out: closest (n,), signed distances of the pieces to the first points of xyz (3, N). Scratch: beyond (N,)."""
    normals, offsets = planes
    x, y, z = xyz[0], xyz[1], xyz[2]
    closest[:] = np.inf
    for p in range(len(normals)):
        beyond[: len(closest)] = -np.inf
        for f in range(normals.shape[1]):
            a, b, c, offset = normals[p, f, 0], normals[p, f, 1], normals[p, f, 2], offsets[p, f, 0]
            for i in range(len(closest)):
                beyond[i] = max(beyond[i], a * x[i] + b * y[i] + c * z[i] - offset)
        for i in range(len(closest)):
            closest[i] = min(closest[i], beyond[i])
