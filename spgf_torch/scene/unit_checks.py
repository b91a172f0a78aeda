"""Numbers that are no metres, though they look like some: depth buffers, ranges, and counts of another size.

Nothing in a depth image says its unit. What it would show if it were in metres does: a plane's depth z has 1 / z linear
in the pixel's coordinates. A depth buffer is a - b / z and a disparity b / z, linear themselves; a range is longer than
z by the length of the pixel's ray.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.planes import LargestPlane, height
from spgf_torch.scene.views import View

# Pixels that are looked at, planes that are tried, and how many of them one after the other.
_PIXELS, _TRIED, _PLANES = 1200, 150, 3
# How far from a plane, as a share of the depth, a pixel is still on it: of rendered images and of noisy ones.
_ON = (0.00003, 0.0005, 0.0015, 0.004)
# Of the pixels, those that planes hold in another reading beyond those in metres. Of 450 true images at most 0.11.
_MORE = 0.15
# Pixels that make a plane; and the least volume of three pixels' rays that fixes one.
_LEAST, _FLAT = 30, 1e-9
# Of the steps from number to number, those closer than rounding would have them.
_CLOSEST = 0.1
# A metre in the steps that cameras count in: numbers that end at exactly 1 between these steps are no metres.
_STEPS, _BETWEEN = 20_000, 0.02
# m; the usual median depth of cameras for grasping, and of the middle one of the three sides of what stands on a table;
# e-fold spreads of both, and of the side where the depth is not known. Of 150 scenes of our objects 0.3 to 1.0 m away,
# what is less usual than this many spreads in one direction was none.
_DEPTH, _SIDE, _SPREAD, _SPREAD_ALONE = 0.6, 0.08, 0.5, 0.85
_NEAR, _FAR = -2.4, 1.8
# m; median depths beyond which no camera for grasping works, whatever it sees.
_NEAREST, _FARTHEST = 0.15, 1.8
# m; largest side of a scene or a part of one, and of what a hand holds.
_LARGE, _SMALL = 3.0, 0.015
# Points by which things are separated, joined where nearer than so many medians of their distances; the share of the
# points that makes a thing.
_POINTS, _JOINED, _THING = 2000, 4.0, 0.05
# Of the points in one plane: more, and it is none of the things.
_TABLE = 0.3
# m of its narrow side, where the depth tells the scale as well; less is a side of a thing.
_WIDE = 0.06
# Points of what stands on the plane of a cloud: fewer are too sparse to tell its size.
_MANY = 300
# Counts a metre that cameras and data sets write.
_COUNTS = {1000: "millimetres", 5000: "TUM RGB-D", 4000: "RealSense L515", 10000: "D405, YCB-Video", 100: "centimetres"}


def check_depth_image(view: View) -> None:
    """InputError for an image that planes explain less well in metres than in another reading of its numbers."""
    seen = np.flatnonzero((np.isfinite(view.depth) & (view.depth > 0)).ravel())
    if len(seen) < _PIXELS:
        return
    every = view.depth.ravel()[seen]
    steps = _STEPS * every
    if every.max() == 1 and (np.abs(steps - np.rint(steps)) > _BETWEEN).any():
        raise InputError(
            f"{view.name}: expected depths z in m, got numbers of which the largest is exactly 1: a depth buffer, or "
            "depths relative to one another? convert them to metres, with 0 where nothing is"
        )
    chosen = np.random.default_rng(0).choice(seen, _PIXELS, replace=False)
    z, ray = view.depth.ravel()[chosen], view.camera.rays().reshape(-1, 3)[chosen]
    length = np.linalg.norm(ray, axis=1)
    readings = (
        (z, False, "a depth buffer or disparities: a - b / z in place of z; convert them to metres first"),
        (length / z, True, "distances along the rays in place of z; divide them by the length of the pixel's ray"),
    )
    distinct = np.unique(every)  # of rounded numbers every step is a plane
    step = float(np.quantile(np.diff(distinct) / distinct[1:], _CLOSEST)) if len(distinct) > 1 else 0.0
    for near in (each for each in _ON if each > step):
        metres = _on_planes(ray, 1 / z, near, True)
        for numbers, inverse, words in readings:
            if _on_planes(ray, numbers, near, inverse) > metres + _MORE:
                raise InputError(f"{view.name}: expected depths z in m, got {words}")


def _on_planes(pixel: np.ndarray, numbers: np.ndarray, near: float, inverse: bool) -> float:
    """The share of pixels that the largest planes hold, in a reading of the depth in which planes are linear.

    Args:
        pixel: (N, 3) u, v, 1. numbers: (N,) linear in these on a plane. near: see `_ON`.
        inverse: whether the depth is 1 over the numbers; relative errors are the same, to first order.
    """
    generator, left = np.random.default_rng(0), np.arange(len(numbers))
    for _ in range(_PLANES):
        if len(left) < _LEAST:
            break
        corner = left[generator.integers(len(left), size=(_TRIED, 3))]
        corner = corner[np.abs(np.linalg.det(pixel[corner])) > _FLAT]
        if not len(corner):
            break
        planes = np.linalg.solve(pixel[corner], numbers[corner][..., None])[..., 0]
        held = (_off(pixel[left], numbers[left], planes, inverse) < near).sum(axis=1)
        plane = planes[int(held.argmax())]
        for _ in range(2):
            on = left[_off(pixel[left], numbers[left], plane[None], inverse)[0] < near]
            if len(on) >= _LEAST:
                plane = np.linalg.lstsq(pixel[on], numbers[on], rcond=None)[0]
        left = left[_off(pixel[left], numbers[left], plane[None], inverse)[0] >= near]
    return 1 - len(left) / len(numbers)


def _off(pixel: np.ndarray, numbers: np.ndarray, planes: np.ndarray, inverse: bool) -> np.ndarray:
    """(P, N) how far pixels are off planes (P, 3), as a share of their depth."""
    there = planes @ pixel.T
    if not inverse:
        return np.abs(there / numbers - 1)
    return np.abs(numbers / np.where(there == 0, np.inf, there) - 1)


def size_notes(largest: LargestPlane, views: Sequence[View] | None, alone: bool) -> list[str]:
    """Lines that say how far and how large the target is, and a warning where no camera and no hand would have it so.

    Args:
        largest: the targets' points and their largest plane. views: of depth images, in m; None: clouds.
        alone: whether the targets are apart from the table and the rest of the scene.
    """
    points, config = largest.points, largest.config
    sides = _sides(points)
    size = " x ".join(f"{side:.3f}" for side in sides)
    median = _median(views) if views else None
    lines = [("" if median is None else f"depth: median {median:.3f} m; ") + f"extent of the target: {size} m"]
    alone = alone or config.mask is not None or config.segments is not None
    wide = config.table_width if median is None else _WIDE
    apart = points if alone else _off_plane(largest, wide)
    thing = _thing(apart) if median is not None or len(apart) >= _MANY else None
    if _usual(median, thing) and _SMALL <= sides[0] <= _LARGE:
        return lines
    what = f"a target of {size} m" if thing is None else f"things that measure {thing:.2g} m across"
    if median is None:
        remedy = f"another unit? (unit={config.unit})"
    else:
        what = f"a median depth of {median:.3g} m" + (f" with {what}" if thing is not None else "")
        remedy = _scales(median, thing, views or (), config)
    return [*lines, f"warning: {what} is unusual for grasping; {remedy}"]


def unusual_depth(views: Sequence[View], config: SceneConfig) -> str:
    """What to try where depth images are refused for something else, but are unusually near or far; "" where not."""
    median = _median(views)
    usual = _usual(median, None)
    return "" if usual else f"a median depth of {median:.3g} m is unusual: {_scales(median, None, views, config)}"


def _median(views: Sequence[View]) -> float:
    return float(np.median(np.concatenate([v.depth[np.isfinite(v.depth) & (v.depth > 0)] for v in views])))


def _scales(median: float, thing: float | None, views: Sequence[View], config: SceneConfig) -> str:
    """The scales of counts that make a median depth, and the size of things, m, usual."""
    taken = {view.scale for view in views}
    if taken == {None}:
        return f"another unit? (unit={config.unit}), or made of counts of another scale?"
    fitting = []
    if len(taken) == 1:
        counts = 1 / next(scale for scale in taken if scale)  # as many were taken for a metre
        fitting = [
            f"{1 / n:g} ({words})"
            for n, words in _COUNTS.items()
            if n != round(counts) and _usual(median * counts / n, None if thing is None else thing * counts / n)
        ]
    return f"depth_scale={' or '.join(fitting)} would make it usual" if fitting else "another depth_scale or unit?"


def _usual(median: float | None, thing: float | None) -> bool:
    """Whether a scene may have this median depth and things of this size, m, as far as they are known."""
    if median is not None and not _NEAREST <= median <= _FARTHEST:
        return False
    if median is None:
        return thing is None or bool(_NEAR <= np.log(thing / _SIDE) / _SPREAD_ALONE <= _FAR)
    known = [np.log(value / usual) for value, usual in ((median, _DEPTH), (thing, _SIDE)) if value]
    return bool(_NEAR <= sum(known) / (_SPREAD * np.sqrt(len(known))) <= _FAR)


def _thing(points: np.ndarray) -> float | None:
    """The middle side, m, of the usual one of the things that points (N, 3) make up; None without."""
    if len(points) < _LEAST:
        return None
    some = np.random.default_rng(0).choice(len(points), min(len(points), _POINTS), replace=False)
    points = points[some]
    tree = cKDTree(points)
    joined = _JOINED * float(np.median(tree.query(points, 2)[0][:, 1]))
    pairs = tree.query_pairs(joined, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (len(points), len(points)))
    label = connected_components(links, directed=False)[1]
    things = [points[label == k] for k in np.flatnonzero(np.bincount(label) >= max(4, _THING * len(points)))]
    return float(np.median([_sides(thing)[1] for thing in things])) if things else None


def _sides(points: np.ndarray) -> np.ndarray:
    """(3,) m, the sides of the box along the principal axes of points (N, 3), longest first, without stray points."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    low, high = np.quantile(points @ axes.T, [0.01, 0.99], axis=0)
    return np.sort(high - low)[::-1]


def _off_plane(largest: LargestPlane, wide: float) -> np.ndarray:
    """The points off their largest plane, if that is wide and holds many; none otherwise."""
    points, found = largest.points, largest.found
    if found is None or found.share < _TABLE or found.width < wide:
        return points[:0]
    return points[np.abs(height(points, found.plane)) > largest.config.table_distance]
