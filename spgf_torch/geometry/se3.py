"""Rigid transforms as batches of 4x4 matrices (conventions: `spgf_torch.geometry`)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

__all__ = [
    "from_rotation",
    "inverse",
    "pose",
    "position_of",
    "quaternion_of",
    "random_poses",
    "relative_angle",
    "rotation_about",
    "rotation_of",
    "transform_points",
]


def pose(position: Tensor, quaternion: Tensor) -> Tensor:
    """T (..., 4, 4) from a position (..., 3) in metres and a quaternion (..., 4) wxyz of any length but zero."""
    return from_rotation(_from_quaternion(torch.nn.functional.normalize(quaternion, dim=-1)), position)


def from_rotation(rotation: Tensor, position: Tensor) -> Tensor:
    """T (..., 4, 4) from a rotation matrix (..., 3, 3) and a position (..., 3); leading dimensions broadcast."""
    batch = torch.broadcast_tensors(rotation[..., 0], position)[0].shape[:-1]  # `broadcast_shapes` imports sympy
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
    """The rotation of T as a unit quaternion (..., 4) wxyz with w >= 0.

    >>> quaternion_of(torch.eye(4))
    tensor([1., 0., 0., 0.])
    """
    wxyz = _to_quaternion(rotation_of(T))
    return torch.where(wxyz[..., :1] < 0, -wxyz, wxyz)


def inverse(T: Tensor) -> Tensor:
    """T_b_a (..., 4, 4) from T_a_b: the transpose of the rotation, no solve.

    >>> T = pose(torch.tensor([1.0, 2.0, 3.0]), torch.tensor([1.0, 0.0, 0.0, 0.0]))
    >>> position_of(inverse(T))
    tensor([-1., -2., -3.])
    """
    transposed = rotation_of(T).mT
    return from_rotation(transposed, -(transposed @ T[..., :3, 3:]).squeeze(-1))


def transform_points(T: Tensor, points: Tensor) -> Tensor:
    """p_a (..., N, 3) = T_a_b (..., 4, 4) applied to each of p_b (..., N, 3); leading dimensions broadcast.

    A quarter turn about z, then 1 m along x:

    >>> T = pose(torch.tensor([1.0, 0.0, 0.0]), torch.tensor([1.0, 0.0, 0.0, 1.0]))
    >>> transform_points(T, torch.tensor([[1.0, 0.0, 0.0]])).round(decimals=3)
    tensor([[1., 1., 0.]])
    """
    return points @ rotation_of(T).mT + position_of(T).unsqueeze(-2)


def relative_angle(T_a: Tensor, T_b: Tensor) -> Tensor:
    """The angle (...) in [0, pi] between the rotations of two poses.

    From the chord |R_a - R_b| = 2 sqrt(2) sin(angle / 2): exact near 0, about 1e-3 rad near pi in float32.

    >>> turned = from_rotation(rotation_about(torch.tensor([0.0, 0.0, 0.5])), torch.zeros(3))
    >>> round(relative_angle(torch.eye(4), turned).item(), 3)
    0.5
    """
    chord = torch.linalg.matrix_norm(rotation_of(T_b) - rotation_of(T_a))
    return 2 * torch.asin((chord * (1 / (2 * math.sqrt(2)))).clamp_max(1))


def random_poses(n: int, generator: torch.Generator | None = None, extent: float = 1.0) -> Tensor:
    """T (n, 4, 4) float32: rotations uniform on SO(3), positions uniform in the cube [-extent, extent]^3 (m)."""
    share, first, second = (torch.rand(n, generator=generator) for _ in range(3))
    inner, outer = (1 - share).sqrt(), share.sqrt()  # Shoemake 1992: a point of two circles, uniform on the sphere
    first, second = 2 * math.pi * first, 2 * math.pi * second
    quaternion = torch.stack([inner * first.sin(), inner * first.cos(), outer * second.sin(), outer * second.cos()], -1)
    position = (2 * torch.rand((n, 3), generator=generator) - 1) * extent
    return pose(position, quaternion)


def rotation_about(vector: Tensor) -> Tensor:
    """The rotation matrix (..., 3, 3) about a vector (..., 3) by its length in rad.

    >>> rotation_about(torch.tensor([0.0, 0.0, torch.pi / 2])).round(decimals=3)[0]
    tensor([ 0., -1.,  0.])
    """
    angle = vector.norm(dim=-1)
    x, y, z = (vector / angle.clamp_min(1e-12)[..., None]).unbind(-1)
    sin, rest = angle.sin(), 1 - angle.cos()
    rows = [
        [1 - y * y * rest - z * z * rest, x * y * rest - z * sin, x * z * rest + y * sin],
        [x * y * rest + z * sin, 1 - x * x * rest - z * z * rest, y * z * rest - x * sin],
        [x * z * rest - y * sin, y * z * rest + x * sin, 1 - x * x * rest - y * y * rest],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def _from_quaternion(wxyz: Tensor) -> Tensor:
    """R (..., 3, 3) of a unit quaternion."""
    w, x, y, z = wxyz.unbind(-1)
    rows = [
        [x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def _to_quaternion(R: Tensor) -> Tensor:
    """A unit quaternion (..., 4) wxyz of R (..., 3, 3), of either sign (Markley 2008).

    Each row below is the quaternion xyzw times four times one of its parts; that of the largest has most digits.
    """
    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(-1) for row in R.unbind(-2))
    rows = [
        [1 + a - e - i, d + b, g + c, h - f],
        [b + d, 1 + e - i - a, h + f, c - g],
        [c + g, f + h, 1 + i - a - e, d - b],
        [h - f, c - g, d - b, 1 + a + e + i],
    ]
    candidates = torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
    largest = candidates.diagonal(dim1=-2, dim2=-1).argmax(dim=-1)
    chosen = candidates.gather(-2, largest[..., None, None].expand(*largest.shape, 1, 4)).squeeze(-2)
    xyzw: Tensor = chosen / chosen.norm(dim=-1, keepdim=True)
    return xyzw.roll(1, dims=-1)
