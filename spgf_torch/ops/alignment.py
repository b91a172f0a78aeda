"""Alignment of the grid to the direction of highest curvature (paper, section 3.1.2, Fig. 5), for `describe`.

The paper takes the cell of the largest alpha2 in the top layer as the start of both rings. Where the surface
has a gap many cells share the saturated value, and the paper does not say which wins. Here, among the cells
within TIE of the maximum,
1. the centre of the widest run of them wins (of an even run the first of its two middle cells);
2. among equally wide runs, the one after which the rings are highest, both angles of both layers weighted with
   exp(-angle) by the angle from the start: a smooth form of comparing the rings cell by cell from the start on.
Both look at nothing but the rings' content going round, so the choice does not depend on R_x. Rings that repeat
themselves start equally well at each repeat: of these the first from R_x on, which turns with the object, wins.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.geometry.se3 import from_rotation

# rad; curvatures this close are equal: well above float32 rounding (1e-6), well below the noise of a normal (0.05).
TIE = 1e-4


def highest_curvature(rings: np.ndarray) -> np.ndarray:
    """The start cell (N,) int64 of rings (N, 2, cells, 2) as `ring_grid` makes them."""
    start = np.empty(len(rings), np.int64)
    _highest_curvature(rings, _nearer(rings.shape[2]), start)
    return start


@lru_cache
def _nearer(cells: int) -> np.ndarray:
    """What each cell counts in `_content_after`, by how far ahead it is."""
    nearer: np.ndarray = torch.exp(torch.arange(cells, dtype=torch.float64) * (-2 * math.pi / cells)).numpy()
    return nearer


def start_at(rings: np.ndarray, start: np.ndarray, rows: np.ndarray, aligned: np.ndarray) -> None:
    """Write rings (n, 2, cells, 2), moved round so that cell start (n,) becomes cell 0 of both, to aligned[rows]."""
    _start_at(rings, start, rows, aligned)


def aligned_poses(frames: np.ndarray, start: np.ndarray, cells: int, positions: np.ndarray) -> np.ndarray:
    """T_object_feature (N, 4, 4): frames (N, 3, 3) turned about their z to the cell start (N,), at positions (N, 3)."""
    angle = torch.arange(cells, dtype=torch.float64) * (2 * math.pi / cells)
    T = np.zeros((len(frames), 4, 4), frames.dtype)
    _aligned_poses(frames, start, angle.cos().numpy(), angle.sin().numpy(), positions, T)
    return T


def highest_curvature_in_torch(rings: Tensor) -> Tensor:
    """`highest_curvature` by torch's operations, on any device."""
    curvature = rings[:, 0, :, 1].double()
    tied = curvature >= curvature.amax(1, keepdim=True) - TIE
    start = tied.int().argmax(1)
    several = (tied.sum(1) > 1).nonzero()[:, 0]
    start[several] = _centre_of_widest_run(tied[several], rings[several])
    return start


