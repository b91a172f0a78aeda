"""Votes of a novel object's features on its candidate grasps (paper, section 3.4).

Every inferred feature votes, through the shape-grasp particles of its prototype, for the grasps within reach:
a vote is the learned probability and support at the point of the space that holds T_feature_grasp, if it is
significant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import torch
from torch import Tensor

from spgf_torch.affordance.neighbourhood import Condensed, Counts
from spgf_torch.affordance.particles import Particles
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.accumulate_votes import Candidates, Voters, accumulate_votes
from spgf_torch.ops.look_up_points import NO_POINT, Table, look_up

__all__ = ["Votes", "VotingIndex", "cast_votes"]


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
    """Finds condensed points by partition and cell.

    A dense table would be fastest but holds `grid.cells` entries a partition.
    """

    def __init__(self, condensed: Condensed, grid: SE3Grid) -> None:
        self.condensed, self.grid = condensed, grid

    @cached_property
    def table(self) -> Table:
        """Where the points of each row of the grid begin, and their cells."""
        partitions, cell = self.condensed.partition_start.tolist(), self.condensed.cell
        first = torch.arange(self.grid.rows, device=cell.device, dtype=cell.dtype) * self.grid.row_size
        starts = [a + torch.searchsorted(cell[a:b], first, out_int32=True) for a, b in pairwise(partitions)]
        return Table(torch.cat([*starts, self.condensed.partition_start[-1:].int()]), cell)

    def find(self, partition: Tensor, cell: Tensor) -> Tensor:
        """Point of each (partition, cell), (P,) int32 each -> (P,) int64; NO_POINT where support was too small."""
        return look_up(self.table, self.grid.rows, self.grid.row_size, partition, cell)


def cast_votes(index: VotingIndex, points: Particles, grasp: Tensor) -> Votes:
    """Votes at the points (P,) of feature-grasp pairs through a condensed model; grasp (P,) of each pair."""
    point = index.find(points.partition, points.cell)
    found = (point != NO_POINT).nonzero()[:, 0]
    point = point.index_select(0, found)
    probability, support = (c.index_select(0, point) for c in (index.condensed.probability, index.condensed.support))
    prototype = points.partition.index_select(0, found) // index.condensed.types
    return Votes(grasp.index_select(0, found).long(), prototype.long(), probability, support)


@dataclass(frozen=True)
class VoteTotals:
    """The votes on each grasp: how many (G,) int64, and the sum (G,) f32 of their gains in log-odds."""

    votes: Tensor
    log_odds_gain: Tensor


def vote_totals(
    index: VotingIndex, gain: Tensor, T_object_feature: Tensor, ids: Tensor, T_object_grasp: Tensor, grasp_type: Tensor
) -> VoteTotals:
    """The votes of features (F, 4, 4) of prototypes ids (F,) on grasps (G, 4, 4) of types (G,).

    As pairs and their votes say, but none of these is listed. gain (P,) f32: of a vote that finds the point
    (`ranking.point_gains`).
    """
    voters = Voters(T_object_feature, ids.long() * index.condensed.types)
    candidates = Candidates(T_object_grasp, grasp_type.long())
    votes, total = accumulate_votes(voters, candidates, index.table, gain, index.grid.numbers)
    return VoteTotals(votes, total.float())


def counted_votes(counts: Counts, points: Particles, grasp: Tensor, min_support: float) -> Votes:
    """The same votes straight from a neighbourhood analysis at the points, without condensing the space."""
    cast = ((counts.own_count > 0) & (counts.particles >= min_support)).nonzero()[:, 0]
    support = counts.particles[cast]
    probability = (counts.successes[cast] / support.clamp(min=torch.finfo(support.dtype).tiny)).clamp(max=1)
    return Votes(grasp[cast].long(), points.prototype[cast].long(), probability, support)
