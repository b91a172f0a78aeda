"""Rigid transforms: laws of the group, round trips, hand-computed values."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from spgf_torch.geometry import se3


@pytest.fixture
def poses() -> torch.Tensor:
    T = se3.random_poses(200, torch.Generator().manual_seed(0)).double()
    return se3.pose(se3.position_of(T), se3.quaternion_of(T))  # orthonormal in float64


def test_quarter_turn_about_z():
    """wxyz (cos 45, 0, 0, sin 45) turns x onto y; p_a = R p_b + t."""
    half = math.sqrt(0.5)
    T = se3.pose(torch.tensor([1.0, 2.0, 3.0]), torch.tensor([half, 0.0, 0.0, half]))
    moved = se3.transform_points(T, torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert torch.allclose(moved, torch.tensor([[1.0, 3.0, 3.0], [1.0, 2.0, 4.0]]), atol=1e-6)


def test_a_quaternion_of_any_length_or_sign_gives_the_same_rotation(poses):
    q = se3.quaternion_of(poses)
    assert torch.allclose(se3.pose(se3.position_of(poses), -3 * q), poses)


def test_round_trip_through_position_and_quaternion(poses):
    q = se3.quaternion_of(poses)
    assert (q[:, 0] >= 0).all()
    assert torch.allclose(q.norm(dim=1), torch.ones(200, dtype=torch.float64))
    assert torch.allclose(se3.pose(se3.position_of(poses), q), poses)


def test_inverse_is_the_matrix_inverse_and_batches_like_a_loop(poses):
    batched = se3.inverse(poses.view(4, 50, 4, 4)).view(200, 4, 4)
    assert torch.allclose(batched, torch.linalg.inv(poses))
    assert torch.allclose(batched[7], se3.inverse(poses[7]))


def test_composition_is_transforming_twice(poses):
    T_a_b, T_b_c = poses[:100], poses[100:]
    p_c = torch.rand((100, 5, 3), generator=torch.Generator().manual_seed(1)).double()
    twice = se3.transform_points(T_a_b, se3.transform_points(T_b_c, p_c))
    assert torch.allclose(se3.transform_points(T_a_b @ T_b_c, p_c), twice, atol=1e-12)


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 30.0, 179.0, 180.0])
def test_relative_angle_is_the_angle_turned_and_ignores_the_frame(poses, degrees):
    axis = torch.nn.functional.normalize(torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64), dim=0)
    half = math.radians(degrees) / 2
    turn = se3.pose(
        torch.zeros(3, dtype=torch.float64),
        torch.cat([torch.tensor([math.cos(half)], dtype=torch.float64), math.sin(half) * axis]),
    )
    tolerance = 1e-7 if degrees > 179 else 1e-12  # near pi the chord loses half the digits
    assert torch.allclose(se3.relative_angle(poses, poses @ turn), torch.tensor(2 * half).double(), atol=tolerance)


def test_random_rotations_are_uniform():
    """For uniform rotations each entry of R has mean 0 and variance 1/3; 4 sigma of 20,000 samples is 0.02."""
    R = se3.rotation_of(se3.random_poses(20_000, torch.Generator().manual_seed(0)))
    assert R.mean(dim=0).abs().max() < 0.02
    assert (R.square().mean(dim=0) - 1 / 3).abs().max() < 0.02


def test_random_poses_follow_the_generator():
    first, second = (se3.random_poses(5, torch.Generator().manual_seed(0)) for _ in range(2))
    assert torch.equal(first, second)
    assert torch.equal(se3.random_poses(0), torch.empty((0, 4, 4)))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_rotations_are_those_of_scipy(dtype):
    """Random quaternions, and half turns, where the scalar part says nothing."""
    eps = 8 * torch.finfo(dtype).eps
    wxyz = torch.randn((2000, 4), generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    wxyz[:500, 0] = 0
    wxyz[:6] = torch.eye(4, dtype=torch.float64)[[0, 1, 2, 3, 1, 2]] + 1e-9
    theirs = Rotation.from_quat(wxyz.roll(-1, dims=1).numpy())
    T = se3.pose(torch.zeros(2000, 3, dtype=dtype), wxyz.to(dtype))
    assert np.abs(se3.rotation_of(T).numpy() - theirs.as_matrix()).max() < eps
    exact = torch.from_numpy(theirs.as_matrix()).to(dtype)
    back = se3.quaternion_of(se3.from_rotation(exact, torch.zeros(2000, 3, dtype=dtype))).double().numpy()
    along = np.abs((np.roll(back, -1, axis=1) * theirs.as_quat()).sum(axis=1))  # q and -q are one rotation
    assert np.abs(along - 1).max() < eps and (back[:, 0] >= 0).all()


def test_rotation_vectors_are_those_of_scipy():
    vectors = torch.randn((1000, 3), generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    vectors[0], vectors[1:20] = 0, vectors[1:20] * 1e-8
    theirs = Rotation.from_rotvec(vectors.numpy()).as_matrix()
    assert np.abs(se3.rotation_about(vectors).numpy() - theirs).max() < 1e-14
    assert torch.equal(se3.rotation_about(vectors.view(10, 100, 3)).view(1000, 3, 3), se3.rotation_about(vectors))
