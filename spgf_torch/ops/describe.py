"""The Sliced Pineapple Grid Feature of every texlet, from neighbours to the aligned grid (paper, section 3.1)."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.ops.alignment import (
    aligned_poses,
    aligned_poses_in_torch,
    highest_curvature,
    highest_curvature_in_torch,
    start_at,
    start_at_in_torch,
)
from spgf_torch.ops.neighbours import Neighbourhoods, NeighbourhoodsInTorch
from spgf_torch.ops.pairwise_relations import (
    Pairs,
    frames_in_torch,
    pairs_in_torch,
    pairs_of,
    reference_frames,
    relations,
    relations_in_torch,
    turned,
)
from spgf_torch.ops.registration import memory, operator
from spgf_torch.ops.ring_grid import Ring, rings, rings_in_torch
from spgf_torch.threads import in_parts, one_thread

# The soft alignment looks for its direction on rings this many times finer (2 deg with 36 cells).
FINER = 5

Described = tuple[Tensor, Tensor, Tensor]


@operator(
    "describe(Tensor positions, Tensor normals, Tensor? start, float radius, SymInt[] ring, str gaps, bool soft) "
    "-> (Tensor T_object_feature, Tensor rings, Tensor valid)"
)
def describe(
    positions: Tensor, normals: Tensor, start: Tensor | None, radius: float, ring: Ring, gaps: str, soft: bool
) -> Described:
    """Poses (N, 4, 4), rings (N, 2, cells, 2) and validity (N,) of the features of N texlets (`features.spgf`).

    Args:
        positions, normals: (N, 3) m and unit, float32 or float64.
        start: (N,) int64, the cell of the rings that becomes cell 0; None: that of the highest curvature.
        gaps: how a gap is encoded, a key of `moving_average.GAPS`.
        soft: the direction of the highest curvature is found on finer, softly filled rings; without `start`.

    Raises InputError for coordinates that are not finite, normals that are not unit vectors, and a start that is no
    cell.
    """
    ring, near = _checked(normals, start, ring), NeighbourhoodsInTorch.of(positions, radius)
    X, n = positions[near.order], normals[near.order]
    found = [_no_features(X, ring)]
    for part in near.parts:
        counts, neighbour = near.of_part(part)
        pairs = pairs_in_torch(counts, neighbour, X[part], X, n)

        def in_frames(frames: Tensor, ring: Ring, soft: bool, pairs: Pairs[Tensor] = pairs) -> tuple[Tensor, Tensor]:
            return rings_in_torch(pairs.start, relations_in_torch(pairs, frames), ring, gaps, soft)

        frames = frames_in_torch(n[part], pairs.towards)
        if soft:
            fine = finer(ring)
            frames = turned_to(frames, highest_curvature_in_torch(in_frames(frames, fine, True)[0]), fine)
        filled, valid = in_frames(frames, ring, False)
        begin = torch.zeros(len(filled), dtype=torch.int64, device=X.device)
        if start is not None:
            begin = start[near.order[part]]
        elif not soft:
            begin = highest_curvature_in_torch(filled)
        T = aligned_poses_in_torch(frames, begin, ring.cells, X[part])
        found.append((T, start_at_in_torch(filled, begin), valid))
    T, aligned, valid = (torch.cat(column) for column in zip(*found, strict=True))
    back = near.order.argsort()
    return T[back], aligned[back], valid[back]


@describe.on_cpu
def _in_loops(
    positions: Tensor, normals: Tensor, start: Tensor | None, radius: float, ring: Ring, gaps: str, soft: bool
) -> Described:
    ring, near = _checked(normals, start, ring), Neighbourhoods(positions, radius)
    X, n = memory(positions), memory(normals)
    cloud, facing = X[near.order], n[near.order]
    begin = np.zeros(len(X), np.int64) if start is None else memory(start)
    frames = np.empty((len(X), 3, 3), X.dtype)
    aligned, valid = np.empty((len(X), 2, ring.cells, 2), X.dtype), np.empty(len(X), np.bool_)

    @one_thread()
    def work(part: slice) -> None:
        rows = near.order[part]
        pairs = pairs_of(*near.of(part), cloud[part], cloud, facing)

        def in_frames(frames: np.ndarray, ring: Ring, soft: bool) -> tuple[np.ndarray, np.ndarray]:
            return rings(pairs.start, relations(pairs, frames), ring, gaps, soft)

        own = reference_frames(facing[part], pairs.towards)
        if soft:
            fine = finer(ring)
            start_cell = torch.from_numpy(highest_curvature(in_frames(own, fine, True)[0]))
            own = turned_to(torch.from_numpy(own), start_cell, fine).numpy()
        found, valid[rows] = in_frames(own, ring, False)
        if start is None and not soft:
            begin[rows] = highest_curvature(found)
        frames[rows] = own
        start_at(found, begin[rows], rows, aligned)

    deque(in_parts(work, near.parts), maxlen=0)
    T = aligned_poses(frames, begin, ring.cells, X)
    return torch.from_numpy(T), torch.from_numpy(aligned), torch.from_numpy(valid)


@describe.fake
def _shapes(
    positions: Tensor, normals: Tensor, start: Tensor | None, radius: float, ring: Ring, gaps: str, soft: bool
) -> Described:
    N = positions.shape[0]
    T, aligned = positions.new_empty((N, 4, 4)), positions.new_empty((N, 2, ring[0], 2))
    return T, aligned, positions.new_empty(N, dtype=torch.bool)


def finer(ring: Ring) -> Ring:
    """The ring whose direction of highest curvature the soft alignment takes, on softly filled cells.

    The direction hardly depends on R_x then, as cells 10 deg wide make it. The filter is as wide as before.
    """
    return Ring(FINER * ring.cells, FINER * (ring.half_length + 1) - 1, ring.layers)


def turned_to(frames: Tensor, start: Tensor, ring: Ring) -> Tensor:
    """The frames (N, 3, 3) turned about their normals to the cell start (N,) of this ring."""
    return turned(frames, start.to(frames) * (2 * math.pi / ring.cells))


def _checked(normals: Tensor, start: Tensor | None, ring: Ring) -> Ring:
    """Raises InputError for values that cannot be described: at a cell that is not there loops read foreign memory."""
    length, ring = torch.linalg.vector_norm(normals, dim=1), Ring(*ring)
    if not ((length - 1).abs() <= 1e-3).all():
        worst = length[(length - 1).abs().nan_to_num(math.inf).argmax()].item()
        raise InputError(f"normals: expected unit vectors, got one of length {worst:.4g}")
    if start is not None and bool(((start < 0) | (start >= ring.cells)).any()):
        raise InputError(f"start: expected cells from 0 to {ring.cells - 1}, got others")
    return ring


def _no_features(X: Tensor, ring: Ring) -> Described:
    T, aligned = X.new_empty((0, 4, 4)), X.new_empty((0, 2, ring.cells, 2))
    return T, aligned, torch.empty(0, dtype=torch.bool, device=X.device)
