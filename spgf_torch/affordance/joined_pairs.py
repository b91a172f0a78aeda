"""Pairs of one object's features and grasps that were seen in several clouds, each with a frame of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from spgf_torch.affordance.pairs import CellPairs, Pairs


@dataclass(frozen=True)
class JoinedPairs:
    """The pairs of each cloud, numbered one cloud after the other: no feature is paired with another cloud's grasps.

    Attributes:
        parts: of each cloud. features: of each cloud how many there are.
    """

    parts: Sequence[Pairs]
    features: Sequence[int]

    @cached_property
    def grasp_type(self) -> Tensor:
        """As `Pairs` has it."""
        return torch.cat([part.grasp_type for part in self.parts])

    def of_grasps(self, chosen: Tensor) -> JoinedPairs:
        """As `Pairs` has it; `chosen` ascending."""
        parts, first = [], 0
        for part in self.parts:
            end = first + len(part.grasp_type)
            parts.append(part.of_grasps(chosen[(chosen >= first) & (chosen < end)] - first))
            first = end
        return JoinedPairs(parts, self.features)

    def listed(self, wanted: Tensor | None = None) -> CellPairs:
        """As `Pairs` has it."""
        asked = [None] * len(self.parts) if wanted is None else wanted.split(list(self.features))
        columns, feature, grasp = [], 0, 0
        for part, which, features in zip(self.parts, asked, self.features, strict=True):
            its = part.listed(which)
            columns.append((its.feature + feature, its.grasp + grasp, its.cell))
            feature, grasp = feature + features, grasp + len(part.grasp_type)
        joined = [torch.cat(column) for column in zip(*columns, strict=True)]
        return CellPairs(joined[0], joined[1], joined[2], self.grasp_type)

    def most(self, features: int) -> Tensor:
        """As `Pairs` has it."""
        return torch.cat([part.most(its) for part, its in zip(self.parts, self.features, strict=True)])
