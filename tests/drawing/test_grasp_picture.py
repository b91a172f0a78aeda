"""Ranks in the picture of a scene."""

import numpy as np

from spgf_torch.drawing.grasp_picture import RANK, side_steps


def test_ranks_do_not_hide_each_other() -> None:
    """Three at one place, one apart: the first and the lone one stay, the others go a rank's width up and around."""
    points = np.array([[50.0, 40.0], [50.0, 40.0], [54.0, 40.0], [150.0, 10.0]])
    steps = side_steps(points)
    np.testing.assert_allclose(steps[[0, 1, 3]], [[0, 0], [0, RANK[0]], [0, 0]], atol=1e-9)
    places = points + steps
    for i in range(4):
        for j in range(i):
            assert (np.abs(places[i] - places[j]) >= RANK).any()
