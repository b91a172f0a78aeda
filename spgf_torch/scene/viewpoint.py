"""From which side a cloud was seen whose file does not say it: by its pixels, its frame, its shape, or not at all.

Writers put the origin where they know no viewpoint, so a file's silence and its identity VIEWPOINT mean the same:
unknown. The side matters: normals turned the wrong way make hands come through the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.scene.camera_centre import AS_ORIGIN, USUAL, WIDEST, Side, of_grid, of_pixels, optical
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.normals import (
    BEHIND,
    INWARDS,
    extremes,
    facing,
    hidden_share,
    neighbourhoods,
    outwardness,
    principal_normals,
    sphere,
)
from spgf_torch.scene.planes import best_plane, height

# Points that evidence is looked for in: 128 sides of 3000 points take 0.2 s.
_POINTS = 3000
_SIDES = 128
# A side is evident where it shows the cloud as a bulge, with hardly a point behind another. Of 400 single views of our
# 50 objects, noise included, no wrong side passed both.
_BULGE = 0.35
_CLEAR = 0.05
# Two sides that turn more of the normals differently are two answers, if one is no clearer than the other by this.
_DIFFERENT, _CLEARER = 0.1, 0.1
# Mean of n . u, below which a viewpoint that is given is doubted, and refused where the shape tells another side.
_DOUBTFUL = -0.15
# m; what is larger may as well be the corner of a room, whose three sides look from within as a box's from without.
_THING = 0.3
# A shape that bulges towards a place below it is a bowl seen from above; cameras rarely look up.
_LOOKS_UP = -0.1
# Mean of n . u, below which normals turned to the origin speak against it: only the frame speaks for it.
_HOLLOW = 0.25
# A table tells the side where nearly all that is not on it lies on one side, and there is something.
_ABOVE, _SOMETHING = 0.97, 0.01
# Points with neighbours, fewer of which tell nothing.
_FEWEST = 10
# Cosine: cameras that see a table look down on it by 10 deg at least; points on it from which a shape is recognised.
_OVER, _FEW = 0.17, 30


def with_viewpoint(cloud: Cloud, raw: Cloud, config: SceneConfig, notes: list[str]) -> Cloud:
    """The cloud with a viewpoint, if it has neither normals nor viewpoints; a line in `notes` says whence.

    In this order: where its pixels' rays meet; the origin, from where its points are a grid of pixels; the side of the
    things on a table; the origin of its frame, where that is an optical frame and nothing speaks against it; the side
    from which it is a bulge without hidden points.

    Args:
        cloud: m, thinned.
        raw: the same before, with the pixels of its points.

    Raises:
        InputError: which names viewpoints=, where none of these tells it.
    """
    if cloud.normals is not None or cloud.viewpoints is not None:
        return cloud
    side = of_pixels(raw) or of_grid(raw) or _of_frame_or_shape(cloud, config)
    if side is None:
        raise InputError(
            f"{cloud.name}: expected normals or a viewpoint that tells their side, got neither, and its shape does not "
            "tell from where it was seen; give viewpoints=[[x,y,z],...], where the camera was in the cloud's frame"
        )
    notes.append(f"viewpoint: {cloud.name} does not say it; {side.words}")
    return replace(cloud, viewpoints=side.eye[None], guessed=side.guessed)


def ahead_of(clouds: Sequence[Cloud]) -> float:
    """1 where the clouds lie before a camera at the origin along z, -1 along -z, 0 where its frame is no camera's."""
    points = np.concatenate([cloud.points for cloud in clouds])
    return float(np.sign(points[:, 2].mean())) if optical(points, WIDEST) else 0.0


