"""Compiled loops over the points about open hands: what is near their pieces, and what lies between their pads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from spgf_torch.compiled import compiled

Floats = NDArray[np.float32]
Ids = NDArray[np.int64]


@compiled
def nearest_piece(at: Floats, normals: Floats, offsets: Floats, least: Floats) -> None:
    """Lower `least` (G,) to the least signed distance of pieces to points at (G, 3, N).

    A piece has faces normals (P, F, 3), offsets (P, F, 1); the distance to it is that to the plane of the farthest.
    """
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


@compiled
def pad_numbers(at: Floats, cosine: Floats, limits: Floats, numbers: Floats) -> None:
    """Into numbers (G, 11): `judge_features.PADS` and reach, of points at (G, 3, N) of cosines (G, N) with x.

    limits (9,): half, height, low, high and middle of the closing region; m behind the TCP that the fingers reach; m of
    a pad's depth; the cosine of the friction cone's edge; the cosine from which on a normal faces a pad.
    """
    half, height, low, high, middle = limits[0], limits[1], limits[2], limits[3], limits[4]
    behind, depth, edge, facing = limits[5], limits[6], limits[7], limits[8]
    on = np.empty(at.shape[2], np.int64)
    for g in range(len(at)):
        x, y, z = at[g, 0], at[g, 1], at[g, 2]
        nearest, count, left, right, total = high, 0, np.float32(np.inf), np.float32(-np.inf), 0.0
        for i in range(len(x)):
            if abs(y[i]) < height and abs(x[i] - middle) < half and z[i] < high and z[i] > -behind:
                nearest = min(nearest, z[i])
            if abs(y[i]) < height and abs(x[i] - middle) < half and z[i] < high and z[i] > low:
                on[count] = i
                count += 1
                left, right, total = min(left, x[i]), max(right, x[i]), total + z[i]
        for k in range(10):
            numbers[g, k] = 0
        numbers[g, 10] = high - nearest
        if count == 0:
            continue
        fewest = count
        for side in range(2):
            sign, edge_of = np.float32(1 - 2 * side), (right if side == 0 else -left) - depth
            within, cosines, members, both = 0.0, 0.0, 0, 0
            for k in range(count):
                towards = sign * cosine[g, on[k]]
                if sign * x[on[k]] > edge_of:
                    members += 1
                    cosines += towards
                    within += min(max((towards - edge) / (np.float32(1) - edge), np.float32(0)), np.float32(1))
                both += towards > facing
            within, cosines, fewest = within / members, cosines / members, min(fewest, both)
            numbers[g, 4 + side], numbers[g, 6 + side] = within, cosines
        for first in (4, 6):  # the lesser of both sides first
            lesser, greater = numbers[g, first], numbers[g, first + 1]
            numbers[g, first], numbers[g, first + 1] = min(lesser, greater), max(lesser, greater)
        numbers[g, 0] = math.log1p(count)
        numbers[g, 1] = (right - left) / (np.float32(2) * half)
        numbers[g, 2] = abs((right + left) / np.float32(2) - middle)
        numbers[g, 3] = total / count
        numbers[g, 8], numbers[g, 9] = fewest > 0, math.log1p(fewest)
