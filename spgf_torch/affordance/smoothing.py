"""The loops of the neighbourhood analysis, compiled: particles of a slice in, kernel-weighted counts at cells out.

One rotation after the other, its particles are smoothed in translation into a table of that rotation's voxels, which
stays in the processor's second-level cache; then every cell that asks in a rotation near it adds what the table holds
at its own voxel. Tables hold sums of float32 weights times whole numbers in float64: exact, so that a group of
particles can be taken out and put back, and none depends on the order of particles. Sums over rotations are float32,
in the order of the rotations.

A block is a rotation and a group: particles carry the key (block * voxels + voxel) * 2 + success, with block =
rotation * groups + group. A view is a rotation and a group that is left out, rotation * (groups + 1) + group; the
last of each rotation leaves none out.
"""

from __future__ import annotations

import numpy as np

from spgf_torch.compiled import compiled


@compiled
def outcomes(slice_: np.ndarray, success: np.ndarray, counts: np.ndarray) -> None:
    """Add to counts (S, 2) int64 the failures and successes in each slice."""
    for i in range(len(slice_)):
        counts[slice_[i], int(success[i])] += 1


@compiled
def into_slices(
    slice_: np.ndarray,
    cell: np.ndarray,
    success: np.ndarray,
    voxels: int,
    group: int,
    groups: int,
    at: np.ndarray,
    key: np.ndarray,
) -> None:
    """Write the keys of a group's particles, those of slice s from key[at[s]] on; `at` (S,) int64 moves on."""
    for i in range(len(slice_)):
        s, rotation = slice_[i], cell[i] // voxels
        block, voxel = rotation * groups + group, cell[i] - rotation * voxels
        key[at[s]] = (block * voxels + voxel) * 2 + success[i]
        at[s] += 1


@compiled
def populated(key: np.ndarray, voxels: int, start: np.ndarray, voxel: np.ndarray, counts: np.ndarray) -> None:
    """Find the populated voxels of each block from the sorted keys (N,) of a slice.

    Args:
        start (blocks + 1,) int64: those of block b become start[b] : start[b + 1]; start[0] is 0.
        voxel (N,) int32, counts (N, 2) f32, 0: of those, and their successes and particles.
    """
    i, n, last = 0, -1, np.int64(-1)
    for block in range(len(start) - 1):
        first = np.int64(block) * voxels
        while i < len(key) and key[i] >> 1 < first + voxels:
            run = np.int64(key[i] >> 1)
            n += run != last  # no branch: whether the next particle is in the same voxel cannot be foreseen
            voxel[n] = run - first
            counts[n, 0] += key[i] & 1
            counts[n, 1] += 1
            last = run
            i += 1
        start[block + 1] = n + 1


@compiled
def ordered(bucket: np.ndarray, start: np.ndarray, at: np.ndarray, order: np.ndarray) -> None:
    """Counting sort: start (buckets + 1,), 0, of each bucket in the order (N,), which keeps equals in turn.

    at (buckets,) is written over.
    """
    for b in bucket:
        start[b + 1] += 1
    for b in range(len(at)):
        at[b] = start[b]
        start[b + 1] += start[b]
    for i in range(len(bucket)):
        order[at[bucket[i]]] = i
        at[bucket[i]] += 1


@compiled
def _add(
    voxel: np.ndarray,
    counts: np.ndarray,
    first: int,
    end: int,
    sign: float,
    offset: np.ndarray,
    weight: np.ndarray,
    table: np.ndarray,
    own: np.ndarray,
) -> None:
    """Add what is at first : end to `table`, weighted, about its voxels, and its particles to `own`."""
    for i in range(first, end):
        held, tried = sign * counts[i, 0], sign * counts[i, 1]
        own[voxel[i]] += tried
        for m in range(len(offset)):
            v, w = voxel[i] + offset[m], weight[m]
            successes, particles = table[v, 0] + w * held, table[v, 1] + w * tried
            table[v, 0], table[v, 1] = successes, particles


@compiled
def _clear(voxel: np.ndarray, first: int, end: int, offset: np.ndarray, table: np.ndarray, own: np.ndarray) -> None:
    for i in range(first, end):
        own[voxel[i]] = 0.0
        for m in range(len(offset)):
            v = voxel[i] + offset[m]
            table[v, 0], table[v, 1] = 0.0, 0.0


@compiled
def weigh(
    block_start: np.ndarray,
    voxel: np.ndarray,
    counts: np.ndarray,
    groups: int,
    offset: np.ndarray,
    weight: np.ndarray,
    turn: np.ndarray,
    turn_weight: np.ndarray,
    view_start: np.ndarray,
    asked: np.ndarray,
    table: np.ndarray,
    own: np.ndarray,
    found: np.ndarray,
) -> None:
    """Add to found (Q, 3) f32: successes and particles about cells of one slice, weighted, and particles in them.

    Args:
        block_start, voxel, counts: of `populated`.
        view_start (R * (groups + 1) + 1,) int64: cells that ask in view w are view_start[w] : view_start[w + 1].
        asked (Q,) int32: voxel of each cell that asks.
        table (voxels, 2) f64, own (voxels,) f32: 0, and 0 again afterwards.
    """
    views = groups + 1
    for source in range(len(turn)):
        begin, end = block_start[source * groups], block_start[(source + 1) * groups]
        if begin == end:
            continue
        _add(voxel, counts, begin, end, 1.0, offset, weight, table, own)
        for view in range(views):
            waiting = 0
            for n in range(turn.shape[1]):
                w = turn[source, n] * views + view
                waiting += view_start[w + 1] - view_start[w]
            if waiting == 0:
                continue
            # The view of a group takes its block out; that of all groups an empty one.
            a, b = block_start[source * groups + view], block_start[source * groups + min(view + 1, groups)]
            _add(voxel, counts, a, b, -1.0, offset, weight, table, own)
            for n in range(turn.shape[1]):
                share, w = turn_weight[source, n], turn[source, n] * views + view
                if share == 0:
                    break
                for q in range(view_start[w], view_start[w + 1]):
                    v = asked[q]
                    successes, particles = found[q, 0] + share * table[v, 0], found[q, 1] + share * table[v, 1]
                    found[q, 0], found[q, 1] = successes, particles
                    if turn[source, n] == source:
                        found[q, 2] = own[v]
            _add(voxel, counts, a, b, 1.0, offset, weight, table, own)
        _clear(voxel, begin, end, offset, table, own)


@compiled
def hand_back(found: np.ndarray, place: np.ndarray, counts: np.ndarray) -> None:
    """Write the rows found (Q, 3) of populated cells to the rows `place` (Q,) of counts."""
    for q in range(len(place)):
        if found[q, 2] > 0:
            for column in range(3):
                counts[place[q], column] = found[q, column]
