"""What is shown of all that was sensed."""

import numpy as np

from spgf_torch.scene.sensed import Sensed


def test_a_place_has_the_colour_of_the_targets_point_nearest_to_it() -> None:
    """The nearest point of all, an obstacle's, does not count."""
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0.04, 0, 0]], np.float32)
    sensed = Sensed(points, np.array([True, True, False]), np.array([[255, 0, 0], [0, 9, 0], [0, 0, 255]], np.uint8))
    found = sensed.colours_at(np.array([[0.04, 0, 0.01], [0.07, 0, 0]]))
    assert found is not None and found.dtype == np.uint8 and found.tolist() == [[255, 0, 0], [0, 9, 0]]


def test_without_colours_or_targets_none_is_known() -> None:
    points, tints = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
    assert Sensed(points, np.array([True])).colours_at(points) is None
    assert Sensed(points, np.array([False]), tints).colours_at(points) is None
