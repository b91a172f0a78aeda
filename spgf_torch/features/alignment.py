"""Alignment of the grid to the direction of highest curvature (paper, section 3.1.2, Fig. 5).

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

import torch
from torch import Tensor

# rad; curvatures this close are equal: well above float32 rounding (1e-6), well below the noise of a normal (0.05).
TIE = 1e-4


def highest_curvature(rings: Tensor) -> Tensor:
    """The start cell (N,) int64 of rings (2, N, 2, cells) as `grid` makes them."""
    curvature = rings[1, :, 0]  # alpha2 of the top layer
    highest, start = curvature.max(dim=1)
    tied = curvature >= highest[:, None] - TIE
    several = (tied.sum(dim=1) > 1).nonzero().flatten()
    start[several] = widest_run(tied[several], content_after(rings[:, several]))
    return start


def widest_run(tied: Tensor, content: Tensor) -> Tensor:
    """The centre (N,) of the widest run of True in tied (N, cells); of equal runs that of the highest content."""
    cells = tied.shape[1]
    length = run_lengths(tied)
    widest = length.amax(dim=1, keepdim=True)
    to_centre = (widest - 1) // 2
    at_centre = content.gather(1, (torch.arange(cells, device=tied.device) + to_centre) % cells)
    at_centre = at_centre.masked_fill(length < widest, -math.inf)
    first = (at_centre >= at_centre.amax(dim=1, keepdim=True) - TIE).int().argmax(dim=1, keepdim=True)
    return ((first + to_centre) % cells).squeeze(1)


def run_lengths(tied: Tensor) -> Tensor:
    """At the first cell of each run of True around the rings (N, cells) its length, elsewhere 0.

    A ring that is True all round has no first cell: each cell is one, with the length of the ring.
    """
    cells = tied.shape[1]
    ahead, step = tied.int(), 1  # tied cells from each cell on, counted up to `step`, which doubles
    while step < cells:
        ahead = ahead + (ahead == step) * ahead.roll(-step, dims=1)
        step *= 2
    first = tied & (~tied.roll(1, dims=1) | tied.all(dim=1, keepdim=True))
    return ahead.clamp(max=cells) * first


def content_after(rings: Tensor) -> Tensor:
    """What follows each cell going round, near cells most: (N, cells)."""
    cells = rings.shape[-1]
    k = torch.arange(cells, device=rings.device)
    ahead = (k[:, None] - k) % cells
    content = rings[0, :, 0] + rings[0, :, 1] + rings[1, :, 0] + rings[1, :, 1]
    return content @ torch.exp(ahead.to(rings.dtype) * (-2 * math.pi / cells))


def start_at(rings: Tensor, start: Tensor) -> Tensor:
    """The rings (2, N, 2, cells) moved round so that cell `start` (N,) becomes cell 0 of both: (N, 2, cells, 2)."""
    _, N, layers, cells = rings.shape
    k = torch.arange(cells, device=rings.device)
    source = ((k + k[:, None]) % cells).index_select(0, start)  # (N, cells)
    ring = torch.arange(N * layers, device=rings.device).view(N, layers, 1) * cells
    both = torch.complex(rings[0], rings[1]).flatten()  # scattered memory is bound by accesses: two angles in each
    return torch.view_as_real(both.index_select(0, (ring + source[:, None]).flatten())).view(N, layers, cells, 2)
