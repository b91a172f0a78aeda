"""Features that vote for grasps, and which of them voted for which grasp: why a grasp was proposed."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.voting import VotingIndex
from spgf_torch.hands import records
from spgf_torch.ops.cell_pairs import cell_pairs
from spgf_torch.ops.look_up_points import NO_POINT


@dataclass(frozen=True)
class Voters:
    """Features that vote, in farthest-point order.

    Attributes:
        T_object_feature: (V, 4, 4). prototype: (V,) int64. texlet: (V,) int64, index of the texlet that each describes.
    """

    T_object_feature: Tensor
    prototype: Tensor
    texlet: Tensor

    def __len__(self) -> int:
        return len(self.prototype)

    def first(self, n: int) -> Voters:
        """Return the first n, which cover the surface too."""
        return Voters(self.T_object_feature[:n], self.prototype[:n], self.texlet[:n])


def voters_of_each(
    index: VotingIndex, gain: Tensor, voters: Voters, T: Tensor, grasp_type: Tensor
) -> list[records.Voters]:
    """Of each grasp T (G, 4, 4) of type (G,) the voters that `voting.vote_totals` counts, what they gain most first.

    gain: (P,) f32 of each point of the index, `ranking.point_gains`.
    """
    feature, grasp, cell = cell_pairs(voters.T_object_feature, T, index.grid.numbers)
    types, learned = index.condensed.types, index.condensed
    prototype = voters.prototype[feature]
    point = index.find((prototype * types + grasp_type[grasp]).int(), cell)
    cast = (point != NO_POINT).nonzero()[:, 0]
    feature, grasp, point = feature[cast], grasp[cast], point[cast]
    order = torch.argsort(gain[point], descending=True, stable=True)
    order = order[torch.argsort(grasp[order], stable=True)]
    feature, point = feature[order], point[order]
    at = voters.T_object_feature[feature].double()
    columns = (
        *(voters.texlet[feature], at[:, :3, 3], at[:, :3, 2], voters.prototype[feature]),
        *(values[point] for values in (gain, learned.probability, learned.support)),
    )
    counts = torch.bincount(grasp, minlength=len(T)).tolist()
    parts = zip(*(column.cpu().split(counts) for column in columns), strict=True)
    return [records.Voters(*(part.numpy() for part in its)) for its in parts]
