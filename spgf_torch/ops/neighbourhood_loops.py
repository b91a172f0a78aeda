"""The loops of the neighbourhood analysis, compiled: particles of a partition in, kernel-weighted counts at cells out.

One rotation after the other, its particles are smoothed in translation into a table of that rotation's voxels, which
stays in the processor's second-level cache; then every cell that asks in a rotation near it adds what the table holds
at its own voxel. Tables hold sums of float32 weights times whole numbers in float64: exact, so that none depends on the
order of particles. Sums over rotations are float32, in the order of the rotations.

A cell is rotation * voxels + voxel; particles carry the key cell * 2 + success.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spgf_torch.compiled import compiled, lean


class Populated(NamedTuple):
    """Populated cells of a partition: those of rotation r are start[r] : start[r + 1].

    start (rotations + 1,) int64, voxel (N,) int32, counts (N, 2) f32: successes and particles.
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
    """Cells that ask: those of rotation r are start[r] : start[r + 1].

    start (rotations + 1,) int64, voxel (Q,) int32.
    """

    start: np.ndarray
    voxel: np.ndarray


class Table(NamedTuple):
    """Of a rotation: successes and particles about each voxel, weighted (voxels, 2) f64, and particles in it, f32."""

    near: np.ndarray
    own: np.ndarray


@lean
def outcomes(partition: np.ndarray, success: np.ndarray, counts: np.ndarray) -> None:
    """In and out: counts (S, 2) int64, to which the failures and successes in each partition are added."""
    for i in range(len(partition)):
        counts[partition[i], int(success[i])] += 1


@lean
def into_partitions(
    partition: np.ndarray, cell: np.ndarray, success: np.ndarray, at: np.ndarray, key: np.ndarray
) -> None:
    """Out: key, of particles, those of partition s from key[at[s]] on. In and out: at (S,) int64 moves on."""
    for i in range(len(partition)):
        s = partition[i]
        key[at[s]] = np.int64(cell[i]) * 2 + success[i]
        at[s] += 1


@lean
def populated(key: np.ndarray, voxels: int, start: np.ndarray, voxel: np.ndarray, counts: np.ndarray) -> None:
    """Out: `Populated` from the sorted keys (N,) of a partition; start and counts hold 0 before."""
    i, n, last = 0, -1, np.int64(-1)
    for rotation in range(len(start) - 1):
        first = np.int64(rotation) * voxels
        while i < len(key) and key[i] >> 1 < first + voxels:
            run = np.int64(key[i] >> 1)
            n += run != last  # no branch: whether the next particle is in the same voxel cannot be foreseen
            voxel[n] = run - first
            counts[n, 0] += key[i] & 1
            counts[n, 1] += 1
            last = run
            i += 1
        start[rotation + 1] = n + 1


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
def weigh(cells: Populated, near: Near, asked: Asked, voxels: int, found: np.ndarray) -> None:
    """In and out: found (Q, 3) f32, 0 before: weighted successes and particles about the cells asked, and in them."""
    table = Table(np.zeros((voxels, 2)), np.zeros(voxels, np.float32))
    for source in range(len(near.turn)):
        if cells.start[source] < cells.start[source + 1]:
            _splat(cells, source, near, table)
            _gather(asked, near, source, table, found)
            _clear(cells, source, near, table)


@lean
def _splat(cells: Populated, source: int, near: Near, table: Table) -> None:
    """In and out: table, 0 before, to which the particles of the rotation are added."""
    offset, weight, around, own = near.offset, near.weight, table.near, table.own
    for i in range(cells.start[source], cells.start[source + 1]):
        voxel, held, tried = cells.voxel[i], cells.counts[i, 0], cells.counts[i, 1]
        own[voxel] = tried
        for m in range(len(offset)):
            v, w = voxel + offset[m], np.float64(weight[m])
            successes, particles = around[v, 0] + w * held, around[v, 1] + w * tried
            around[v, 0], around[v, 1] = successes, particles


@lean
def _clear(cells: Populated, source: int, near: Near, table: Table) -> None:
    """In and out: table, 0 where the particles of the rotation had been added."""
    for i in range(cells.start[source], cells.start[source + 1]):
        voxel = cells.voxel[i]
        table.own[voxel] = 0.0
        for m in range(len(near.offset)):
            v = voxel + near.offset[m]
            table.near[v, 0], table.near[v, 1] = 0.0, 0.0


@lean
def _gather(asked: Asked, near: Near, source: int, table: Table, found: np.ndarray) -> None:
    """In and out: found, to which the source's table is added for cells that ask in the rotations near it."""
    around, own = table.near, table.own
    for n in range(near.turn.shape[1]):
        share, rotation = near.turn_weight[source, n], near.turn[source, n]
        if share == 0:
            break
        for q in range(asked.start[rotation], asked.start[rotation + 1]):
            v = asked.voxel[q]
            successes, particles = found[q, 0] + share * around[v, 0], found[q, 1] + share * around[v, 1]
            found[q, 0], found[q, 1] = successes, particles
            if rotation == source:
                found[q, 2] = own[v]


@lean
def hand_back(found: np.ndarray, place: np.ndarray, counts: np.ndarray) -> None:
    """Out: the rows `place` (Q,) of counts, from the rows found (Q, 3) of populated cells."""
    for q in range(len(place)):
        if found[q, 2] > 0:
            for column in range(3):
                counts[place[q], column] = found[q, column]
