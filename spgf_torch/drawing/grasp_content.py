"""What the script of a grasp page draws: plain values and packed arrays, all in the input's frame, m, about one origin.

A page is sent by mail: clouds are thinned by chance to `TARGET` and `REST` points, and of the best grasps `VOTES` votes
are kept, the strongest `EACH` of one grasp. What was left out is counted, so that the page can say so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from spgf_torch.drawing.grasp_scene import FINGER, HANDLE, Beside, Eye, across
from spgf_torch.drawing.judge_words import WeighedNumber
from spgf_torch.drawing.outline import outline
from spgf_torch.drawing.packed import packed, packed_points, packed_units
from spgf_torch.drawing.page_hands import closing_content
from spgf_torch.drawing.style import SUCCESS_SCALE, prototype_colours
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

TARGET, REST = 12_000, 16_000  # points of targets, and of all else, that a page holds at most
VOTES, EACH = 12_000, 600  # votes that a page holds at most, and of one grasp
NEAR = 0.25  # m about the targets: what else was sensed there is kept first
DOTS = 0.65, 0.9  # radius of a point of targets and of the rest, of the distance to its sixth neighbour: they touch
NEIGHBOURS = 6
MARGIN = 0.08  # m of the table that are drawn around the targets
DIGITS, TURNS = 5, 6  # decimals of m, and of the numbers of a rotation
CAMERA = 0.04  # m, length of a camera's pyramid


def page_content(
    points: np.ndarray,
    normals: np.ndarray,
    grasps: Sequence[Grasp],
    grippers: Mapping[str, Gripper],
    eye: Eye,
    names: Sequence[str],
    beside: Beside,
) -> dict[str, Any]:
    """Everything that a page draws, ready for JSON.

    Args:
        points, normals: (M, 3), m and unit, of the targets. grasps: best first. eye: where to look from at first.
        names: a word for each prototype; may be empty.
    """
    origin = np.round((points.min(axis=0) + points.max(axis=0)) / 2, DIGITS)
    for grasp in grasps:
        gripper_for(grasp, grippers)
    votes, kept = _votes(grasps, origin)
    voted = {k for grasp in grasps for k, _ in grasp.voted_by}
    voted |= {k for grasp in grasps if grasp.voters is not None for k in np.unique(grasp.voters.prototype).tolist()}
    return {
        "origin": origin.tolist(),
        "up": eye.up.tolist(),
        "eyes": {name: place.round(4).tolist() for name, place in eyes(eye).items()},
        "half": (np.ptp(points, axis=0) / 2).round(DIGITS).tolist(),
        "clouds": _clouds(points, normals, beside, origin),
        "table": _table(points, beside.table, origin),
        "cameras": [_camera(place, axes, reach, origin) for place, axes, reach in beside.cameras],
        "scale": SUCCESS_SCALE,
        "hands": {
            name: {
                **closing_content(gripper, beside.closing.get(name)),
                "outline": outline(gripper, FINGER, HANDLE).round(DIGITS).tolist(),
            }
            for name, gripper in (grippers.items() if grasps else ())
        },
        "targets": len({grasp.target for grasp in grasps}),
        "grasps": [
            _grasp(*known, origin) for known in zip(grasps, kept, beside.weighed or [()] * len(grasps), strict=True)
        ],
        "votes": votes,
        "prototypes": _prototypes(voted, names, beside.pictures),
    }


def eyes(eye: Eye) -> dict[str, np.ndarray]:
    """Unit vectors from the targets to places to look from."""
    right, level = eye.axes[0], np.cross(eye.axes[0], eye.up)  # level: towards the eye, but not up
    height = float(eye.towards @ eye.up)
    places = {"front": eye.towards, "left": height * eye.up - right, "right": height * eye.up + right}
    places |= {"back": height * eye.up - level, "above": eye.up + 0.05 * eye.towards}
    return {name: place / np.linalg.norm(place) for name, place in places.items()}


def _clouds(points: np.ndarray, normals: np.ndarray, beside: Beside, origin: np.ndarray) -> list[dict[str, Any]]:
    """The targets, then what else was sensed, if anything was: points, normals, colours, the radius of a point."""
    seen = beside.sensed
    if seen is None or not seen.target.any():
        own, colours = points, None
    else:
        own, colours = seen.points[seen.target], None if seen.colours is None else seen.colours[seen.target]
    shown = _chosen(len(own), TARGET)
    own = own[shown]
    facing = normals[cKDTree(points).query(own)[1]]
    clouds = [_cloud(own, facing, None if colours is None else colours[shown], origin, DOTS[0])]
    rest, colours = beside.obstacles, None
    if seen is not None and seen.colours is not None and not seen.target.all():  # the table too, as a photograph
        rest, colours = seen.points[~seen.target], seen.colours[~seen.target]
    if not len(rest):
        return clouds
    near = ((rest >= points.min(axis=0) - NEAR) & (rest <= points.max(axis=0) + NEAR)).all(axis=1)
    order = np.concatenate([np.flatnonzero(near)[_chosen(int(near.sum()), REST)], np.flatnonzero(~near)])[:REST]
    return [*clouds, _cloud(rest[order], None, None if colours is None else colours[order], origin, DOTS[1])]


def _chosen(count: int, most: int) -> np.ndarray:
    """`most` of so many, by chance, or all."""
    return np.random.default_rng(0).permutation(count)[:most] if count > most else np.arange(count)


def _cloud(
    points: np.ndarray, normals: np.ndarray | None, colours: np.ndarray | None, origin: np.ndarray, dot: float
) -> dict[str, Any]:
    nearest = cKDTree(points).query(points[:: max(1, len(points) // 1000)], k=min(NEIGHBOURS + 1, len(points)))[0]
    radius = dot * float(np.median(nearest.reshape(-1, min(NEIGHBOURS + 1, len(points)))[:, -1])) or 0.002
    content = {"points": packed_points(points, origin), "radius": round(radius, DIGITS)}
    content |= {} if normals is None else {"normals": packed_units(normals)}
    return content | ({} if colours is None else {"colours": packed(colours, "u1")})


def _table(points: np.ndarray, table: np.ndarray | None, origin: np.ndarray) -> list[list[float]] | None:
    """Four corners of the table under the targets and `MARGIN` around them, about the origin."""
    if table is None:
        return None
    normal = table[:3] / np.linalg.norm(table[:3])
    u, v = (axis[0] for axis in across(normal[None]))
    foot = points - (points @ table[:3] + table[3])[:, None] * table[:3]
    flat = (foot - origin) @ np.stack([u, v], axis=1)
    (a, b), (c, d) = flat.min(axis=0) - MARGIN, flat.max(axis=0) + MARGIN
    height = float((foot[0] - origin) @ normal) * normal
    corners: list[list[float]] = [
        (height + x * u + y * v).round(DIGITS).tolist() for x, y in ((a, b), (c, b), (c, d), (a, d))
    ]
    return corners


def _camera(place: np.ndarray, axes: np.ndarray | None, reach: np.ndarray | None, origin: np.ndarray) -> dict[str, Any]:
    """Where a camera stood and, where its image is known, the corners of a small pyramid towards what it saw."""
    eye = place - origin
    if axes is None or reach is None:
        return {"eye": eye.round(DIGITS).tolist()}
    (left, top), (right, bottom) = reach
    rays = np.array([[left, top, 1], [right, top, 1], [right, bottom, 1], [left, bottom, 1.0]]) @ axes.T
    return {"eye": eye.round(DIGITS).tolist(), "corners": (eye + CAMERA * rays).round(DIGITS).tolist()}


def _grasp(
    grasp: Grasp, votes: Mapping[str, int], weighed: Sequence[WeighedNumber], origin: np.ndarray
) -> dict[str, Any]:
    """A grasp: 3 x 4 numbers of its pose, row by row, and what is told of it."""
    T = grasp.T_input_tcp
    pose = np.hstack([T[:3, :3].round(TURNS), (T[:3, 3] - origin).round(DIGITS)[:, None]]) + 0.0
    back = float(np.linalg.norm(T[:3, 3] - grasp.T_input_pregrasp[:3, 3]))
    return {
        "type": grasp.type,
        "target": grasp.target,
        "probability": round(grasp.probability, 4),
        "pose": pose.ravel().tolist(),
        "back": round(back, DIGITS),
        "support": grasp.support,
        "voted": [list(pair) for pair in grasp.voted_by],
        "judged": None if grasp.judged is None else [round(each, 4) for each in grasp.judged],
        "weighed": [{**asdict(number), "moved": round(number.moved, 3)} for number in weighed],
        "votes": dict(votes),
    }


def _votes(grasps: Sequence[Grasp], origin: np.ndarray) -> tuple[dict[str, Any], list[dict[str, int]]]:
    """The votes of the best grasps one after another, and of each grasp where its own begin, how many there are of
    them and how many are left out."""
    kept: list[dict[str, int]] = []
    parts: list[tuple[np.ndarray, ...]] = []
    first = 0
    for voters in (grasp.voters for grasp in grasps):
        count = 0 if voters is None else len(voters.gain)
        room = min(count, EACH, VOTES - first)
        kept.append({"first": first, "count": room, "left": count - room})
        first += room
        if voters is not None and room:
            strong = np.argsort(-np.abs(voters.gain), kind="stable")[:room]
            columns = (
                voters.position,
                voters.normal,
                voters.prototype,
                voters.gain,
                voters.probability,
                voters.support,
            )
            parts.append(tuple(column[strong] for column in columns))
    if not parts:
        return {}, kept
    position, normal, prototype, gain, probability, support = (np.concatenate(c) for c in zip(*parts, strict=True))
    return {
        "points": packed_points(position, origin),
        "normals": packed_units(normal),
        "prototype": packed(prototype, "u2"),
        "gain": packed(gain, "f4"),
        "probability": packed(np.rint(255 * probability.clip(0, 1)), "u1"),
        "support": packed(support, "f4"),
    }, kept


def _prototypes(voted: Iterable[int], names: Sequence[str], pictures: Mapping[int, str]) -> dict[str, dict[str, str]]:
    """Name, colour and picture (SVG) of each prototype that voted, by its number."""
    shown = sorted(voted)
    colours = prototype_colours(max(shown, default=-1) + 1)
    return {
        str(k): {
            "name": names[k] if k < len(names) else f"#{k}",
            "colour": colours[k],
            "picture": pictures.get(k, ""),
        }
        for k in shown
    }
