"""Shape-grasp particles: what ties a feature of an object to a grasp that was tried on it (paper, section 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.geometry import se3
from spgf_torch.hands.config import GRASP_TYPES


@dataclass(frozen=True)
class Pairs:
    """All pairs of one object's features with its grasps that are within reach of each other.

    Attributes:
        feature (P,) int64, grasp (P,) int64: indices into the features and grasps they were made from.
        position (P, 3) f32 m, quaternion (P, 4) f32 wxyz: T_feature_grasp.
    """

    feature: Tensor
    grasp: Tensor
    position: Tensor
    quaternion: Tensor


@dataclass(frozen=True)
class Points:
    """Points of the shape-grasp space.

    Attributes:
        slice (P,) int32: what points must share to be compared, as one number: prototype * number of types + type.
        cell (P,) int32: lattice cell of the transform T_feature_grasp.
    """

    slice: Tensor
    cell: Tensor

    @property
    def prototype(self) -> Tensor:
        """(P,) int32: id of a feature's prototype."""
        return self.slice // len(GRASP_TYPES)

    @property
    def grasp_type(self) -> Tensor:
        """(P,) int32: index into `config.GRASP_TYPES`."""
        return self.slice % len(GRASP_TYPES)

    @staticmethod
    def together(parts: Sequence[Points]) -> Points:
        """The points of all parts, in order."""
        return Points(torch.cat([part.slice for part in parts]), torch.cat([part.cell for part in parts]))


@dataclass(frozen=True)
class Particles(Points):
    """Shape-grasp particles {prototype, 6D transform, outcome, type}.

    Attributes:
        success (P,) bool: outcome of the simulated grasp.
    """

    success: Tensor


def pairs_within(T_object_feature: Tensor, T_object_grasp: Tensor, reach: float) -> Pairs:
    """Pairs of F features (F, 4, 4) and G grasps (G, 4, 4), f32, with origins within `reach` (m) of each other.

    Ordered by feature, then grasp. T_feature_grasp = inverse(T_object_feature) @ T_object_grasp, for all F x G
    pairs as two batched products: faster than gathering the poses of the pairs within reach first.
    """
    T_feature_object = se3.inverse(T_object_feature)
    origin = T_feature_object[:, :3, :3] @ se3.position_of(T_object_grasp).T + T_feature_object[:, :3, 3:]  # (F, 3, G)
    rotation = left_product(se3.quaternion_of(T_feature_object)) @ se3.quaternion_of(T_object_grasp).T  # (F, 4, G)
    within = origin.square().sum(1) <= reach**2
    feature, grasp = within.nonzero(as_tuple=True)
    flat = feature * len(T_object_grasp) + grasp
    position = torch.stack([origin[:, i].flatten().index_select(0, flat) for i in range(3)], dim=1)
    quaternion = torch.stack([rotation[:, i].flatten().index_select(0, flat) for i in range(4)], dim=1)
    return Pairs(feature, grasp, position, quaternion)


def left_product(quaternion: Tensor) -> Tensor:
    """The matrices (..., 4, 4) with left_product(a) @ b = a * b (Hamilton), for quaternions (..., 4) wxyz."""
    w, x, y, z = quaternion.unbind(-1)
    rows = [w, -x, -y, -z, x, w, -z, y, y, z, w, -x, z, -y, x, w]
    return torch.stack(rows, dim=-1).reshape(*w.shape, 4, 4)
