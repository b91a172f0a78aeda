"""Features that vote for grasps, and which of them voted for which grasp: why a grasp was proposed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
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
    pairs = cell_pairs(voters.T_object_feature, T, index.grid.numbers)
    partition = voters.prototype.index_select(0, pairs[0]) * index.condensed.types
    points = index.find((partition + grasp_type.index_select(0, pairs[1])).int(), pairs[2])
    # From here on in numpy: torch would wake its threads for each of these few thousand numbers.
    (feature, grasp), point = (column.cpu().numpy() for column in pairs[:2]), points.cpu().numpy()
    cast = np.flatnonzero(point != NO_POINT)
    gains = gain.cpu().numpy()[point[cast]]
    order = cast[np.lexsort((-gains, grasp[cast]))]
    feature, point = feature[order], point[order]
    columns = [column[feature] for column in _of_features(voters)]
    columns += [values.cpu().numpy()[point] for values in (gain, index.condensed.probability, index.condensed.support)]
    ends = np.searchsorted(grasp[order], np.arange(len(T) + 1))
    return [records.Voters(*(column[a:b] for column in columns)) for a, b in pairwise(ends.tolist())]


def _of_features(voters: Voters) -> list[np.ndarray]:
    """Texlet, position, normal and prototype of each, as `records.Voters` has them."""
    at = voters.T_object_feature[:, :3, 2:].cpu().numpy().astype(np.float64)
    return [voters.texlet.cpu().numpy(), at[..., 1], at[..., 0], voters.prototype.cpu().numpy()]
