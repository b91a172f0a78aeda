"""How far what lies between planes reaches: points about hands -> least and greatest x between pairs of planes."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.registration import memory, operator


@operator("extents(Tensor at, Tensor edges, Tensor first, Tensor last) -> (Tensor, Tensor, Tensor)")
def extents(at: Tensor, edges: Tensor, first: Tensor, last: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Least and greatest x (F, D) f32, and number (F, D) int64, of the points at (F, 3, N) between each pair of planes.

    Those with |x - edges[0]| below edges[1], |y| below edges[2], and z between first[k] and last[k] (D,). Infinite of
    none.
    """
    x, y, z = at.unbind(1)
    beside = (y.abs() < edges[2]) & ((x - edges[0]).abs() < edges[1])
    each = []
    for low, high in zip(first, last, strict=True):
        within = beside & (z > low) & (z < high)
        least = torch.where(within, x, torch.inf).amin(1) if x.shape[1] else x.new_full((len(x),), torch.inf)
        most = torch.where(within, x, -torch.inf).amax(1) if x.shape[1] else x.new_full((len(x),), -torch.inf)
        each.append((least, most, within.sum(1)))
    least, most, count = (torch.stack(part, dim=1) for part in zip(*each, strict=True))
    return least, most, count


@extents.on_cpu
def _in_loops(at: Tensor, edges: Tensor, first: Tensor, last: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    low = torch.full((len(at), len(first)), torch.inf)
    high, count = torch.full_like(low, -torch.inf), torch.zeros(low.shape, dtype=torch.int64)
    planes = memory(edges), memory(first), memory(last)
    _extend(memory(at), *planes, low.numpy(), high.numpy(), count.numpy())
    return low, high, count


@extents.fake
def _shapes(at: Tensor, edges: Tensor, first: Tensor, last: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    low = at.new_empty(at.shape[0], first.shape[0])
    return low, torch.empty_like(low), torch.empty_like(low, dtype=torch.int64)


@compiled
def _extend(
    at: np.ndarray,
    edges: np.ndarray,
    first: np.ndarray,
    last: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    count: np.ndarray,
) -> None:
    """Lower low (F, D), raise high, and count."""
    on = np.empty(at.shape[2], np.int64)
    for f in range(len(at)):
        x, y, z = at[f, 0], at[f, 1], at[f, 2]
        between = 0
        for i in range(len(x)):  # without a branch, which would be guessed wrong half of the time
            on[between] = i
            between += (abs(y[i]) < edges[2]) & (abs(x[i] - edges[0]) < edges[1])
        for i in on[:between]:
            for k in range(len(first)):
                if z[i] > first[k] and z[i] < last[k]:
                    low[f, k], high[f, k] = min(low[f, k], x[i]), max(high[f, k], x[i])
                    count[f, k] += 1
