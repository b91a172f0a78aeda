"""Clouds as depth images: what a plate hides, where nothing is, and beyond a frame; by hand."""

import numpy as np
import torch

from spgf_torch.sensing.cloud_view import seen_by, view_of_points
from spgf_torch.sensing.unseen import behind

EYE = np.array([0.0, 0.0, 1.0])
NO_PLANES = np.zeros((0, 4))


def plate(pitch: float, half: float = 0.1, z: float = 0.0) -> np.ndarray:
    along = np.arange(-half, half + 1e-9, pitch)
    return np.array([[x, y, z] for x in along for y in along])


def depths(points: np.ndarray, places: list[tuple[float, float, float]], planes: np.ndarray = NO_PLANES) -> np.ndarray:
    view = view_of_points(points, EYE, points, planes)
    assert view is not None
    return view.behind(torch.tensor(places)).numpy()


def test_a_plate_hides_what_is_below_it() -> None:
    """Seen from 1 m above: 50 mm below it is 50 mm behind, above it is seen through, beside it too; nothing leaks."""
    below = [(x, y, -0.05) for x in np.linspace(-0.09, 0.09, 37) for y in np.linspace(-0.09, 0.09, 37)]
    np.testing.assert_allclose(depths(plate(0.003), below), 0.05, atol=1e-4)
    above, beside = depths(plate(0.003), [(0.0, 0.0, 0.05), (0.15, 0.0, -0.05)])
    assert abs(above + 0.05) < 1e-4 and beside < 0


def test_random_points_leave_no_holes() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (4000, 2)), np.zeros(4000)])  # 3 mm apart on average
    below = [(x, y, -0.05) for x in np.linspace(-0.085, 0.085, 60) for y in np.linspace(-0.085, 0.085, 60)]
    assert (depths(points, below) > 0.04).mean() > 0.995


def test_the_front_hides_the_back() -> None:
    """A small plate 100 mm over a large one: between them is unseen under the small one alone."""
    both = np.concatenate([plate(0.003, 0.1), plate(0.003, 0.03, 0.1)])
    under, beside = depths(both, [(0.0, 0.0, 0.05), (0.06, 0.0, 0.05)])
    assert abs(under - 0.05) < 1e-4 and abs(beside + 0.05) < 1e-4


def test_beyond_a_frame_all_is_unseen() -> None:
    """The cloud is cut at x = 0.1: what lies beyond, and has no points, counts as far behind."""
    frame = np.array([[1.0, 0.0, 0.1, -0.1]]) / np.linalg.norm([1, 0, 0.1])  # through the eye and x = 0.1 at z = 0
    beyond, within = depths(plate(0.003), [(0.15, 0.0, 0.02), (-0.15, 0.0, 0.02)], frame)
    assert beyond > 0.5 and within < 0


def test_points_hidden_from_the_viewpoint_were_seen_from_elsewhere() -> None:
    top, bottom = plate(0.003), plate(0.003, z=-0.1)
    view = view_of_points(np.concatenate([top, bottom]), EYE, top, NO_PLANES)
    assert view is not None
    assert seen_by(top, [view]) and not seen_by(np.concatenate([top, bottom]), [view])
    assert bool((behind(torch.from_numpy(bottom[:5]), [view]) > 0.09).any())


def test_an_eye_among_the_points_is_none() -> None:
    assert view_of_points(plate(0.003), np.zeros(3), plate(0.003), NO_PLANES) is None
    assert view_of_points(plate(0.05)[:3], EYE, plate(0.05)[:3], NO_PLANES) is None
