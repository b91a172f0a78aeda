"""Candidates: geometry without jitter by hand, the jitter's size, repeatability."""

import numpy as np
import torch
from trial_objects import ball, box, cup

from spgf_torch.settings import settings
from spgf_torch.simulation.candidates import sample_candidates, sample_poses
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.table import pose_matrix

EXACT = settings(SamplerConfig, jitter_deg=0, jitter=0)


def sample(obj, count=200, config=EXACT, seed=0, sampler="surface_pairs"):
    return sample_candidates(obj, count, config, np.random.default_rng(seed), sampler).double().numpy()


def test_box_grasps_lie_midway_between_opposite_faces():
    """On a 4 x 6 x 10 cm box closing along an axis puts the TCP in the box's middle plane across that axis."""
    T = sample(box((0.04, 0.06, 0.1)))
    axis = np.abs(T[:, :3, 0]).argmax(axis=1)
    assert set(axis) == {0, 1, 2}
    rows = np.arange(len(T))
    np.testing.assert_allclose(np.abs(T[rows, axis, 0]), 1, atol=1e-6)
    np.testing.assert_allclose(T[rows, axis, 3], np.array([0, 0, 0.05])[axis], atol=1e-6)


def test_faces_are_chosen_by_area():
    """A 1 x 5 x 10 cm box: the pair of 5 x 10 faces has 50 of 65 parts of the area; 3 sigma of 2000 draws is 2.8 %."""
    T = sample(box((0.01, 0.05, 0.1)), count=2000)
    assert abs((np.abs(T[:, 0, 0]) > 0.9).mean() - 50 / 65) < 0.028


def test_rim_grasps_lie_in_the_wall():
    """On a cup's wall (3 mm) the TCP lies in the middle of the wall, not in the middle of the cup."""
    T = sample(cup())
    radius = np.hypot(T[:, 0, 3], T[:, 1, 3])
    on_wall = (np.abs(T[:, 2, 0]) < 1e-3) & (T[:, 2, 3] > 0.005)
    assert on_wall.sum() > 100
    assert np.all(np.abs(radius[on_wall] - 0.0385) < 0.0006)  # the polygon's sagitta: 0.04 (1 - cos 7.5 deg) = 0.0003


def test_no_grasp_comes_from_inside_and_all_are_rigid():
    T = sample(ball(), config=settings(SamplerConfig))
    np.testing.assert_allclose(
        T[:, :3, :3].transpose(0, 2, 1) @ T[:, :3, :3], np.tile(np.eye(3), (200, 1, 1)), atol=1e-6
    )
    T = sample(cup())
    assert np.all(np.einsum("ij,ij->i", T[:, :3, 2], T[:, :3, 3] - cup().com) < 1e-6)


def test_jitter_has_the_stated_deviations():
    """The same draws with and without jitter differ by 10 deg and 5 mm in each coordinate (2000 draws: +-1.6 %)."""
    config = settings(SamplerConfig)
    exact, moved = sample(ball(), 2000), sample(ball(), 2000, config)
    shift = moved[:, :3, 3] - exact[:, :3, 3]
    np.testing.assert_allclose(shift.std(axis=0), config.jitter, rtol=0.06)
    turn = np.degrees(np.arccos(np.clip((np.einsum("nij,nij->n", exact[:, :3, :3], moved[:, :3, :3]) - 1) / 2, -1, 1)))
    np.testing.assert_allclose(np.sqrt((turn**2).mean()), config.jitter_deg * 3**0.5, rtol=0.05)


def test_seed_decides_and_stored_poses_rebuild_the_simulated_ones():
    config = settings(SamplerConfig)
    first, again = (sample_poses(cup(), 50, config, np.random.default_rng(3)) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert first[0].dtype == first[1].dtype == torch.float32
    assert torch.equal(pose_matrix(*first), sample_candidates(cup(), 50, config, np.random.default_rng(3)))
    assert not torch.equal(first[0], sample_poses(cup(), 50, config, np.random.default_rng(4))[0])


def test_approaches_come_straight_down_on_the_surface():
    """On a box of 0.2 x 0.3 x 0.4 m, from z = 0: z of the TCP goes into a face, 0 to 50 mm deep; x turns freely.

    Of 2000 depths from 0 to 50 mm the mean is 25 mm +- 1 (3 sigma), as is that of a uniform angle's cosine 0 +- 0.05.
    """
    size = np.array([0.2, 0.3, 0.4])
    T = sample(box(tuple(size)), 2000, settings(SamplerConfig, jitter_deg=0, jitter=0, depth=0.05), sampler="approach")
    rows, axis = np.arange(len(T)), np.abs(T[:, :3, 2]).argmax(axis=1)
    assert set(axis) == {0, 1, 2}
    np.testing.assert_allclose(np.abs(T[rows, axis, 2]), 1, atol=1e-6)
    centred = T[:, :3, 3] - [0, 0, 0.2]
    depth = size[axis] / 2 + centred[rows, axis] * T[rows, axis, 2]
    assert -1e-6 < depth.min() < 0.001 and 0.049 < depth.max() < 0.05 + 1e-6 and abs(depth.mean() - 0.025) < 0.001
    across = (axis + 1) % 3
    assert abs(T[rows, across, 0].mean()) < 0.05 and abs((T[rows, across, 0] ** 2).mean() - 0.5) < 0.03
    np.testing.assert_allclose(
        T[:, :3, :3].transpose(0, 2, 1) @ T[:, :3, :3], np.tile(np.eye(3), (2000, 1, 1)), atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.det(T[:, :3, :3]), 1, atol=1e-6)
