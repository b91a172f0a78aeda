"""What lies between the pads of hands: points about hands -> numbers of each hand."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.registration import memory, operator

# Numbers of a hand.
COUNT = 11


@operator("pad_numbers(Tensor at, Tensor cosine, Tensor limits) -> Tensor")
def pad_numbers(at: Tensor, cosine: Tensor, limits: Tensor) -> Tensor:
    """(G, 11) f32 of points at (G, 3, N), m, in the frames of hands, of normals whose cosine with x is (G, N).

    Log of one more than how many lie in the closing region (none: all but the last number are 0); how far they reach
    along x, by its width; how far the middle of that is from the region's; their mean z. Of the points of either side,
    not deeper than a pad, the lesser and the greater share within the friction cone, and mean cosine with the side.
    Whether both sides have points that face them, log of one more than how many the lesser has. How far the fingers
    reach beyond the first point before them.

    Args:
        limits: (9,) f32 half, height, low, high and middle of the closing region; m behind the TCP that the fingers
            reach; m of a pad's depth; the cosine of the friction cone's edge; that from which on a normal faces a pad.
    """
    half, height, low, high, middle, behind, depth, edge, facing = limits
    x, y, z = at.unbind(1)
    before = (y.abs() < height) & ((x - middle).abs() < half) & (z < high)
    on = before & (z > low)
    count = on.sum(1)
    left, right = _least(torch.where(on, x, torch.inf)), -_least(torch.where(on, -x, torch.inf))
    reach = high - torch.minimum(_least(torch.where(before & (z > -behind), z, torch.inf)), high)
    sides, both = [], []
    for sign, extreme in ((1, right), (-1, -left)):
        towards = sign * cosine
        members = on & (sign * x > (extreme - depth).unsqueeze(1))
        within = ((towards - edge) / (1 - edge)).clamp(0, 1)
        sides.append([_sum(part, members) / members.sum(1) for part in (within, towards)])
        both.append((on & (towards > facing)).sum(1))
    fewest = torch.minimum(*both).double()
    (within, cosines) = (torch.stack(part).float() for part in zip(*sides, strict=True))
    numbers = (
        count.double().log1p(),
        (right - left) / (2 * half),
        ((right + left) / 2 - middle).abs(),
        _sum(z, on) / count,
        *(part for each in (within, cosines) for part in (each.amin(0), each.amax(0))),
        fewest > 0,
        fewest.log1p(),
    )
    found = torch.stack([number.float() for number in numbers], dim=1)
    return torch.cat([torch.where(count.unsqueeze(1) > 0, found, 0.0), reach.unsqueeze(1)], dim=1)


def _least(of: Tensor) -> Tensor:
    """(G,) least of (G, N); infinite of none."""
    return of.amin(1) if of.shape[1] else of.new_full((len(of),), torch.inf)


def _sum(of: Tensor, where: Tensor) -> Tensor:
    """(G,) f64 sum of (G, N) f32 where it is asked for, one after the other."""
    each = torch.where(where, of, 0.0).double()
    return each.cumsum(1)[:, -1] if each.shape[1] else each.sum(1)


@pad_numbers.on_cpu
def _in_loops(at: Tensor, cosine: Tensor, limits: Tensor) -> Tensor:
    numbers = np.zeros((len(at), COUNT), np.float32)
    _measure(memory(at), memory(cosine), memory(limits), numbers)
    return torch.from_numpy(numbers)


@pad_numbers.fake
def _shapes(at: Tensor, cosine: Tensor, limits: Tensor) -> Tensor:
    return at.new_empty(at.shape[0], COUNT)


@compiled
def _measure(at: np.ndarray, cosine: np.ndarray, limits: np.ndarray, numbers: np.ndarray) -> None:
    """Out: numbers (G, 11), from zeros."""
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
