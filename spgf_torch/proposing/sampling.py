"""Farthest-point sampling of features, and non-maximum suppression of poses in SE(3).

Both depend on distances alone, so that they choose the same of moved input, and on the order of their input only among
equals.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from spgf_torch.geometry import se3
from spgf_torch.ops.farthest_first import farthest_first
from spgf_torch.sensing.texlets import independent_set


def farthest_point_sampling(T_object_feature: Tensor, count: int, normal_weight: float) -> Tensor:
    """Order features (F, 4, 4) so that each leading part covers the surface: indices (<= count,) int64.

    Starts at the feature farthest from the mean; normals (z axes) that differ by a vector d are
    `normal_weight * |d|` metres apart, so that both sides of a thin wall are covered.
    """
    point = torch.cat([se3.position_of(T_object_feature), normal_weight * T_object_feature[:, :3, 2]], dim=1)
    distance = (point - point.mean(0)).square().sum(1)
    return farthest_first(point.double(), distance.double(), min(count, len(point)))


def non_maximum_suppression(T: Tensor, group: Tensor, score: Tensor, distance: float, angle_deg: float) -> Tensor:
    """Return indices (<= G,) int64 of the poses (G, 4, 4) that are local maxima of the score (G,), highest first.

    A pose is suppressed by a kept one of a higher score, of its own group (G,) int64 within `distance` (m) and
    `angle_deg` of it. The angle is the smaller of two: a two-finger hand turned half round its approach axis makes
    the same grasp. Of equal scores the first counts as higher.
    """
    order = torch.argsort(score, descending=True, stable=True)
    alike = same_grasp(T[order], distance, angle_deg) & (group[order].unsqueeze(1) == group[order])
    pairs = alike.triu(diagonal=1).nonzero().cpu().numpy()
    return order[torch.from_numpy(independent_set(pairs, len(order))).to(order.device)]


def same_grasp(T: Tensor, distance: float, angle_deg: float) -> Tensor:
    """Return (G, G) bool, which poses lie within `distance` (m) and `angle_deg`, half a turn or none apart."""
    position, quaternion = se3.position_of(T), se3.quaternion_of(T)
    w, x, y, z = quaternion.unbind(1)
    rotated = torch.stack([-z, y, -x, w], dim=1)  # quaternion * (0, 0, 0, 1): half a turn about the approach axis
    cosine = torch.maximum((quaternion @ quaternion.T).abs(), (quaternion @ rotated.T).abs())
    apart = torch.cdist(position, position, compute_mode="donot_use_mm_for_euclid_dist")
    return (apart <= distance) & (cosine >= math.cos(math.radians(angle_deg) / 2))
