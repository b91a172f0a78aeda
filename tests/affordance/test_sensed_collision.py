"""Points in the open hand's volume: by hand, and against trimesh's own containment."""

import numpy as np
import torch
import trimesh

from spgf_torch.affordance.sensed_collision import hand_volume, sensed_collision
from spgf_torch.geometry import se3

FINGERS = [
    trimesh.creation.box((0.02, 0.02, 0.05), trimesh.transformations.translation_matrix((x, 0, -0.01)))
    for x in (-0.04, 0.04)
]


def test_a_point_in_a_finger_by_hand() -> None:
    """Fingers span x in 30..50 mm: a point 35 mm from the TCP along +x is inside one, 25 mm is between them."""
    volume = hand_volume(FINGERS)
    T = torch.eye(4).repeat(2, 1, 1)
    T[1, 0, 3] = -0.01  # the TCP 10 mm to the left: the same point is 10 mm further right in the hand
    assert sensed_collision(torch.tensor([[0.025, 0.0, 0.0]]), T, volume).tolist() == [False, True]
    assert sensed_collision(torch.tensor([[0.055, 0.0, 0.0]]), T, volume).tolist() == [False, False]
    assert sensed_collision(torch.zeros(0, 3), T, volume).tolist() == [False, False]


def test_agrees_with_containment_in_the_meshes() -> None:
    generator = torch.Generator().manual_seed(0)
    points = (torch.rand(60, 3, generator=generator) - 0.5) * 0.2
    T = se3.random_poses(200, generator)
    T[:, :3, 3] *= 0.1
    found = sensed_collision(points, T, hand_volume(FINGERS))
    local = se3.transform_points(se3.inverse(T), points).numpy()
    centre = np.array([[-0.04, 0, -0.01], [0.04, 0, -0.01]])
    inside = (np.abs(local[:, :, None] - centre) <= np.array([0.01, 0.01, 0.025])).all(-1)  # (G, N, fingers)
    expected = inside.any(axis=(1, 2))
    assert np.array_equal(found.numpy(), expected)
    assert 0.1 < expected.mean() < 0.9
