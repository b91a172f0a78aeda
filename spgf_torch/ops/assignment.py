"""Assignment of features to prototypes: which centre is nearest to each point (paper, sections 3.2 and 3.3).

`points` (N, D) and `centres` (K, D) are of one floating type. Distances are |x|^2 - 2 x.c + |c|^2, off by about
1e-6 (|x|^2 + |c|^2), and go in chunks of points.
"""

from __future__ import annotations

import torch
from torch import Tensor

from spgf_torch.ops.registration import operator

# Distances in memory at once; 4 MB of float32.
CHUNK = 1 << 20


@operator("assign(Tensor points, Tensor centres) -> Tensor")
def assign(points: Tensor, centres: Tensor) -> Tensor:
    """(N,) int64: the nearest centre of each point, of equals the first."""
    return torch.cat([relative_distances(part, centres).argmin(1) for part in chunks(points, len(centres))])


@assign.fake
def _assign_shapes(points: Tensor, centres: Tensor) -> Tensor:
    return points.new_empty(points.shape[0], dtype=torch.int64)


def relative_distances(points: Tensor, centres: Tensor) -> Tensor:
    """(N, K) squared distances less |x|^2, which does not change which centre is nearest."""
    return torch.addmm(centres.square().sum(1), points, centres.T, alpha=-2)


def chunks(rows: Tensor, num_clusters: int) -> tuple[Tensor, ...]:
    """The rows in parts (one empty part of no rows) whose distances to the centres fit in `CHUNK`."""
    parts: tuple[Tensor, ...] = rows.split(max(1, CHUNK // num_clusters))
    return parts
