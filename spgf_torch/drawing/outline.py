"""Light outlines of open hands, as line segments: where there are many grasps, whole hands would hide each other.

A two-finger jaw is a fork: axis of approach, palm, two fingers `width` apart. Any other hand is drawn from its own
collision shapes: axis of approach, and for each finger a spoke from the axis and the edge that faces it, up to the tip.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise

import numpy as np
import trimesh

from spgf_torch.hands.records import Gripper

LEVELS = 7  # heights at which the edge of a finger is looked up
NEAR = 0.001  # m; shapes no farther apart are of one finger
STRAIGHT = 0.0005  # m; an edge that bends less is one line


def outline(gripper: Gripper, behind: float, handle: float, tips: bool = True) -> np.ndarray:
    """(S, 2, 3) m in the tcp frame, the axis of approach first.

    Args:
        behind: m of the hand that are drawn behind the TCP. handle: m of the axis behind that.
        tips: a jaw's fingers end at their tips, else at the TCP.
    """
    if gripper.jaw:
        return fork(gripper.width, behind, handle, gripper.depth if tips else 0.0)
    return edges(gripper.shapes, behind, handle)


def outline_words(grippers: Mapping[str, Gripper], at: str = "the pads") -> str:
    """What the outlines show, in a sentence for a caption; those of jaws end `at` a place."""
    jaws = [gripper.jaw for gripper in grippers.values()]
    fork = f"A fork is the open hand: approach axis, palm, and two fingers that end at {at}."
    if all(jaws):
        return fork
    lines = "Lines are the open hand: approach axis, palm, and the side of each finger that faces the axis."
    return f"{fork} {lines}" if any(jaws) else lines


def fork(width: float, behind: float, handle: float, front: float) -> np.ndarray:
    """(4, 2, 3): axis of approach, palm, and two fingers `width` apart, `behind` to `front` along the approach, m."""
    half = width / 2
    palm = [[-half, 0, -behind], [half, 0, -behind]]
    fingers = [[[x, 0, -behind], [x, 0, front]] for x in (-half, half)]
    return np.array([[[0, 0, -behind - handle], [0, 0, -behind]], palm, *fingers])


def edges(shapes: Sequence[trimesh.Trimesh], behind: float, handle: float) -> np.ndarray:
    """(S, 2, 3): axis of approach; of each finger a spoke from the axis and the edge that faces it.

    A shape that covers the axis is the palm, which the fingers stand on; shapes that touch are one finger.
    """
    palm = [shape for shape in shapes if _covers_axis(shape)]
    foot = max([-behind, *(float(shape.bounds[1, 2]) for shape in palm if shape.bounds[1, 2] < 0)])
    standing = [shape for shape in shapes if shape.bounds[1, 2] > foot and not _covers_axis(shape)]
    lines = [[[0.0, 0.0, foot - handle], [0.0, 0.0, foot]]]
    for finger in _touching(standing, foot):
        edge = _edge(finger, foot)
        lines += [[[0.0, 0.0, foot], edge[0]]] if edge[0, 2] < foot + NEAR else []
        lines += [[a, b] for a, b in pairwise(edge.tolist())]
    return np.array(lines, dtype=np.float64)


def _touching(shapes: Sequence[trimesh.Trimesh], foot: float) -> list[list[trimesh.Trimesh]]:
    """Groups of shapes whose boxes, cut off at the height `foot`, touch."""
    boxes = [np.maximum(shape.bounds, [[-np.inf, -np.inf, foot]] * 2) for shape in shapes]
    group = list(range(len(shapes)))
    for i, j in combinations(range(len(shapes)), 2):
        if (boxes[i][0] <= boxes[j][1] + NEAR).all() and (boxes[j][0] <= boxes[i][1] + NEAR).all():
            group = [group[i] if of == group[j] else of for of in group]
    return [[shapes[i] for i, of in enumerate(group) if of == number] for number in dict.fromkeys(group)]


def _edge(finger: Sequence[trimesh.Trimesh], foot: float) -> np.ndarray:
    """(n, 3) points from the foot to the tip on the side of a finger that faces the axis."""
    low = max(foot, min(float(shape.bounds[0, 2]) for shape in finger))
    high = max(float(shape.bounds[1, 2]) for shape in finger)
    inset = 1e-6 * (high - low)  # not in the very plane of a face
    points = []
    for z in np.linspace(low + inset, high - inset, LEVELS):
        inner = [found for shape in finger if (found := _innermost(shape, z)) is not None]
        points += [[*min(inner, key=np.linalg.norm), z]] if inner else []
    edge = np.array(points)
    along = (edge[-1] - edge[0]) / np.linalg.norm(edge[-1] - edge[0])
    off = np.linalg.norm(np.cross(edge - edge[0], along), axis=1)
    return edge[[0, -1]] if off.max() < STRAIGHT else edge


def _innermost(shape: trimesh.Trimesh, z: float) -> np.ndarray | None:
    """(2,) where the way to the axis from the middle of a convex shape's section at height z leaves it, if any."""
    section = _section(shape, z)
    if not len(section):
        return None
    middle = section.mean(axis=0)
    normal = np.array([-middle[1], middle[0]])  # off the way; the way itself is t in middle (1 - t), t from 0
    off, way = section @ normal, 1 - section @ middle / max(float(middle @ middle), 1e-12)
    i, j = np.triu_indices(len(section), 1)
    crossing = (off[i] * off[j] <= 0) & (off[i] != off[j])
    i, j = i[crossing], j[crossing]
    if not len(i):
        return middle
    share = off[i] / (off[i] - off[j])
    leaves: np.ndarray = middle * (1 - float((way[i] + share * (way[j] - way[i])).max()))
    return leaves


def _section(shape: trimesh.Trimesh, z: float) -> np.ndarray:
    """(n, 2) where the edges of a mesh pass the height z."""
    a, b = (shape.vertices[shape.edges_unique[:, k]] for k in (0, 1))
    passing = (a[:, 2] - z) * (b[:, 2] - z) < 0
    a, b = a[passing], b[passing]
    share = (z - a[:, 2]) / (b[:, 2] - a[:, 2])
    points: np.ndarray = (a + share[:, None] * (b - a))[:, :2]
    return points


def _covers_axis(shape: trimesh.Trimesh) -> bool:
    """Whether the approach axis passes a convex shape: no direction across it has all corners on one side."""
    angles = np.linspace(0, np.pi, 64, endpoint=False)
    across = shape.vertices[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    return bool(((across.min(axis=0) < 0) & (across.max(axis=0) > 0)).all())
