"""Votes of a novel object's features on its candidate grasps (paper, section 3.4).

Every inferred feature votes, through the condensed particles of its prototype, for the grasps within reach:
a vote is the condensed point of the cell that holds T_feature_grasp, if there is one.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.lattice import Lattice
from spgf_torch.affordance.neighbourhood import Condensed, slice_index

NO_POINT = -1


@dataclass(frozen=True)
class Votes:
    """Votes cast on an object's grasps, ordered as the pairs they came from.

    Attributes:
        grasp (V,) int64: the candidate voted on.
        prototype (V,) int64: of the feature that votes.
        point (V,) int64: index of the condensed point.
    """

    grasp: Tensor
    prototype: Tensor
    point: Tensor


class VotingIndex:
    """Finds condensed points by slice and cell.

    A dense table of one slice at a time would be fastest but holds `lattice.cells` entries a slice; sorted
    keys with a binary search hold one entry a point and are as fast for sorted queries.
    """

    def __init__(self, condensed: Condensed, lattice: Lattice) -> None:
        self.lattice = lattice
        self.key = condensed.slice_of_point() * lattice.cells + condensed.cell  # ascending

    def find(self, slice_: Tensor, cell: Tensor) -> Tensor:
        """Point of each (slice, cell), (P,) int64 each -> (P,) int64; NO_POINT where support was too small."""
        if len(self.key) == 0:
            return torch.full_like(cell, NO_POINT)
        query = slice_ * self.lattice.cells + cell
        found = torch.searchsorted(self.key, query).clamp_(max=len(self.key) - 1)
        return torch.where(self.key[found] == query, found, NO_POINT)


def cast_votes(index: VotingIndex, prototype: Tensor, grasp_type: Tensor, grasp: Tensor, cell: Tensor) -> Votes:
    """Votes of feature-grasp pairs.

    Args:
        prototype (P,), grasp_type (P,), grasp (P,), cell (P,) int64: of each pair.
    """
    point = index.find(slice_index(prototype, grasp_type), cell)
    cast = point != NO_POINT
    return Votes(grasp[cast], prototype[cast], point[cast])