def check_side(cloud: Cloud, config: SceneConfig, notes: list[str]) -> None:
    """InputError for estimated normals that point inwards from the viewpoints given, where the shape says so.

    Args:
        cloud: with normals that were turned to its viewpoints.
        notes: gets a warning where they look inwards, but nothing tells the other side: the inside of a bin.
    """
    assert cloud.normals is not None and cloud.viewpoints is not None
    if len(cloud) < _FEWEST or (found := outwardness(cloud.points, cloud.normals)) >= _DOUBTFUL:
        return
    some = _unsigned(cloud, config)
    side = _of_shape(_looked_at(*some, list(sphere(_SIDES))), *some)
    if found >= INWARDS and (side is None or _alike(cloud.viewpoints.mean(axis=0), side.eye, *some)):
        return
    where = ", ".join(f"{x:.4g}" for x in np.mean(cloud.viewpoints, axis=0))
    if side is not None and np.ptp(cloud.points, axis=0).max() <= _THING:
        raise InputError(
            f"{cloud.name}: expected a viewpoint on the side that was seen, got ({where}) m, from where its normals "
            f"point inwards ({found:.2f}); {side.words}: give viewpoints=[[x,y,z],...], where the camera was"
        )
    notes.append(
        f"warning: {cloud.name}: seen from ({where}) m the surface looks hollow ({found:.2f}): right for the inside of "
        "a bin or a corner; else give viewpoints=[[x,y,z],...], where the camera was"
    )


def _of_frame_or_shape(cloud: Cloud, config: SceneConfig) -> Side | None:
    points, normals, pitch = _unsigned(cloud, config)
    if len(points) < _FEWEST:
        raise InputError(
            f"{cloud.name}: expected points with {config.min_neighbours} others within {config.normal_radius:g} m, got "
            f"{len(points)} of {len(cloud)}; a denser cloud, or a larger normal_radius, and normals or "
            "viewpoints=[[x,y,z],...]"
        )
    plane, ahead = _of_plane(points, normals, pitch, config), optical(cloud.points, USUAL)
    origin = Side(np.zeros(3), AS_ORIGIN, guessed=False)
    if plane is not None:
        return origin if ahead and _alike(np.zeros(3), plane.eye, points, normals, pitch) else plane
    looks = _looked_at(points, normals, pitch, list(sphere(_SIDES)))
    if ahead:  # whatever speaks against the origin then leaves it open
        return origin if _bulges_to(np.zeros(3), looks, points, normals, pitch) else None
    shape = _of_shape(looks, points, normals, pitch)
    looks_up = shape is not None and (shape.eye - points.mean(axis=0))[2] < _LOOKS_UP * _far_out(points)
    return None if looks_up else shape


def _alike(eye: np.ndarray, other: np.ndarray, points: np.ndarray, normals: np.ndarray, pitch: float) -> bool:
    """Whether two places (3,), m, turn most of the normals alike."""
    flipped, again = (facing(points, normals, place[None], pitch)[0] for place in (eye, other))
    return _differ(flipped, again) <= 0.5


def _bulges_to(eye: np.ndarray, looks: Sequence[_Look], points: np.ndarray, normals: np.ndarray, pitch: float) -> bool:
    """Whether the surface bulges to a place (3,), m, and no less than to any other."""
    ray = points - eye
    if float((ray @ ray.mean(axis=0) <= 0).mean()) > BEHIND:
        return False
    flipped, hidden = facing(points, normals, eye[None], pitch)
    score = outwardness(points, flipped) - hidden_share(hidden, pitch)
    return score >= max(_HOLLOW, looks[0].score - _CLEARER)


def _unsigned(cloud: Cloud, config: SceneConfig) -> tuple[np.ndarray, np.ndarray, float]:
    """Some of the points that have neighbours, their normals without a side, and how far apart they are, m."""
    index, pitch = neighbourhoods(cloud.points, config.neighbours, config.normal_radius)
    kept = (index != np.arange(len(index))[:, None]).sum(axis=1) >= config.min_neighbours
    normals = principal_normals(cloud.points, index)[0]
    chosen = np.flatnonzero(kept)
    if len(chosen) > _POINTS:
        pitch *= np.sqrt(len(chosen) / _POINTS)
        chosen = chosen[np.random.default_rng(0).choice(len(chosen), _POINTS, replace=False)]
    return cloud.points[chosen], normals[chosen], pitch


