"""The loops of `deepest_free`: hands of a frame after the other pushed forward until they touch something.

Points of all kinds, and the volumes that may not touch them, are joined in arrays, each kind after the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spgf_torch.compiled import compiled, lean

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ids = NDArray[np.int64]
Bits = NDArray[np.int32]
# Points of all kinds as columns (3, N), and where each kind's begin (4,).
Things = tuple[Floats, Ids]
# Of the volumes of all kinds (`Volume`): bounds (3, 2, 3); planes (F, 4) and where each piece's begin (pieces + 1,);
# where each kind's pieces begin (4,); cells (C,), where each kind's begin (3,), and how many along each axis (3, 3).
Volumes = tuple[Doubles, Doubles, Ids, Ids, Bits, Ids, Ids]
# Hands of one frame: their pose (4, 4), places (D, P, 3), the same in the pose's axes, and the box (2, 3) about these.
Hands = tuple[Floats, Floats, Doubles, Doubles]
# Those of the points that may be touched near one pose, each kind from where its points begin: coordinates (3, N) in
# its frame, in cells; indices (N,). (3,) how many of each kind, -1 before they are looked for; (3,) which was touched
# last.
Near = tuple[Floats, Ids, Ids, Ids]

# m; by so much a point's f32 coordinates in a hand's frame may be off.
ROOM = 1e-4
# m; side of the cells.
CELL = 0.004
SCALE = np.float32(1 / CELL)
# Pieces with a bit of their own in a cell.
PIECES = 30


@compiled
def push(T: Floats, where: Floats, possible: Bools, back: int, things: Things, volumes: Volumes, kept: Bools) -> None:
    """Out: kept (F, D, P), from False."""
    D, P = possible.shape[1:]
    offset, box = np.empty((D, P, 3)), np.empty((2, 3))
    columns, start = things
    count, last = np.empty(len(start) - 1, np.int64), np.empty(len(start) - 1, np.int64)
    near = np.empty(columns.shape, np.float32), np.empty(columns.shape[1], np.int64), count, last
    for f in range(len(T)):
        hands = T[f], where[f], offset, box
        if not _offsets_of(hands, possible[f]):
            continue
        for t in range(len(count)):
            count[t], last[t] = -1, 0  # to a slice it would take seconds to compile
        for p in range(P):
            asked, found = 0, False
            for k in range(D):
                if k < asked:
                    continue
                free = possible[f, k, p] and _free_at(hands, k, p, things, volumes, near)
                kept[f, k, p] = free
                if found or (free and back == 0):
                    break
                found, asked = free, k + (back if free else 1)


@lean
def _offsets_of(hands: Hands, possible: Bools) -> bool:
    """Out: places (D, P, 3) in the axes of the pose, and the box of those that are possible; none: False."""
    pose, places, offset, box = hands
    for axis in range(3):
        box[0, axis], box[1, axis] = np.inf, -np.inf
    for k in range(possible.shape[0]):
        for p in range(possible.shape[1]):
            if possible[k, p]:
                for axis in range(3):
                    along = 0.0
                    for j in range(3):
                        along += pose[j, axis] * (places[k, p, j] - pose[j, 3])
                    offset[k, p, axis] = along
                    box[0, axis], box[1, axis] = min(box[0, axis], along), max(box[1, axis], along)
    return bool(box[0, 0] <= box[1, 0])


@lean
def _free_at(hands: Hands, k: int, p: int, things: Things, volumes: Volumes, near: Near) -> bool:
    """Whether hands at place k, p touch nothing."""
    start, count = things[1], near[2]
    for t in range(len(count)):
        if start[t] < start[t + 1]:
            if count[t] < 0:
                _gather(hands, t, things, volumes, near)
            if _touching(hands, k, p, t, things, volumes, near):
                return False
    return True


@lean
def _gather(hands: Hands, t: int, things: Things, volumes: Volumes, near: Near) -> None:
    """Those of a kind that its volume may touch at places within the box."""
    pose, box, bounds = hands[0], hands[3], volumes[0]
    columns, start = things
    coordinates, ids, counts, _ = near
    for axis in range(3):
        along = coordinates[axis]
        r0, r1, r2 = pose[0, axis], pose[1, axis], pose[2, axis]
        t0, t1, t2 = pose[0, 3], pose[1, 3], pose[2, 3]
        for i in range(start[t], start[t + 1]):
            along[i] = r0 * (columns[0, i] - t0) + r1 * (columns[1, i] - t1) + r2 * (columns[2, i] - t2)
    x_low, x_high = np.float32(bounds[t, 0, 0] + box[0, 0] - ROOM), np.float32(bounds[t, 1, 0] + box[1, 0] + ROOM)
    y_low, y_high = np.float32(bounds[t, 0, 1] + box[0, 1] - ROOM), np.float32(bounds[t, 1, 1] + box[1, 1] + ROOM)
    z_low, z_high = np.float32(bounds[t, 0, 2] + box[0, 2] - ROOM), np.float32(bounds[t, 1, 2] + box[1, 2] + ROOM)
    x, y, z = coordinates[0], coordinates[1], coordinates[2]
    at = start[t]
    for i in range(start[t], start[t + 1]):
        x0, y0, z0 = x[i], y[i], z[i]
        x[at], y[at], z[at], ids[at] = x0 * SCALE, y0 * SCALE, z0 * SCALE, i
        at += (x0 > x_low) & (x0 < x_high) & (y0 > y_low) & (y0 < y_high) & (z0 > z_low) & (z0 < z_high)
        # without a branch, which would be guessed wrong half of the time
    counts[t] = at - start[t]


@lean
def _touching(hands: Hands, k: int, p: int, t: int, things: Things, volumes: Volumes, near: Near) -> bool:
    """Whether its volume touches one of those near; looked for from the one that it touched last: it often still is."""
    offset, (coordinates, ids, counts, last) = hands[2], near
    bounds, cells, begin, shape = volumes[0], volumes[4], volumes[5], volumes[6]
    start, count, m = things[1][t], counts[t], last[t]
    x0 = np.float32((bounds[t, 0, 0] + offset[k, p, 0] - ROOM) / CELL - 1)
    y0 = np.float32((bounds[t, 0, 1] + offset[k, p, 1] - ROOM) / CELL - 1)
    z0 = np.float32((bounds[t, 0, 2] + offset[k, p, 2] - ROOM) / CELL - 1)
    x1, y1, z1 = np.float32(shape[t, 0] - 1), np.float32(shape[t, 1] - 1), np.float32(shape[t, 2] - 1)
    nothing = np.float32(0)
    for _ in range(count):
        x = np.int64(min(max(coordinates[0, start + m] - x0, nothing), x1))
        y = np.int64(min(max(coordinates[1, start + m] - y0, nothing), y1))
        z = np.int64(min(max(coordinates[2, start + m] - z0, nothing), z1))
        maybe = cells[begin[t] + (x * shape[t, 1] + y) * shape[t, 2] + z]
        if maybe and _inside(hands, k, p, t, ids[start + m], maybe, things, volumes):
            last[t] = m
            return True
        m = m + 1 if m + 1 < count else 0
    return False


@lean
def _inside(hands: Hands, k: int, p: int, t: int, i: int, maybe: int, things: Things, volumes: Volumes) -> bool:
    """Whether point i lies in its volume at place k, p: the arithmetic of `points_in_volume`.

    Only those pieces are asked that may reach into its cell, which holds `maybe`.
    """
    (pose, places, _, _), (bounds, planes, faces, pieces), columns = hands, volumes[:4], things[0]
    a = np.float64(columns[0, i]) - np.float64(places[k, p, 0])
    b = np.float64(columns[1, i]) - np.float64(places[k, p, 1])
    c = np.float64(columns[2, i]) - np.float64(places[k, p, 2])
    x = np.float64(pose[0, 0]) * a + np.float64(pose[1, 0]) * b + np.float64(pose[2, 0]) * c
    y = np.float64(pose[0, 1]) * a + np.float64(pose[1, 1]) * b + np.float64(pose[2, 1]) * c
    z = np.float64(pose[0, 2]) * a + np.float64(pose[1, 2]) * b + np.float64(pose[2, 2]) * c
    if x < bounds[t, 0, 0] or x > bounds[t, 1, 0] or y < bounds[t, 0, 1] or y > bounds[t, 1, 1]:
        return False
    if z < bounds[t, 0, 2] or z > bounds[t, 1, 2]:
        return False
    for piece in range(pieces[t], pieces[t + 1]):
        if (maybe >> min(piece - pieces[t], PIECES)) & 1:
            within = True
            for f in range(faces[piece], faces[piece + 1]):
                if planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z > planes[f, 3]:
                    within = False
                    break
            if within:
                return True
    return False
