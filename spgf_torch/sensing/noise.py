"""What a structured-light depth camera adds to an ideal depth image, one pure function an effect.

A depth image is (H, W) float64, z in metres, 0 = no return. Every function returns a new image, leaves pixels
without return alone unless it says otherwise, and does nothing at strength 0.

Sources, with what was taken from them:
- Nguyen, Izadi, Lovell: Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking, 3DIMPVT 2012:
  axial noise over distance and angle of incidence, lateral noise in pixels.
- Handa, Whelan, McDonald, Davison: A Benchmark for RGB-D Visual Odometry, 3D Reconstruction and SLAM, ICRA 2014,
  and its published code `simkinect`: jittered sampling of the ideal image, rounding of disparity to 1/8 pixel.
Left out: noise correlated between pixels, the projector's shadow, interference between the cameras.
"""

from __future__ import annotations

import numpy as np

from spgf_torch.sensing.config import SensingConfig


def measure(
    depth: np.ndarray, cosine: np.ndarray, focal: float, config: SensingConfig, generator: np.random.Generator
) -> np.ndarray:
    """The depth image a noisy camera makes of an ideal one, the effects in the order in which they arise.

    Args:
        depth: (H, W) ideal depth, m.
        cosine: (H, W) of the angle of incidence.
        focal: pixels.
        config: strengths.
        generator: source of all randomness.
    """
    angle = np.arccos(np.clip(cosine, 0.0, 1.0))
    seen = grazing_dropout(depth, angle, np.deg2rad(config.grazing_deg))
    seen = lateral_noise(seen, config.lateral_px, config.edge_depth, generator)
    seen = flying_pixels(seen, config.flying_px, config.edge_depth, generator)
    seen = axial_noise(seen, axial_sigma(seen, angle, config), generator)
    return quantise(seen, config.disparity_step_px, focal * config.baseline)


def grazing_dropout(depth: np.ndarray, angle: np.ndarray, limit: float) -> np.ndarray:
    """No return where the angle of incidence (rad) exceeds `limit`; pi/2 switches it off."""
    return np.where(angle > limit, 0.0, depth)


def lateral_noise(depth: np.ndarray, sigma_px: float, edge_depth: float, generator: np.random.Generator) -> np.ndarray:
    """Ragged edges: a pixel may read what a pixel beside it sees (Nguyen 2012: sigma 0.8 px; Handa 2014).

    Each pixel draws a normal shift per axis, rounded to whole pixels. The shifted reading counts only across an
    edge (a jump of more than `edge_depth` m, or an outline): Nguyen's axial noise was measured on planes turned by up
    to 60 degrees, so along a smooth surface the shift is already in it. Outlines move both ways.
    """
    if sigma_px == 0:
        return depth.copy()
    height, width = depth.shape
    shift = np.rint(generator.normal(0.0, sigma_px, (2, height, width))).astype(int)
    row = np.clip(np.arange(height)[:, None] + shift[0], 0, height - 1)
    column = np.clip(np.arange(width)[None, :] + shift[1], 0, width - 1)
    shifted = depth[row, column]
    return np.where(np.abs(shifted - depth) > edge_depth, shifted, depth)


def flying_pixels(
    depth: np.ndarray, footprint_px: float, edge_depth: float, generator: np.random.Generator
) -> np.ndarray:
    """A pixel whose footprint straddles a depth edge reads a mixture of the two depths.

    The edge between two pixel centres lies at a uniform u in [0, 1] from this one. A footprint of width w <= 1
    straddles it when u < w/2, and then covers this side with the share 1/2 + u/w, uniform in [1/2, 1].
    The other side is the neighbour (of four) with the largest jump beyond `edge_depth` m. An outline has nothing
    behind it and makes no mixture.
    """
    if footprint_px == 0:
        return depth.copy()
    padded = np.pad(depth, 1)
    beside = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    jump = np.where((beside > 0) & (depth > 0), np.abs(beside - depth), 0.0)
    largest = jump.argmax(axis=0)[None]
    other, jump = (np.take_along_axis(a, largest, axis=0)[0] for a in (beside, jump))
    u = generator.random(depth.shape)
    own = 0.5 + u / footprint_px
    return np.where((jump > edge_depth) & (own < 1.0), own * depth + (1.0 - own) * other, depth)


def axial_sigma(depth: np.ndarray, angle: np.ndarray, config: SensingConfig) -> np.ndarray:
    """Standard deviation of depth, m (Nguyen 2012), for depth z in m and angle of incidence a in rad.

    sigma = base + quadratic (z - nearest)^2 + grazing / sqrt(z) * (a / (pi/2 - a))^2
    """
    z = np.where(depth > 0, depth, 1.0)
    slant = angle / np.maximum(np.pi / 2 - angle, 1e-3)
    by_distance = config.axial_base + config.axial_quadratic * (z - config.axial_nearest) ** 2
    return by_distance + config.axial_grazing / np.sqrt(z) * slant**2


def axial_noise(depth: np.ndarray, sigma: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Normal noise of standard deviation `sigma` (H, W), m, along the optical axis."""
    noisy = depth + sigma * generator.standard_normal(depth.shape)
    return np.where(depth > 0, np.maximum(noisy, 0.0), 0.0)


def quantise(depth: np.ndarray, step_px: float, focal_baseline: float) -> np.ndarray:
    """Depth whose disparity focal * baseline / z (pixels; `focal_baseline` in px m) is a multiple of `step_px`.

    The step in depth is z^2 step / (focal baseline).
    """
    if step_px == 0:
        return depth.copy()
    result = np.zeros_like(depth)
    seen = depth > 0
    steps = np.rint(focal_baseline / (depth[seen] * step_px))
    result[seen] = focal_baseline / (np.maximum(steps, 1.0) * step_px)
    return result
