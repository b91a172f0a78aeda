"""The loops of pairing and voting on the CPU, compiled.

A feature meets all grasps at once, in short loops over arrays that the processor's vector units can take; grasps come
as columns. All poses are float64: what falls into which cell is then as the rounding of the poses themselves has it.
"""

from __future__ import annotations

import numpy as np

from spgf_torch.compiled import compiled

NO_POINT = -1
ROWS = 5  # of working memory, each of one number a grasp


@compiled
def _place(
    T: np.ndarray, i: int, position: np.ndarray, reach: float, voxel: float, side: int, place: np.ndarray
) -> None:
    """place (G,) f64: `Lattice.voxel_index` of each position (3, G) in the frame of T[i]; -1 beyond reach."""
    r00, r01, r02, r10, r11, r12 = T[i, 0, 0], T[i, 0, 1], T[i, 0, 2], T[i, 1, 0], T[i, 1, 1], T[i, 1, 2]
    r20, r21, r22, tx, ty, tz = T[i, 2, 0], T[i, 2, 1], T[i, 2, 2], T[i, 0, 3], T[i, 1, 3], T[i, 2, 3]
    scale, half, last = 1.0 / voxel, side / 2.0, side - 2.0
    for j in range(len(place)):
        x, y, z = position[0, j] - tx, position[1, j] - ty, position[2, j] - tz
        u = min(max(np.floor((r00 * x + r10 * y + r20 * z) * scale + half), 1.0), last)
        v = min(max(np.floor((r01 * x + r11 * y + r21 * z) * scale + half), 1.0), last)
        w = min(max(np.floor((r02 * x + r12 * y + r22 * z) * scale + half), 1.0), last)
        place[j] = (u * side + v) * side + w if x * x + y * y + z * z <= reach * reach else -1.0


@compiled
def _turn(
    feature: np.ndarray,
    i: int,
    grasp: np.ndarray,
    chart: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    third: np.ndarray,
) -> None:
    """Chart (G,) of the rotation from feature[i] to each grasp (4, G), and the other three components over its own."""
    a0, a1, a2, a3 = feature[i, 0], feature[i, 1], feature[i, 2], feature[i, 3]
    for j in range(len(chart)):
        b0, b1, b2, b3 = grasp[0, j], grasp[1, j], grasp[2, j], grasp[3, j]
        q0 = a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3  # conjugate(a) * b
        q1 = a0 * b1 - a1 * b0 - a2 * b3 + a3 * b2
        q2 = a0 * b2 + a1 * b3 - a2 * b0 - a3 * b1
        q3 = a0 * b3 - a1 * b2 + a2 * b1 - a3 * b0
        largest = max(max(abs(q0), abs(q1)), max(abs(q2), abs(q3)))
        is0, is1, is2 = abs(q0) == largest, abs(q1) == largest, abs(q2) == largest
        chart[j] = 0.0 if is0 else (1.0 if is1 else (2.0 if is2 else 3.0))
        scale = 1.0 / (q0 if is0 else (q1 if is1 else (q2 if is2 else q3)))
        first[j] = (q1 if is0 else q0) * scale
        second[j] = (q2 if is0 or is1 else q1) * scale
        third[j] = (q3 if is0 or is1 or is2 else q2) * scale


@compiled
def _sector(ratio: np.ndarray, edges: np.ndarray, rotation: np.ndarray) -> None:
    """One more digit of the rotation cells: how many edges lie below each ratio."""
    for j in range(len(ratio)):
        rotation[j] *= len(edges) + 1.0
    for edge in edges:
        for j in range(len(ratio)):
            rotation[j] += 1.0 if ratio[j] >= edge else 0.0


@compiled
def _cells(
    T: np.ndarray,
    quaternion: np.ndarray,
    i: int,
    position: np.ndarray,
    grasp: np.ndarray,
    reach: float,
    voxel: float,
    side: int,
    edges: np.ndarray,
    memory: np.ndarray,
    cell: np.ndarray,
) -> None:
    """cell (G,) int32: `Lattice.index` of inverse(T[i]) @ each grasp; -1 beyond reach."""
    place, rotation, first, second, third = memory[0], memory[1], memory[2], memory[3], memory[4]
    _place(T, i, position, reach, voxel, side, place)
    _turn(quaternion, i, grasp, rotation, first, second, third)
    _sector(first, edges, rotation)
    _sector(second, edges, rotation)
    _sector(third, edges, rotation)
    voxels = float(side * side * side)
    for j in range(len(cell)):
        cell[j] = np.int32(rotation[j] * voxels + place[j]) if place[j] >= 0 else np.int32(-1)


