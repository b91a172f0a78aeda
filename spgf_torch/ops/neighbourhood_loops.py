"""The loops of the neighbourhood analysis, compiled: particles of a partition in, kernel-weighted counts at cells out.

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

from typing import NamedTuple

import numpy as np

from spgf_torch.compiled import compiled


class Blocks(NamedTuple):
    """Populated voxels of a partition: those of block b are start[b] : start[b + 1].

    start (blocks + 1,) int64, voxel (N,) int32, counts (N, 2) f32: successes and particles.
    """

    start: np.ndarray
    voxel: np.ndarray
    counts: np.ndarray


class Near(NamedTuple):
    """A `geometry.se3_grid.Kernel`."""

    offset: np.ndarray
    weight: np.ndarray
    turn: np.ndarray
    turn_weight: np.ndarray


class Asked(NamedTuple):
    """Cells that ask: those in view w are start[w] : start[w + 1]; start (views + 1,) int64, voxel (Q,) int32."""

    start: np.ndarray
    voxel: np.ndarray


class Table(NamedTuple):
    """Of a rotation: successes and particles about each voxel, weighted (voxels, 2) f64, and particles in it, f32."""

    near: np.ndarray
    own: np.ndarray


@compiled
def outcomes(partition: np.ndarray, success: np.ndarray, counts: np.ndarray) -> None:
    """In and out: counts (S, 2) int64, to which the failures and successes in each partition are added."""
    for i in range(len(partition)):
        counts[partition[i], int(success[i])] += 1


@compiled
def into_partitions(
    partition: np.ndarray,
    cell: np.ndarray,
    success: np.ndarray,
    voxels: int,
    group: int,
    groups: int,
    at: np.ndarray,
    key: np.ndarray,
) -> None:
    """Out: key, of a group's particles, those of partition s from key[at[s]] on. In and out: at (S,) int64 moves on."""
    for i in range(len(partition)):
        s, rotation = partition[i], cell[i] // voxels
        block, voxel = rotation * groups + group, cell[i] - rotation * voxels
        key[at[s]] = (block * voxels + voxel) * 2 + success[i]
        at[s] += 1


@compiled
def populated(key: np.ndarray, voxels: int, start: np.ndarray, voxel: np.ndarray, counts: np.ndarray) -> None:
    """Out: `Blocks` from the sorted keys (N,) of a partition; start and counts hold 0 before."""
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
def ordered(bucket: np.ndarray, start: np.ndarray, order: np.ndarray) -> None:
    """Counting sort. Out: start (buckets + 1,), 0 before, of each bucket in the order (N,); equals keep their turn."""
    at = np.empty(len(start) - 1, np.int64)
    for b in bucket:
        start[b + 1] += 1
    for b in range(len(at)):
        at[b] = start[b]
        start[b + 1] += start[b]
    for i in range(len(bucket)):
        order[at[bucket[i]]] = i
        at[bucket[i]] += 1


@compiled
def weigh(blocks: Blocks, groups: int, near: Near, asked: Asked, voxels: int, found: np.ndarray) -> None:
    """In and out: found (Q, 3) f32, 0 before: weighted successes and particles about the cells asked, and in them."""
    table = Table(np.zeros((voxels, 2)), np.zeros(voxels, np.float32))
    for source in range(len(near.turn)):
        begin, end = blocks.start[source * groups], blocks.start[(source + 1) * groups]
        if begin == end:
            continue
        _splat(blocks, begin, end, 1.0, near, table)
        for view in range(groups + 1):
            if _waiting(asked, near, source, view, groups + 1) == 0:
                continue
            # The view of a group takes its block out; that of all groups an empty one.
            block = source * groups
            a, b = blocks.start[block + view], blocks.start[block + min(view + 1, groups)]
            _splat(blocks, a, b, -1.0, near, table)
            _gather(asked, near, source, view, groups + 1, table, found)
            _splat(blocks, a, b, 1.0, near, table)
        _clear(blocks, begin, end, near, table)


@compiled
def _splat(blocks: Blocks, first: int, end: int, sign: float, near: Near, table: Table) -> None:
    """In and out: table, to which what is at first : end is added."""
    offset, weight, around, own = near.offset, near.weight, table.near, table.own
    for i in range(first, end):
        voxel = blocks.voxel[i]
        held, tried = sign * blocks.counts[i, 0], sign * blocks.counts[i, 1]
        own[voxel] += tried
        for m in range(len(offset)):
            v, w = voxel + offset[m], weight[m]
            successes, particles = around[v, 0] + w * held, around[v, 1] + w * tried
            around[v, 0], around[v, 1] = successes, particles


@compiled
def _clear(blocks: Blocks, first: int, end: int, near: Near, table: Table) -> None:
    """In and out: table, 0 where what is at first : end had been added."""
    for i in range(first, end):
        voxel = blocks.voxel[i]
        table.own[voxel] = 0.0
        for m in range(len(near.offset)):
            v = voxel + near.offset[m]
            table.near[v, 0], table.near[v, 1] = 0.0, 0.0


@compiled
def _waiting(asked: Asked, near: Near, source: int, view: int, views: int) -> int:
    """How many cells of this view ask in the rotations near the source."""
    waiting = 0
    for n in range(near.turn.shape[1]):
        w = near.turn[source, n] * views + view
        waiting += asked.start[w + 1] - asked.start[w]
    return waiting


@compiled
def _gather(asked: Asked, near: Near, source: int, view: int, views: int, table: Table, found: np.ndarray) -> None:
    """In and out: found, to which the source's table is added for cells of this view in the rotations near it."""
    around, own = table.near, table.own
    for n in range(near.turn.shape[1]):
        share, w = near.turn_weight[source, n], near.turn[source, n] * views + view
        if share == 0:
            break
        for q in range(asked.start[w], asked.start[w + 1]):
            v = asked.voxel[q]
            successes, particles = found[q, 0] + share * around[v, 0], found[q, 1] + share * around[v, 1]
            found[q, 0], found[q, 1] = successes, particles
            if near.turn[source, n] == source:
                found[q, 2] = own[v]


@compiled
def hand_back(found: np.ndarray, place: np.ndarray, counts: np.ndarray) -> None:
    """Out: the rows `place` (Q,) of counts, from the rows found (Q, 3) of populated cells."""
    for q in range(len(place)):
        if found[q, 2] > 0:
            for column in range(3):
                counts[place[q], column] = found[q, column]
