"""How near the pieces of hands are to points: hands and the points about them -> one distance a hand."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.registration import memory, operator


@operator("nearest_piece(Tensor at, Tensor normals, Tensor offsets, float most) -> Tensor")
def nearest_piece(at: Tensor, normals: Tensor, offsets: Tensor, most: float) -> Tensor:
    """(G,) f32 least signed distance of convex pieces to points at (G, 3, N), m: negative inside; at most `most`.

    A piece has faces normals (P, F, 3), offsets (P, F, 1); the distance to it is that to the plane of the farthest.
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
def _in_loops(at: Tensor, normals: Tensor, offsets: Tensor, most: float) -> Tensor:
    least = np.full(len(at), most, np.float32)
    _lower(memory(at), memory(normals), memory(offsets), least)
    return torch.from_numpy(least)


@nearest_piece.fake
def _shapes(at: Tensor, normals: Tensor, offsets: Tensor, most: float) -> Tensor:
    return at.new_empty(at.shape[0])


@compiled
def _lower(at: np.ndarray, normals: np.ndarray, offsets: np.ndarray, least: np.ndarray) -> None:
    """Lower `least` (G,) to the least signed distance."""
    closest, beyond = np.empty(at.shape[2], np.float32), np.empty(at.shape[2], np.float32)
    for g in range(len(at)):
        x, y, z = at[g, 0], at[g, 1], at[g, 2]
        closest[:] = least[g]
        for p in range(len(normals)):
            beyond[:] = -np.inf
            for f in range(normals.shape[1]):
                a, b, c, offset = normals[p, f, 0], normals[p, f, 1], normals[p, f, 2], offsets[p, f, 0]
                for i in range(len(beyond)):
                    beyond[i] = max(beyond[i], a * x[i] + b * y[i] + c * z[i] - offset)
            for i in range(len(closest)):
                closest[i] = min(closest[i], beyond[i])
        for i in range(len(closest)):
            least[g] = min(least[g], closest[i])
