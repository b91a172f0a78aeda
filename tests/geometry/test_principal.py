import numpy as np

from spgf_torch.geometry.principal import principal_axes


def test_axes_by_hand() -> None:
    """Spread 4 along y, 2 along z, 1 along x; the lone far points lie at +y and -z, so the axes are y, -z, and
    y x (-z) = -x."""
    points = np.array([[0.5, 0, 0], [-0.5, 0, 0], [0, 4, 0], [0, -1, 0], [0, -1, 0], [0, 0, -2.0], [0, 0, 0.5]])
    np.testing.assert_allclose(principal_axes(points), [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=0.2)


def test_axes_turn_with_the_points_and_are_a_rotation() -> None:
    rng = np.random.default_rng(0)
    points = rng.random((50, 3)) ** 2 * [3, 2, 1]
    R = np.array([[0.6, -0.8, 0], [0, 0, -1], [0.8, 0.6, 0]])
    axes = principal_axes(points)
    np.testing.assert_allclose(principal_axes(points @ R.T + [1, 2, 3]), axes @ R.T, atol=1e-9)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0


def test_a_single_point_has_axes() -> None:
    assert np.isfinite(principal_axes(np.ones((1, 3)))).all()
