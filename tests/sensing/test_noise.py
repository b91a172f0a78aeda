"""Each effect of the depth camera against its formula."""

import numpy as np
import pytest

from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import (
    axial_noise,
    axial_sigma,
    flying_pixels,
    grazing_dropout,
    lateral_noise,
    measure,
    quantise,
)
from spgf_torch.settings import settings

OFF = {
    "axial_base": 0.0,
    "axial_quadratic": 0.0,
    "axial_grazing": 0.0,
    "lateral_px": 0.0,
    "flying_px": 0.0,
    "disparity_step_px": 0.0,
    "grazing_deg": 90.0,
}


def step_edge(near: float, far: float, height: int = 400) -> np.ndarray:
    """(height, 10) depth: columns 0 to 4 near, 5 to 9 far."""
    return np.tile(np.repeat([near, far], 5), (height, 1))


def test_no_noise_is_exact(rng: np.random.Generator) -> None:
    depth = np.where(rng.random((40, 50)) < 0.3, 0.0, rng.uniform(0.4, 2.0, (40, 50)))
    seen = measure(depth, np.full_like(depth, 0.3), 288.0, settings(SensingConfig, **OFF), rng)
    np.testing.assert_array_equal(seen, depth)


def test_all_effects_leave_the_input_alone(rng: np.random.Generator) -> None:
    depth = step_edge(0.7, 0.8)
    before = depth.copy()
    measure(depth, np.full_like(depth, 0.9), 288.0, settings(SensingConfig), rng)
    np.testing.assert_array_equal(depth, before)


def test_axial_sigma_by_hand() -> None:
    """At z = 1.4 m seen frontally: 0.0012 + 0.0019 * 1.0^2 = 0.0031 m. At z = 1 m and 60 deg:
    0.0012 + 0.0019 * 0.36 + 0.0001 * (60/30)^2 = 0.002284 m."""
    config = settings(SensingConfig)
    sigma = axial_sigma(np.array([[1.4, 1.0]]), np.deg2rad([[0.0, 60.0]]), config)
    np.testing.assert_allclose(sigma, [[0.0031, 0.002284]], rtol=1e-12)


def test_axial_statistics(rng: np.random.Generator) -> None:
    """The standard error of a deviation from n = 160000 draws is sigma / sqrt(2n) = 0.18 %."""
    depth = np.full((400, 400), 0.7)
    depth[0, 0] = 0.0
    error = (axial_noise(depth, np.full_like(depth, 0.0013), rng) - depth)[depth > 0]
    assert error.std() == pytest.approx(0.0013, rel=0.01)
    assert error.mean() == pytest.approx(0.0, abs=2e-5)
    assert axial_noise(depth, np.full_like(depth, 0.0013), rng)[0, 0] == 0


def test_quantisation_steps() -> None:
    """f b = 21.6 px m, step 1/16 px: at 0.7 m the depths are z^2 step / (f b) = 1.42 mm apart, and each is within half
    a step of what it stands for; disparities are whole multiples."""
    depth = np.linspace(0.69, 0.71, 2001)[None]
    seen = quantise(depth, 0.0625, 21.6)
    np.testing.assert_allclose(np.diff(np.unique(seen)), 0.49 * 0.0625 / 21.6, rtol=0.05)
    assert np.abs(seen - depth).max() <= 0.00142 / 2 * 1.05
    steps = 21.6 / seen / 0.0625
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    np.testing.assert_array_equal(quantise(np.zeros((2, 2)), 0.0625, 21.6), 0.0)


def test_flying_pixels_lie_between(rng: np.random.Generator) -> None:
    """With a footprint of 0.6 px, 0.6 / 2 = 30 % of the two columns at the edge read a mixture, nearer to their own
    depth (shares uniform in [1/2, 1]: mean 3/4). Standard error of 800 draws: 1.6 %."""
    depth = step_edge(0.7, 0.9)
    seen = flying_pixels(depth, 0.6, 0.01, rng)
    flew = seen != depth
    assert not flew[:, [0, 1, 2, 3, 6, 7, 8, 9]].any()
    assert flew[:, 4:6].mean() == pytest.approx(0.3, abs=0.06)
    assert ((seen > 0.7) & (seen < 0.9))[flew].all()
    assert (np.abs(seen - depth)[flew] <= 0.1 + 1e-12).all()
    assert np.abs(seen - depth)[flew].mean() == pytest.approx(0.05, abs=0.008)


def test_flying_pixels_need_two_surfaces(rng: np.random.Generator) -> None:
    """Neither an outline against nothing nor a jump below edge_depth makes a mixture."""
    for depth in (step_edge(0.7, 0.0), step_edge(0.700, 0.709)):
        np.testing.assert_array_equal(flying_pixels(depth, 1.0, 0.01, rng), depth)


def test_lateral_noise_moves_edges(rng: np.random.Generator) -> None:
    """A pixel beside the edge reads the other side when its column shift rounds to at least one pixel across:
    P(N(0, 0.4) > 0.5) = P(N > 1.25) = 0.1056. Standard error of 4000 draws: 0.5 %."""
    depth = step_edge(0.7, 0.8, height=4000)
    seen = lateral_noise(depth, 0.4, 0.01, rng)
    assert (seen[:, 4] == 0.8).mean() == pytest.approx(0.1056, abs=0.02)
    assert (seen[:, 5] == 0.7).mean() == pytest.approx(0.1056, abs=0.02)
    assert set(np.unique(seen)) == {0.7, 0.8}


def test_lateral_noise_moves_outlines_both_ways_and_keeps_surfaces(rng: np.random.Generator) -> None:
    seen = lateral_noise(step_edge(0.7, 0.0), 0.8, 0.01, rng)
    assert (seen[:, 4] == 0).any()
    assert (seen[:, 5] == 0.7).any()
    slope = np.tile(0.7 + 0.002 * np.arange(10), (50, 1))  # 2 mm a pixel; a shift of 5 px is 6 standard deviations
    np.testing.assert_array_equal(lateral_noise(slope, 0.8, 0.01, rng), slope)


def test_grazing_dropout() -> None:
    depth, angle = np.full((1, 3), 0.7), np.deg2rad([[79.0, 80.5, 89.0]])
    np.testing.assert_array_equal(grazing_dropout(depth, angle, np.deg2rad(80)), [[0.7, 0.0, 0.0]])
    np.testing.assert_array_equal(grazing_dropout(depth, angle, np.pi / 2), depth)