def _centre_of_widest_run(tied: Tensor, rings: Tensor) -> Tensor:
    """(n,) int64 cell: of the widest runs of True in tied (n, cells), the one whose centre has the highest content."""
    cells = tied.shape[1]
    length, going = torch.zeros_like(tied, dtype=torch.int64), tied & ~tied.roll(1, dims=1)
    for ahead in range(1, cells + 1):
        length, going = length + going, going & tied.roll(-ahead, dims=1)
    length[tied.all(1)] = cells  # no run has a beginning there: each cell is one
    widest = length.amax(1, keepdim=True)
    ring = torch.arange(cells, device=tied.device)
    middle = (ring + (widest - 1) // 2) % cells
    nearer = torch.exp(ring.double() * (-2 * math.pi / cells))
    top, bottom = rings.unbind(1)
    content = (top[..., 0] + top[..., 1] + bottom[..., 0] + bottom[..., 1]).double()
    after = (content[:, (ring[:, None] + ring) % cells] * nearer).sum(2)  # of each cell, going round
    found = after.gather(1, middle).masked_fill(length != widest, -math.inf)
    first = (found >= found.amax(1, keepdim=True) - TIE).int().argmax(1, keepdim=True)
    return middle.gather(1, first)[:, 0]


def start_at_in_torch(rings: Tensor, start: Tensor) -> Tensor:
    """Rings (N, 2, cells, 2), moved round so that cell start (N,) becomes cell 0 of both."""
    cells = rings.shape[2]
    cell = (start[:, None] + torch.arange(cells, device=start.device)) % cells
    return rings.gather(2, cell[:, None, :, None].expand_as(rings))


def aligned_poses_in_torch(frames: Tensor, start: Tensor, cells: int, positions: Tensor) -> Tensor:
    """`aligned_poses` by torch's operations."""
    angle = torch.arange(cells, dtype=torch.float64, device="cpu") * (2 * math.pi / cells)  # the same on all devices
    cos, sin = (table.to(start.device)[start][:, None] for table in (angle.cos(), angle.sin()))
    x, y, z = frames.double().unbind(2)
    return from_rotation(torch.stack([cos * x + sin * y, cos * y - sin * x, z], dim=2).to(frames), positions)


@compiled
def _highest_curvature(rings: np.ndarray, nearer: np.ndarray, start: np.ndarray) -> None:
    tied, length = np.empty(len(nearer), np.bool_), np.empty(len(nearer), np.int64)
    for row in range(len(rings)):
        curvature = rings[row, 0, :, 1]  # alpha2 of the top layer
        highest, count = curvature[0], 0
        for cell in range(1, len(tied)):
            highest = max(highest, curvature[cell])
        for cell in range(len(tied)):
            tied[cell] = curvature[cell] >= highest - TIE
            count += tied[cell]
            start[row] = cell if tied[cell] else start[row]
        if count > 1:
            _run_lengths(tied, length)
            start[row] = _widest_run(length, rings[row], nearer)


@lean
def _run_lengths(tied: np.ndarray, length: np.ndarray) -> None:
    """At the first cell of each run of True around the ring its length, elsewhere 0.

    A ring that is True all round has no first cell: each cell is one, with the length of the ring.
    """
    cells = len(tied)
    everywhere = True
    for cell in range(cells):
        everywhere &= tied[cell]
    length[:] = cells if everywhere else 0
    for first in range(cells):
        if tied[first] and not tied[first - 1]:
            while tied[(first + length[first]) % cells]:
                length[first] += 1


@lean
def _widest_run(length: np.ndarray, ring: np.ndarray, nearer: np.ndarray) -> int:
    """The centre of the widest run; of equal ones that of the highest content, of these the first."""
    cells = len(length)
    widest = 0
    for first in range(cells):
        widest = max(widest, length[first])
    centre, highest = -1, -math.inf
    for look in range(2):  # only when the highest is known the first within TIE of it can be taken
        for first in range(cells):
            if length[first] == widest:
                middle = (first + (widest - 1) // 2) % cells
                content = _content_after(ring, middle, nearer)
                if look == 1 and content >= highest - TIE:
                    return middle
                if content > highest:
                    centre, highest = middle, content
    return centre


@lean
def _content_after(ring: np.ndarray, start: int, nearer: np.ndarray) -> float:
    """What follows the cell going round, near cells most."""
    cells = len(nearer)
    total = 0.0
    for ahead in range(cells):
        cell = (start + ahead) % cells
        total += nearer[ahead] * (ring[0, cell, 0] + ring[0, cell, 1] + ring[1, cell, 0] + ring[1, cell, 1])
    return total


@lean
def _start_at(rings: np.ndarray, start: np.ndarray, rows: np.ndarray, aligned: np.ndarray) -> None:
    cells = rings.shape[2]
    for i in range(len(rings)):
        for layer in range(2):
            source, target, cell = rings[i, layer], aligned[rows[i], layer], start[i]
            for k in range(cells):
                target[k, 0], target[k, 1] = source[cell, 0], source[cell, 1]
                cell = cell + 1 if cell + 1 < cells else 0


@lean
def _aligned_poses(
    frames: np.ndarray, start: np.ndarray, cos: np.ndarray, sin: np.ndarray, positions: np.ndarray, T: np.ndarray
) -> None:
    for i in range(len(T)):
        c, s = cos[start[i]], sin[start[i]]
        for axis in range(3):
            x, y, z = frames[i, axis, 0], frames[i, axis, 1], frames[i, axis, 2]
            T[i, axis, 0], T[i, axis, 1], T[i, axis, 2] = c * x + s * y, c * y - s * x, z
            T[i, axis, 3] = positions[i, axis]
        T[i, 3, 3] = 1
