"""Seed grasps of a learned shape-grasp space: its best points of each prototype and grasp type, far from each other.

They depend on the model alone. Each seed of a prototype, placed at each feature of that prototype, is a hypothesis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.model import GraspModel
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.geometry import se3
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.sampling import non_maximum_suppression


@dataclass(frozen=True)
class GraspSeeds:
    """Promising points, ordered by partition (prototype * number of types + type), then from the best down.

    Attributes:
        start (S + 1,) int64: points of partition s are start[s] : start[s + 1].
        T_feature_grasp (P, 4, 4) f32: at the centres of the points' cells.
        types: how many grasp types there are.
    """

    start: Tensor
    T_feature_grasp: Tensor
    types: int

    def hypotheses(self, T_object_feature: Tensor, prototype: Tensor) -> tuple[Tensor, Tensor]:
        """Place the seeds at features (F, 4, 4) of prototypes (F,) int64: T_object_grasp (H, 4, 4), type (H,) int64.

        Ordered by feature, then type, then seed.
        """
        types = torch.arange(self.types, device=prototype.device)
        partitions = (prototype.unsqueeze(1) * self.types + types).flatten()
        counts = self.start.diff()[partitions]
        which = torch.repeat_interleave(torch.arange(len(partitions), device=prototype.device), counts)  # (H,)
        within = torch.arange(len(which), device=prototype.device) - (counts.cumsum(0) - counts)[which]
        point = self.start[partitions[which]] + within
        T_feature_grasp = self.T_feature_grasp[point].to(T_object_feature.dtype)
        return T_object_feature[which // self.types] @ T_feature_grasp, which % self.types


def grasp_seeds(model: GraspModel, gain: Tensor, config: ProposingConfig, symmetry: Sequence[int]) -> GraspSeeds:
    """Choose points that are better than their type's base rate and well supported.

    Of each partition the `pool` points of the highest gain (P,) f32 (`ranking.point_gains`: shrunk by the support) and
    at least `point_support` particles are merged by non-maximum suppression, and the first `points` stay.
    Where few trials taught a type, so that fewer of its points are, the best supported stand in for them.

    Args:
        symmetry: of each grasp type the turns about the approach that make the same grasp.
    """
    condensed, types = model.condensed, len(symmetry)
    promising = (gain > 0) & (condensed.support >= _least_support(condensed, gain, config, types))
    chosen, counts = [], [0]
    for s in range(len(condensed.partition_start) - 1):
        first, end = condensed.partition_start[s : s + 2].tolist()
        point = first + promising[first:end].nonzero()[:, 0]
        point = point[torch.argsort(gain[point], descending=True, stable=True)[: config.pool]]
        T = se3.pose(*model.grid.centres(condensed.cell[point]))
        limits = config.point_distance, config.point_deg, symmetry[s % types]
        kept = non_maximum_suppression(T, torch.zeros_like(point), gain[point], *limits)
        chosen.append(T[kept[: config.points]])
        counts.append(len(chosen[-1]))
    return GraspSeeds(torch.tensor(counts, device=gain.device).cumsum(0), torch.cat(chosen), types)


def _least_support(condensed: Condensed, gain: Tensor, config: ProposingConfig, types: int) -> Tensor:
    """(P,) f32: particles that a point needs near it, of each type `point_support` or what its best points have."""
    partition = torch.repeat_interleave(
        torch.arange(len(condensed.partition_start) - 1, device=gain.device), condensed.partition_start.diff()
    )
    needed = torch.full_like(condensed.support, config.point_support)
    for grasp_type in range(types):
        of_type = partition % types == grasp_type
        support = condensed.support[of_type & (gain > 0)]
        if len(support) and int((support >= config.point_support).sum()) < config.points:
            needed[of_type] = support.sort(descending=True).values[: config.points].min()
    return needed