@compiled
def count_within(T: np.ndarray, position: np.ndarray, reach: float, counts: np.ndarray) -> None:
    """counts (F,) int64 of the positions (3, G) within reach of each of T (F, 4, 4)."""
    for i in range(len(T)):
        near = 0
        for j in range(position.shape[1]):
            x, y, z = position[0, j] - T[i, 0, 3], position[1, j] - T[i, 1, 3], position[2, j] - T[i, 2, 3]
            near += x * x + y * y + z * z <= reach * reach
        counts[i] = near


@compiled
def list_pairs(
    T: np.ndarray,
    quaternion: np.ndarray,
    position: np.ndarray,
    grasp_quaternion: np.ndarray,
    reach: float,
    voxel: float,
    side: int,
    edges: np.ndarray,
    memory: np.ndarray,
    row: np.ndarray,
    number: int,
    feature: np.ndarray,
    grasp: np.ndarray,
    cell: np.ndarray,
) -> None:
    """Pairs within reach, by feature (the first of which has this number), then grasp: (P,) int32 each.

    memory (ROWS, G) f64, row (G,) int32: to work in.
    """
    n = 0
    for i in range(len(T)):
        _cells(T, quaternion, i, position, grasp_quaternion, reach, voxel, side, edges, memory, row)
        for j in range(len(row)):
            if row[j] >= 0:
                feature[n], grasp[n], cell[n] = number + i, j, row[j]
                n += 1


@compiled
def _search(
    start: np.ndarray, points: np.ndarray, row: np.ndarray, cell: np.ndarray, low: np.ndarray, left: np.ndarray
) -> None:
    """low (Q,) int64: the point of each cell (Q,) among points[start[row] : start[row + 1]]; NO_POINT without one.

    All take each step of their binary searches together: no load from memory waits for another's. left (Q,) int64 is
    written over.
    """
    most = 0
    for k in range(len(row)):
        low[k] = start[row[k]]
        left[k] = start[row[k] + 1] - start[row[k]]
        most = max(most, left[k])
    while most > 1:
        for k in range(len(row)):
            half = left[k] >> 1
            low[k] += half * (points[max(low[k] + half - 1, 0)] < cell[k])
            left[k] -= half
        most -= most >> 1
    for k in range(len(row)):
        if left[k] == 0 or points[low[k]] != cell[k]:
            low[k] = NO_POINT


@compiled
def find_points(
    start: np.ndarray,
    points: np.ndarray,
    rows: int,
    side: int,
    slice_: np.ndarray,
    cell: np.ndarray,
    numbers: np.ndarray,
    point: np.ndarray,
) -> None:
    """point (P,) int64 of each slice and cell (P,); NO_POINT where there is none.

    points (N,) int32: cells; start (S * rows + 1,) int32: where those of each row of side * side cells begin;
    numbers (2, Q) int64: to work in, on Q queries at a time.
    """
    together = numbers.shape[1]
    for first in range(0, len(cell), together):
        part = slice(first, min(first + together, len(cell)))
        row, left = numbers[0, : part.stop - first], numbers[1, : part.stop - first]
        for k in range(len(row)):
            row[k] = slice_[first + k] * rows + cell[first + k] // (side * side)
        _search(start, points, row, cell[part], point[part], left)


@compiled
def poll(
    T: np.ndarray,
    quaternion: np.ndarray,
    slice_: np.ndarray,
    position: np.ndarray,
    grasp_quaternion: np.ndarray,
    grasp_type: np.ndarray,
    reach: float,
    voxel: float,
    side: int,
    edges: np.ndarray,
    memory: np.ndarray,
    cell: np.ndarray,
    start: np.ndarray,
    points: np.ndarray,
    rows: int,
    worth: np.ndarray,
    numbers: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Add to sums (2, G) f64: how many votes of features each grasp gets, and what they are worth (N,) f32 in all.

    slice_ (F,) int64: of the feature's prototype with grasp type 0; grasp_type (G,) int64. start and points as in
    `find_points`; memory (ROWS, G) f64, cell (G,) int32, numbers (4, G) int64: to work in.
    """
    for i in range(len(T)):
        _cells(T, quaternion, i, position, grasp_quaternion, reach, voxel, side, edges, memory, cell)
        n = 0
        for j in range(len(cell)):
            if cell[j] >= 0:
                numbers[0, n] = j
                numbers[1, n] = (slice_[i] + grasp_type[j]) * rows + cell[j] // (side * side)
                cell[n] = cell[j]
                n += 1
        point = numbers[2, :n]
        _search(start, points, numbers[1, :n], cell[:n], point, numbers[3, :n])
        for k in range(n):
            if point[k] >= 0:
                sums[0, numbers[0, k]] += 1
                sums[1, numbers[0, k]] += worth[point[k]]
