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


def non_maximum_suppression(
    T: Tensor, group: Tensor, score: Tensor, distance: float, angle_deg: float, symmetry: Tensor | int = 2
) -> Tensor:
    """Return indices (<= G,) int64 of the poses (G, 4, 4) that are local maxima of the score (G,), highest first.

    A pose is suppressed by a kept one of a higher score, of its own group (G,) int64 within `distance` (m) and
    `angle_deg` of it; what is turned about the approach may be the same grasp (`same_grasp`: symmetry). Of equal scores
    the first counts as higher.
    """
    order = torch.argsort(score, descending=True, stable=True)
    turns = symmetry[order] if isinstance(symmetry, Tensor) else symmetry
    alike = same_grasp(T[order], distance, angle_deg, turns) & (group[order].unsqueeze(1) == group[order])
    pairs = alike.triu(diagonal=1).nonzero().cpu().numpy()
    return order[torch.from_numpy(independent_set(pairs, len(order))).to(order.device)]


def first_of_each(group: Tensor, quota: int) -> Tensor:
    """(G,) bool of groups (G,) int64 in order: fewer than `quota` before it are of the same."""
    alike = group.unsqueeze(1) == group
    return alike.tril(diagonal=-1).sum(1) < quota


def same_grasp(T: Tensor, distance: float, angle_deg: float, symmetry: Tensor | int = 2) -> Tensor:
    """Return (G, G) bool, which poses lie within `distance` (m) and `angle_deg` of each other.

    The angle is the least of those to the other pose turned about its approach, which is its z axis, by whole multiples
    of 360 deg / symmetry: hands make the same grasp there. Two jaws have a symmetry of 2: half a turn.

    Args:
        symmetry: one for all, or each grasp's (G,) int64. Two of symmetries n and m are the same grasp if turning both
            makes them so: by multiples of 360 deg over the least common multiple of n and m.
    """
    position, quaternion = se3.position_of(T), se3.quaternion_of(T)
    apart = torch.cdist(position, position, compute_mode="donot_use_mm_for_euclid_dist")
    kinds, its = torch.as_tensor(symmetry, device=T.device).expand(len(T)).unique(return_inverse=True)
    both = torch.lcm(kinds.unsqueeze(1), kinds)
    first, *others = both.unique().tolist() or [1]
    nearest = _cosine(quaternion, first)
    for n in others:
        nearest = torch.where((both == n)[its][:, its], _cosine(quaternion, n), nearest)
    return (apart <= distance) & (nearest >= math.cos(math.radians(angle_deg) / 2))


def _cosine(quaternion: Tensor, turns: int) -> Tensor:
    """(G, G) cosine of half the least angle between orientations (G, 4), over so many turns of one about z."""
    w, x, y, z = quaternion.unbind(1)
    cosine = (quaternion @ quaternion.T).abs()
    for k in range(1, turns):
        c, s = (round(f(math.pi * k / turns), 15) for f in (math.cos, math.sin))  # cos 90 deg is 0, not 6e-17
        turned = torch.stack([c * w - s * z, c * x + s * y, c * y - s * x, c * z + s * w], dim=1)
        cosine = torch.maximum(cosine, (quaternion @ turned.T).abs())
    return cosine
