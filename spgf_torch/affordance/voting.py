"""Votes of a novel object's features on its candidate grasps (paper, section 3.4).

Every inferred feature votes, through the shape-grasp particles of its prototype, for the grasps within reach:
a vote is the learned probability and support at the point of the space that holds T_feature_grasp, if it is
significant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.lattice import Lattice
from spgf_torch.affordance.neighbourhood import Condensed, Counts
from spgf_torch.affordance.particles import Points
from spgf_torch.threads import in_parts

NO_POINT = -1

# Pairs whose votes are looked up together, on an accelerator and on a CPU.
TOGETHER = (1 << 24, 1 << 16)


def sorted_with_order(key: Tensor) -> tuple[Tensor, Tensor]:
    """The keys, ascending, and their order; on a CPU by numpy's vectorised sort."""
    order = torch.from_numpy(np.argsort(key.numpy())) if key.device.type == "cpu" else key.argsort()
    return key.index_select(0, order), order


@dataclass(frozen=True)
class Votes:
    """Votes cast on an object's grasps, ordered as the pairs they came from.

    Attributes:
        grasp (V,) int64: the candidate voted on.
        prototype (V,) int64: of the feature that votes.
        probability (V,) f32, support (V,) f32: learned, at the vote's point.
    """

    grasp: Tensor
    prototype: Tensor
    probability: Tensor
    support: Tensor


class VotingIndex:
    """Finds condensed points by slice and cell.

    A dense table of one slice at a time would be fastest but holds `lattice.cells` entries a slice; sorted
    keys with a binary search hold one entry a point and are nearly as fast for sorted queries.
    """

    def __init__(self, condensed: Condensed, lattice: Lattice) -> None:
        self.condensed, self.lattice = condensed, lattice
        self.key = condensed.slice_of_point() * lattice.cells + condensed.cell  # ascending

    def find(self, slice_: Tensor, cell: Tensor) -> Tensor:
        """Point of each (slice, cell), (P,) int64 each -> (P,) int64; NO_POINT where support was too small."""
        if len(self.key) == 0:
            return torch.full_like(cell, NO_POINT)
        query = slice_ * self.lattice.cells + cell
        ascending, order = sorted_with_order(query)  # neighbours in memory are asked for together: twice as fast
        at = torch.searchsorted(self.key, ascending).clamp_(max=len(self.key) - 1)
        found = torch.where(self.key.index_select(0, at) == ascending, at, NO_POINT)
        return torch.empty_like(found).scatter_(0, order, found)


def cast_votes(index: VotingIndex, points: Points, grasp: Tensor) -> Votes:
    """Votes at the points (P,) of feature-grasp pairs through a condensed model; grasp (P,) int64 of each pair."""
    condensed = index.condensed

    def cast(part: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        slice_, cell, prototype, voted_on = part
        point = index.find(slice_.long(), cell.long())
        found = (point != NO_POINT).nonzero()[:, 0]
        point = point.index_select(0, found)
        learned = (column.index_select(0, point) for column in (condensed.probability, condensed.support))
        return voted_on.index_select(0, found), prototype.index_select(0, found).long(), *learned

    columns = (points.slice, points.cell, points.prototype, grasp)
    parts = zip(*(column.split(TOGETHER[grasp.device.type == "cpu"]) for column in columns), strict=True)
    return Votes(*(torch.cat(column) for column in zip(*in_parts(cast, parts), strict=True)))


def counted_votes(counts: Counts, points: Points, grasp: Tensor, min_support: float) -> Votes:
    """The same votes straight from a neighbourhood analysis at the points, without condensing the space."""
    cast = ((counts.here > 0) & (counts.particles >= min_support)).nonzero()[:, 0]
    support = counts.particles[cast]
    probability = (counts.successes[cast] / support.clamp(min=torch.finfo(support.dtype).tiny)).clamp(max=1)
    return Votes(grasp[cast].long(), points.prototype[cast].long(), probability, support)
