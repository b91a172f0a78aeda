"""Shape-grasp particles: what ties a feature of an object to a grasp that was tried on it (paper, section 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

import roma
import torch
from torch import Tensor

from spgf_torch.geometry import se3


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
class Particles:
    """Shape-grasp particles {prototype, 6D transform, outcome, type}.

    Attributes:
        prototype (P,) int64: id of the feature's prototype.
        grasp_type (P,) int64: index into `config.GRASP_TYPES`.
        cell (P,) int64: lattice cell of the transform T_feature_grasp.
        success (P,) bool: outcome of the simulated grasp.
    """

    prototype: Tensor
    grasp_type: Tensor
    cell: Tensor
    success: Tensor


def pairs_within(T_object_feature: Tensor, T_object_grasp: Tensor, reach: float) -> Pairs:
    """Pairs of F features (F, 4, 4) and G grasps (G, 4, 4), f32, with origins within `reach` (m) of each other.

    Ordered by feature, then grasp. T_feature_grasp = inverse(T_object_feature) @ T_object_grasp.
    """
    origin_f, origin_g = se3.position_of(T_object_feature), se3.position_of(T_object_grasp)
    within = torch.cdist(origin_f, origin_g, compute_mode="donot_use_mm_for_euclid_dist") <= reach
    feature, grasp = within.nonzero(as_tuple=True)
    offset = origin_g[grasp] - origin_f[feature]
    position = torch.einsum("pji,pj->pi", T_object_feature[feature, :3, :3], offset)
    feature_to_object = roma.quat_conjugation(roma.quat_wxyz_to_xyzw(se3.quaternion_of(T_object_feature)))
    grasp_to_object = roma.quat_wxyz_to_xyzw(se3.quaternion_of(T_object_grasp))
    relative = roma.quat_product(feature_to_object[feature], grasp_to_object[grasp])
    return Pairs(feature, grasp, position, roma.quat_xyzw_to_wxyz(relative))