def _of_plane(points: np.ndarray, normals: np.ndarray, pitch: float, config: SceneConfig) -> Side | None:
    """The side of a table on which all else is; there, from where what stands on it bulges most."""
    found = best_plane(points, config, np.random.default_rng(0))
    if found is None or found.share < config.table_share or found.width < config.table_width:
        return None
    up = height(points, found.plane)
    above, below = (float((sign * up > 2 * config.table_distance).mean()) for sign in (1, -1))
    if max(above, below) < _SOMETHING or max(above, below) < _ABOVE * (above + below):
        return None
    normal = found.plane[:3] * (1.0 if above > below else -1.0)
    off = np.abs(up) > 2 * config.table_distance
    over = [direction for direction in sphere(_SIDES) if direction @ normal > _OVER]
    direction = _mean(_looked_at(points[off], normals[off], pitch, over)) if off.sum() >= _FEW else normal
    eye = points.mean(axis=0) + _far_out(points) * direction
    return Side(eye, f"seen from the side of what stands on its largest plane, {_words(direction)}")


@dataclass(frozen=True)
class _Look:
    """A cloud as seen from far out in a direction: how much it bulges, what of it is hidden, its normals from there."""

    direction: np.ndarray
    bulge: float
    unseen: float
    normals: np.ndarray

    @property
    def score(self) -> float:
        return self.bulge - self.unseen


def _looked_at(points: np.ndarray, normals: np.ndarray, pitch: float, directions: Sequence[np.ndarray]) -> list[_Look]:
    """The cloud from each of the directions, the one first from which it bulges most and hides least."""
    middle, away = points.mean(axis=0), _far_out(points)
    outermost, outwards = extremes(points)
    looks = []
    for direction in directions:
        flipped, hidden = facing(points, normals, (middle + away * direction)[None], pitch)
        bulge = float((flipped[outermost] * outwards).sum(axis=1).mean())
        looks.append(_Look(direction, bulge, hidden_share(hidden, pitch), flipped))
    return sorted(looks, key=lambda look: -look.score)


def _mean(looks: Sequence[_Look]) -> np.ndarray:
    """The mean direction of the looks that are hardly worse than the first: faces seen grazing from one are not."""
    good = np.sum([look.direction for look in looks if look.score > looks[0].score - _CLEARER], axis=0)
    length = float(np.linalg.norm(good))
    return good / length if length > 0 else looks[0].direction


def _of_shape(looks: Sequence[_Look], points: np.ndarray, normals: np.ndarray, pitch: float) -> Side | None:
    """The side from which the surface bulges and hides nothing of itself, if it is the only one of its looks."""
    best = looks[0]
    differ = [_differ(best.normals, look.normals, np.abs(normals @ look.direction)) for look in looks]
    alike = [look for look, share in zip(looks, differ, strict=True) if share <= _DIFFERENT]
    rival = max((look.score for look, share in zip(looks, differ, strict=True) if share > _DIFFERENT), default=-np.inf)
    if best.bulge < _BULGE or best.unseen > _CLEAR or rival > best.score - _CLEARER:
        return None
    middle, away, direction = points.mean(axis=0), _far_out(points), _mean(alike)
    if _differ(best.normals, facing(points, normals, (middle + away * direction)[None], pitch)[0]) > _DIFFERENT:
        direction = best.direction
    return Side(middle + away * direction, f"its shape was evidently seen from {_words(direction)}")


def _differ(a: np.ndarray, b: np.ndarray, weight: np.ndarray | None = None) -> float:
    """The share of normals (N, 3) that two ways of turning them turn differently.

    Args:
        weight: (N,), how head-on each is seen: the side of what is seen grazing is noise; None: all count alike.
    """
    return float(np.average((a * b).sum(axis=1) < 0, weights=weight))


def _far_out(points: np.ndarray) -> float:
    """m from the middle of the points to where a camera may stand: well outside of them."""
    return max(0.7, 2.5 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max()))


def _words(direction: np.ndarray) -> str:
    return f"direction ({', '.join(f'{v:.2f}' for v in direction)})"
