"""From which side a cloud was seen whose file does not say it: by its pixels, its frame, its shape, or not at all.

Writers put the origin where they know no viewpoint, so a file's silence and its identity VIEWPOINT mean the same:
unknown. The side matters: normals turned the wrong way make hands come through the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from spgf_torch.config import InputError, SceneConfig
from spgf_torch.scene.cloud import Cloud
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
# Optical frames look along z (or -z, OpenGL's): nearly all points lie within 60 deg of it; within 45 deg of most.
_WIDEST, _USUAL, _IN_VIEW = np.tan(np.deg2rad(60)), 1.0, 0.99
# A camera's pixels are a grid: of its points as seen from its centre, nearly all have a neighbour as far as the others.
_GRID, _EVEN = 0.8, 0.05
# A shape that bulges towards a place below it is a bowl seen from above; cameras rarely look up.
_LOOKS_UP = -0.1
# Mean of n . u, below which normals turned to the origin speak against it: nothing but the frame speaks for it here.
_HOLLOW = 0.25
# A table tells the side where nearly all that is not on it lies on one side, and there is something.
_ABOVE, _SOMETHING = 0.97, 0.01
# Rows and columns of an image meet their rays' origin to this share of the distance, if it is one camera's image.
_PINHOLE, _PIXELS = 0.01, 200


@dataclass(frozen=True)
class Side:
    """Where a cloud was seen from: eye (3,), m, or a place far out on that side; words for people."""

    eye: np.ndarray
    words: str


def with_viewpoint(cloud: Cloud, raw: Cloud, config: SceneConfig, notes: list[str]) -> Cloud:
    """The cloud with a viewpoint, if it has neither normals nor viewpoints; a line in `notes` says whence.

    In this order: where its pixels' rays meet; the origin, from where its points are a grid of pixels; the side of the
    things on a table; the origin of its frame, where that is an optical frame and nothing speaks against it; the side
    from which it is a bulge without hidden points.

    Args:
        cloud: m, thinned.
        raw: the same before, with the pixels of its points.

    Raises:
        InputError, which names viewpoints=, where none of these tells it.
    """
    if cloud.normals is not None or cloud.viewpoints is not None:
        return cloud
    side = _of_pixels(raw) or _of_grid(raw) or _of_frame_or_shape(cloud, config)
    if side is None:
        raise InputError(
            f"{cloud.name}: expected normals or a viewpoint that tells their side, got neither, and its shape does not "
            "tell from where it was seen; give viewpoints=[[x,y,z],...], where the camera was in the cloud's frame"
        )
    notes.append(f"viewpoint: {cloud.name} does not say it; {side.words}")
    return replace(cloud, viewpoints=side.eye[None])


def check_side(cloud: Cloud, config: SceneConfig, notes: list[str]) -> None:
    """InputError for estimated normals that point inwards from the viewpoints given, where the shape says so.

    Args:
        cloud: with normals that were turned to its viewpoints.
        notes: gets a warning where they look inwards, but nothing tells the other side: the inside of a bin.
    """
    assert cloud.normals is not None and cloud.viewpoints is not None
    if len(cloud) < 10 or (found := outwardness(cloud.points, cloud.normals)) >= INWARDS:
        return
    side = _of_shape(*_unsigned(cloud, config))
    where = ", ".join(f"{x:.4g}" for x in np.mean(cloud.viewpoints, axis=0))
    if side is not None:
        raise InputError(
            f"{cloud.name}: expected a viewpoint on the side that was seen, got ({where}) m, from where its normals "
            f"point inwards ({found:.2f}); {side.words}: give viewpoints=[[x,y,z],...], where the camera was"
        )
    notes.append(
        f"warning: {cloud.name}: seen from ({where}) m the surface looks hollow ({found:.2f}): right for the inside of "
        "a bin; else give viewpoints=[[x,y,z],...], where the camera was"
    )


_ORIGIN = "taken for the origin, as in a camera's frame, which its points agree with"


def _of_grid(cloud: Cloud) -> Side | None:
    """The origin, where the points are a grid of pixels as seen from there."""
    if len(cloud) < _PIXELS or not _optical(cloud.points, _WIDEST):
        return None
    image = cloud.points[:, :2] / cloud.points[:, 2:]
    apart = cKDTree(image).query(image[: 4 * _POINTS], 2)[0][:, 1]
    apart = apart[apart > 1e-9]  # points that were written twice
    if not len(apart):
        return None
    even = np.abs(apart / np.median(apart) - 1) < _EVEN
    return Side(np.zeros(3), _ORIGIN) if even.mean() >= _GRID else None


def _of_frame_or_shape(cloud: Cloud, config: SceneConfig) -> Side | None:
    points, normals, pitch = _unsigned(cloud, config)
    if len(points) < 10:
        return None
    plane, optical = _of_plane(points, config), _optical(cloud.points, _USUAL)
    origin = Side(np.zeros(3), _ORIGIN)
    if plane is not None:
        agrees = optical and not _contradicted(np.zeros(3), points, normals, pitch, plane)
        return origin if agrees else plane
    shape = _of_shape(points, normals, pitch)
    if optical:  # whatever speaks against the origin then leaves it open
        return None if _contradicted(np.zeros(3), points, normals, pitch, shape) else origin
    looks_up = shape is not None and (shape.eye - points.mean(axis=0))[2] < _LOOKS_UP * _far_out(points)
    return None if looks_up else shape


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


def _optical(points: np.ndarray, widest: float) -> bool:
    """Whether the points lie as a camera at the origin sees them: before it along z, or along -z.

    Args:
        widest: tangent of the angle that they may be off it.
    """
    z = np.abs(points[:, 2])
    ahead = (np.abs(points[:, :2]).max(axis=1) <= widest * z) & (z > 0)
    share = max(float((ahead & (points[:, 2] > 0)).mean()), float((ahead & (points[:, 2] < 0)).mean()))
    return share >= _IN_VIEW


def _contradicted(eye: np.ndarray, points: np.ndarray, normals: np.ndarray, pitch: float, evident: Side | None) -> bool:
    """Whether the points cannot have been seen from `eye`, or were evidently seen from elsewhere."""
    ray = points - eye
    if float((ray @ ray.mean(axis=0) <= 0).mean()) > BEHIND:
        return True
    turned, hidden = facing(points, normals, eye[None], pitch)
    if evident is not None:
        other = facing(points, normals, evident.eye[None], pitch)[0]
        return _differ(turned, other) > 0.5
    return outwardness(points, turned) < _HOLLOW or hidden_share(hidden, pitch) > 2 * _DIFFERENT


def _of_plane(points: np.ndarray, config: SceneConfig) -> Side | None:
    """The side of a table on which all else is."""
    found = best_plane(points, config, np.random.default_rng(0))
    if found is None or found.share < config.table_share or found.width < config.table_width:
        return None
    up = height(points, found.plane)
    above, below = (float((sign * up > 2 * config.table_distance).mean()) for sign in (1, -1))
    if max(above, below) < _SOMETHING or max(above, below) < _ABOVE * (above + below):
        return None
    normal = found.plane[:3] * (1.0 if above > below else -1.0)
    eye = points.mean(axis=0) + _far_out(points) * normal
    return Side(eye, f"seen from the side of what stands on its largest plane, {_words(normal)}")


def _of_shape(points: np.ndarray, normals: np.ndarray, pitch: float) -> Side | None:
    """The side from which the surface bulges and hides nothing of itself, if it is the only one."""
    middle, away = points.mean(axis=0), _far_out(points)
    outermost, outwards = extremes(points)
    found = []
    for direction in sphere(_SIDES):
        turned, hidden = facing(points, normals, (middle + away * direction)[None], pitch)
        bulge, unseen = float((turned[outermost] * outwards).sum(axis=1).mean()), hidden_share(hidden, pitch)
        if bulge > _BULGE - _CLEARER:
            found.append((bulge - unseen, bulge, unseen, direction, turned))
    if not found:
        return None
    found.sort(key=lambda one: -one[0])
    score, bulge, unseen, _, turned = found[0]
    differ = [_differ(turned, one[4], np.abs(normals @ one[3])) for one in found]
    alike = [one for one, share in zip(found, differ, strict=True) if share <= _DIFFERENT]
    rival = max((one[0] for one, share in zip(found, differ, strict=True) if share > _DIFFERENT), default=-np.inf)
    if bulge < _BULGE or unseen > _CLEAR or rival > score - _CLEARER:
        return None
    good = np.sum([one[3] for one in alike if one[0] > score - _CLEARER], axis=0)
    length = float(np.linalg.norm(good))
    direction = good / length if length > 0 else found[0][3]
    if _differ(turned, facing(points, normals, (middle + away * direction)[None], pitch)[0]) > _DIFFERENT:
        direction = found[0][3]
    return Side(middle + away * direction, f"its shape was evidently seen from {_words(direction)}")


def _of_pixels(cloud: Cloud) -> Side | None:
    """The camera's centre, where the points are an image: the projection from points to pixels, solved for.

    Hartley and Zisserman, Multiple View Geometry, sections 6.2 (centre = null vector of P) and 7.1 (DLT).
    """
    if cloud.pixels is None or len(cloud.pixels) < _PIXELS:
        return None
    chosen = np.linspace(0, len(cloud) - 1, min(len(cloud), _POINTS)).astype(int)
    X, x = cloud.points[chosen], cloud.pixels[chosen][:, ::-1].astype(np.float64)
    middle, size = X.mean(axis=0), X.std() or 1.0
    flat = np.linalg.svd(X - middle, compute_uv=False)
    if flat[2] < 0.02 * flat[0]:  # points of a plane have many cameras
        return None
    homogeneous = np.column_stack([(X - middle) / size, np.ones(len(X))])
    x = (x - x.mean(axis=0)) / (x.std() or 1.0)
    zero = np.zeros_like(homogeneous)
    rows = np.concatenate(
        [
            np.hstack([homogeneous, zero, -x[:, :1] * homogeneous]),
            np.hstack([zero, homogeneous, -x[:, 1:] * homogeneous]),
        ]
    )
    P = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
    image = homogeneous @ P.T
    depth = image[:, 2]
    centre = np.linalg.svd(P)[2][-1]
    if abs(centre[3]) < 1e-9 or not ((depth > 0).all() or (depth < 0).all()):
        return None
    error = float(np.median(np.abs(image[:, :2] / depth[:, None] - x)))
    eye = middle + size * centre[:3] / centre[3]
    if error > _PINHOLE:
        return None
    return Side(eye, f"its pixels' rays meet at ({', '.join(f'{v:.3f}' for v in eye)}) m")


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
