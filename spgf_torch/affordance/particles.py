"""Shape-grasp particles: what ties a feature of an object to a grasp on it (paper, section 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Particles:
    """Shape-grasp particles {prototype, 6D transform, outcome, type}.

    Attributes:
        partition (P,) int32: what particles must share to be compared, as one number: prototype * number of types +
            type.
        cell (P,) int32: cell of the SE(3) grid that holds the transform T_feature_grasp.
        types: how many grasp types the hand has.
        success (P,) bool: outcome of the simulated grasp; None of grasps whose outcome is asked for.
    """

    partition: Tensor
    cell: Tensor
    types: int
    success: Tensor | None = None

    @property
    def prototype(self) -> Tensor:
        """(P,) int32: id of a feature's prototype."""
        return self.partition // self.types

    @property
    def grasp_type(self) -> Tensor:
        """(P,) int32: index into the hand's grasp types."""
        return self.partition % self.types


def known_outcomes(success: Tensor | None) -> Tensor:
    """Outcomes (N,) bool that something is learned from. Raises ValueError where there are none: nobody tried."""
    if success is None:
        raise ValueError("success: expected the outcomes of trials, got None")
    return success


def concatenated(parts: Sequence[Particles]) -> Particles:
    """The particles of all parts, in order, without their outcomes."""
    partition, cell = torch.cat([part.partition for part in parts]), torch.cat([part.cell for part in parts])
    return Particles(partition, cell, parts[0].types)
