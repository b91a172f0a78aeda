"""Numbers that are no metres, though they look like some: depth buffers, ranges, and counts of another size.

Nothing in a depth image says its unit. What it would show if it were in metres does: a plane's depth z has 1 / z linear
in the pixel's coordinates. A depth buffer is a - b / z and a disparity b / z, linear themselves; a range is longer than
z by the length of the pixel's ray.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spgf_torch.config import InputError, SceneConfig
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.views import View

# Pixels and planes that are tried.
_PIXELS, _TRIED = 2500, 300
# How far from a plane, as a share of the depth, a pixel is still on it; and of all pixels, those that make it one.
_ON, _SHARE = 0.004, 0.25
# The residual of the better reading over the other's: a sensor's noise brings both to 1.
_BETTER = 0.5
# The residual of the worse reading as a share of the depth: less is rounding.
_WORSE = 3e-4
# m; median depths between which cameras for grasping work.
_NEAREST, _FARTHEST = 0.15, 1.8
_USUAL = (0.25, 1.5)
# m; no hand spans a target whose least side is more, and nothing whose largest is less is held by it.
_LARGE, _SMALL = 0.2, 0.015
# Counts a metre that cameras and data sets write, beside 1000.
_COUNTS = {5000: "TUM RGB-D", 4000: "RealSense L515", 10000: "D405, YCB-Video", 100: "centimetres"}


def check_depth_image(view: View) -> None:
    """InputError for an image whose largest plane is none in metres, but is one for another reading of its numbers."""
    seen = np.flatnonzero((np.isfinite(view.depth) & (view.depth > 0)).ravel())
    if len(seen) < _PIXELS:
        return
    chosen = np.random.default_rng(0).choice(seen, _PIXELS, replace=False)
    z, ray = view.depth.ravel()[chosen], view.camera.rays().reshape(-1, 3)[chosen]
    pixel = np.column_stack([ray[:, :2], np.ones(len(ray))])
    length = np.linalg.norm(ray, axis=1)
    for reading, words in (
        (_Buffer(), "a depth buffer or disparities: a - b / z in place of z; convert them to metres first"),
        (_Metric(length), "distances along the rays in place of z; divide them by the length of the pixel's ray"),
    ):
        on = _plane_of(pixel, z, reading)
        if on is None:
            continue
        better, worse = (_residual(pixel[on], z[on], r.at(on)) for r in (reading, _Metric(np.ones(len(z)))))
        if better < _BETTER * worse and worse > _WORSE:
            raise InputError(f"{view.name}: expected depths z in m, got {words}")


class _Metric:
    """A reading in which `length` / z is linear on a plane: z in m for 1, a range for the length of the pixel's ray."""

    def __init__(self, length: np.ndarray) -> None:
        self.length = length

    def at(self, chosen: np.ndarray) -> _Metric:
        return _Metric(self.length[chosen])

    def linear(self, z: np.ndarray) -> np.ndarray:
        return self.length / z

    def depth(self, linear: np.ndarray) -> np.ndarray:
        return self.length / np.where(linear == 0, np.inf, linear)


class _Buffer:
    """A reading in which the number itself is linear on a plane."""

    def at(self, chosen: np.ndarray) -> _Buffer:
        return self

    def linear(self, z: np.ndarray) -> np.ndarray:
        return z

    def depth(self, linear: np.ndarray) -> np.ndarray:
        return linear


def _plane_of(pixel: np.ndarray, z: np.ndarray, reading: _Metric | _Buffer) -> np.ndarray | None:
    """(N,) bool: the pixels (N, 3) on the plane that holds most of them in a reading; None if these are few."""
    generator = np.random.default_rng(0)
    corner = generator.integers(len(z), size=(_TRIED, 3))
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(pixel[corner] + 1e-12 * np.eye(3))
        planes = np.einsum("hij,hj->hi", inverse, reading.linear(z)[corner])
        off = np.abs(reading.depth(planes @ pixel.T) / z - 1)
    held = (off < _ON).sum(axis=1)
    on = off[int(held.argmax())] < _ON
    return on if on.mean() >= _SHARE else None


def _residual(pixel: np.ndarray, z: np.ndarray, reading: _Metric | _Buffer) -> float:
    """Root mean square of the relative error of depth on the plane that fits best in a reading."""
    plane = np.linalg.lstsq(pixel, reading.linear(z), rcond=None)[0]
    return float(np.sqrt(np.mean((reading.depth(pixel @ plane) / z - 1) ** 2)))


def size_notes(targets: Sequence[Cloud], views: Sequence[View] | None, config: SceneConfig, alone: bool) -> list[str]:
    """Lines that say how far and how large the target is, and a warning where no camera and no hand would have it so.

    Args:
        views: of depth images, in m; None: clouds.
        alone: whether the targets are apart from the table and the rest of the scene.
    """
    points = np.concatenate([cloud.points for cloud in targets])
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    low, high = np.quantile(points @ axes.T, [0.01, 0.99], axis=0)
    sides = np.sort(high - low)[::-1]
    size = " x ".join(f"{side:.3f}" for side in sides)
    depths = [view.depth[np.isfinite(view.depth) & (view.depth > 0)] for view in views or ()]
    median = float(np.median(np.concatenate(depths))) if depths else None
    lines = [("" if median is None else f"depth: median {median:.3f} m; ") + f"extent of the target: {size} m"]
    far = median is not None and not _NEAREST <= median <= _FARTHEST
    odd = alone and len(points) > 50 and (sides[-1] > _LARGE or sides[0] < _SMALL)
    if not (far or odd):
        return lines
    what = f"a median depth of {median:.3g} m" if far else f"a target of {size} m"
    if median is None:
        remedy = f"another unit? (unit={config.unit})"
    else:
        counts = [f"{1 / n:g} ({words})" for n, words in _COUNTS.items() if _fits(median * 1000 / n)]
        remedy = (
            f"depth_scale={' or '.join(counts)} would make it a usual one" if counts else "another depth_scale or unit?"
        )
    lines.append(f"warning: {what} is unusual for grasping; {remedy}")
    return lines


def _fits(median: float) -> bool:
    return _USUAL[0] <= median <= _USUAL[1]
