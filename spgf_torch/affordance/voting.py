"""Votes of a novel object's features on its candidate grasps (paper, section 3.4).

Every inferred feature votes, through the shape-grasp particles of its prototype, for the grasps within reach:
a vote is the learned probability and support at the point of the space that holds T_feature_grasp, if it is
significant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.casting import NO_POINT, ROWS, find_points, poll
from spgf_torch.affordance.neighbourhood import Condensed, Counts
from spgf_torch.affordance.pairs import columns_of, numbers_of, poses_of
from spgf_torch.affordance.particles import Points
from spgf_torch.config import GRASP_TYPES
from spgf_torch.geometry.lattice import Lattice
from spgf_torch.threads import in_parts

# Pairs whose votes are looked up together, on an accelerator and on a CPU.
TOGETHER = (1 << 24, 1 << 17)

# On a CPU: grasps polled together, and queries that search side by side.
GRASPS_TOGETHER, QUERIES_TOGETHER = 512, 1024


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

    A dense table would be fastest but holds `lattice.cells` entries a slice. On a CPU the points of a rotation and
    first step of the voxel are found at once, and the cell by a binary search: few, and next to each other in memory.
    Elsewhere all points are searched, in the order of the queries, so that neighbours in memory are asked for together.
    """

    def __init__(self, condensed: Condensed, lattice: Lattice) -> None:
        self.condensed, self.lattice = condensed, lattice

    @property
    def rows(self) -> int:
        """Rows of `side` * `side` cells in a slice."""
        return self.lattice.rotations * self.lattice.side

    @cached_property
    def start(self) -> Tensor:
        """(S * rows + 1,) int32: points of row r in slice s are start[s * rows + r] : start[s * rows + r + 1]."""
        slices, cell = self.condensed.slice_start.tolist(), self.condensed.cell
        first = torch.arange(self.rows, device=cell.device, dtype=cell.dtype) * self.lattice.side**2
        starts = [a + torch.searchsorted(cell[a:b], first, out_int32=True) for a, b in pairwise(slices)]
        return torch.cat([*starts, self.condensed.slice_start[-1:].int()])

    @cached_property
    def key(self) -> Tensor:
        """(P,) int64: slice and cell of each point in one number, ascending."""
        return self.condensed.slice_of_point() * self.lattice.cells + self.condensed.cell

    def find(self, slice_: Tensor, cell: Tensor) -> Tensor:
        """Point of each (slice, cell), (P,) int32 each -> (P,) int64; NO_POINT where support was too small."""
        if slice_.device.type != "cpu":
            return self.searched(slice_, cell)
        point, points = torch.empty(len(cell), dtype=torch.int64), (self.start.numpy(), self.condensed.cell.numpy())
        numbers = np.empty((2, QUERIES_TOGETHER), np.int64)
        find_points(*points, self.rows, self.lattice.side, slice_.numpy(), cell.numpy(), numbers, point.numpy())
        return point

    def searched(self, slice_: Tensor, cell: Tensor) -> Tensor:
        """The same by torch's operations."""
        if len(self.key) == 0:
            return torch.full_like(cell, NO_POINT, dtype=torch.int64)
        ascending, order = (slice_.long() * self.lattice.cells + cell).sort()
        at = torch.searchsorted(self.key, ascending).clamp_(max=len(self.key) - 1)
        found = torch.where(self.key.index_select(0, at) == ascending, at, NO_POINT)
        return torch.empty_like(found).scatter_(0, order, found)


def cast_votes(index: VotingIndex, points: Points, grasp: Tensor) -> Votes:
    """Votes at the points (P,) of feature-grasp pairs through a condensed model; grasp (P,) of each pair."""
    condensed = index.condensed

    def cast(part: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        slice_, cell, voted_on = part
        point = index.find(slice_, cell)
        found = (point != NO_POINT).nonzero()[:, 0]
        point = point.index_select(0, found)
        learned = (column.index_select(0, point) for column in (condensed.probability, condensed.support))
        prototype = slice_.index_select(0, found) // len(GRASP_TYPES)
        return voted_on.index_select(0, found).long(), prototype.long(), *learned

    parts = zip(
        *(c.split(TOGETHER[grasp.device.type == "cpu"]) for c in (points.slice, points.cell, grasp)), strict=True
    )
    return Votes(*(torch.cat(column) for column in zip(*in_parts(cast, parts), strict=True)))


@dataclass(frozen=True)
class Poll:
    """The votes on each grasp: how many (G,) int64, and what they are worth in all (G,) f32."""

    votes: Tensor
    worth: Tensor


def polled(
    index: VotingIndex, worth: Tensor, T_object_feature: Tensor, ids: Tensor, T_object_grasp: Tensor, kind: Tensor
) -> Poll:
    """The votes of features (F, 4, 4) of prototypes ids (F,) on grasps (G, 4, 4) of types kind (G,), on the CPU.

    As pairs and their votes say, but none of these is listed. worth (P,) f32: of a vote that finds the point.
    """
    order = torch.argsort(ids, stable=True)  # of one prototype after the other: their points stay in the cache
    features, slice_ = poses_of(T_object_feature[order]), (ids[order].long() * len(GRASP_TYPES)).numpy()
    grasps, of_type = columns_of(T_object_grasp), kind.long().numpy()
    reach, voxel, side, edges = numbers_of(index.lattice)
    points, sums = (index.start.numpy(), index.condensed.cell.numpy()), np.zeros((2, len(of_type)))

    def work(first: int) -> None:
        part = slice(first, first + GRASPS_TOGETHER)
        position, quaternion = (np.ascontiguousarray(column[:, part]) for column in grasps)
        asked, size = (position, quaternion, of_type[part]), position.shape[1]
        memory, found = (np.empty((ROWS, size)), np.empty(size, np.int32)), np.zeros((2, size))
        numbers, rows, worths = np.empty((4, size), np.int64), index.rows, worth.numpy()
        poll(*features, slice_, *asked, reach, voxel, side, edges, *memory, *points, rows, worths, numbers, found)
        sums[:, part] = found

    list(in_parts(work, range(0, len(of_type), GRASPS_TOGETHER)))
    votes, total = torch.from_numpy(sums)
    return Poll(votes.long(), total.float())


def counted_votes(counts: Counts, points: Points, grasp: Tensor, min_support: float) -> Votes:
    """The same votes straight from a neighbourhood analysis at the points, without condensing the space."""
    cast = ((counts.here > 0) & (counts.particles >= min_support)).nonzero()[:, 0]
    support = counts.particles[cast]
    probability = (counts.successes[cast] / support.clamp(min=torch.finfo(support.dtype).tiny)).clamp(max=1)
    return Votes(grasp[cast].long(), points.prototype[cast].long(), probability, support)
