"""Rigid transforms as batches of 4x4 matrices (conventions: `spgf_torch.geometry`)."""

from __future__ import annotations

import roma
import torch
from torch import Tensor


def pose(position: Tensor, quaternion: Tensor) -> Tensor:
    """T (..., 4, 4) from a position (..., 3) in metres and a quaternion (..., 4) wxyz of any length but zero."""
    xyzw = torch.nn.functional.normalize(quaternion, dim=-1).roll(-1, dims=-1)
    return from_rotation(roma.unitquat_to_rotmat(xyzw), position)


def from_rotation(rotation: Tensor, position: Tensor) -> Tensor:
    """T (..., 4, 4) from a rotation matrix (..., 3, 3) and a position (..., 3); leading dimensions broadcast."""
    batch = torch.broadcast_shapes(rotation.shape[:-2], position.shape[:-1])
    T = position.new_zeros((*batch, 4, 4))
    T[..., :3, :3] = rotation
    T[..., :3, 3] = position
    T[..., 3, 3] = 1
    return T


def position_of(T: Tensor) -> Tensor:
    """The translation (..., 3) of T, in metres."""
    return T[..., :3, 3]


def rotation_of(T: Tensor) -> Tensor:
    """The rotation matrix (..., 3, 3) of T."""
    return T[..., :3, :3]


def quaternion_of(T: Tensor) -> Tensor:
    """The rotation of T as a unit quaternion (..., 4) wxyz with w >= 0."""
    wxyz = roma.rotmat_to_unitquat(rotation_of(T)).roll(1, dims=-1)
    return torch.where(wxyz[..., :1] < 0, -wxyz, wxyz)


def inverse(T: Tensor) -> Tensor:
    """T_b_a (..., 4, 4) from T_a_b: the transpose of the rotation, no solve."""
    transposed = rotation_of(T).mT
    return from_rotation(transposed, -(transposed @ T[..., :3, 3:]).squeeze(-1))


def transform_points(T: Tensor, points: Tensor) -> Tensor:
    """p_a (..., N, 3) = T_a_b (..., 4, 4) applied to each of p_b (..., N, 3); leading dimensions broadcast."""
    return points @ rotation_of(T).mT + position_of(T).unsqueeze(-2)


def relative_angle(T_a: Tensor, T_b: Tensor) -> Tensor:
    """The angle (...) in [0, pi] between the rotations of two poses.

    From the chord |R_a - R_b| = 2 sqrt(2) sin(angle / 2): exact near 0, about 1e-3 rad near pi in float32.
    """
    return roma.rotmat_geodesic_distance(rotation_of(T_a), rotation_of(T_b))


def random_poses(n: int, generator: torch.Generator | None = None, extent: float = 1.0) -> Tensor:
    """T (n, 4, 4) float32: rotations uniform on SO(3), positions uniform in the cube [-extent, extent]^3 (m)."""
    quaternion = roma.random_unitquat(n, generator=generator)
    position = (2 * torch.rand((n, 3), generator=generator) - 1) * extent
    return pose(position, quaternion)
