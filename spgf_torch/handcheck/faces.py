"""Where fingers that curl, and a single jaw, take hold: pads that closing from far out does not find.

Two jaws that move towards each other need none of it: where they meet is measured (`spgf_torch.hands.pads`).
"""

from __future__ import annotations

import numpy as np

from spgf_torch.handcheck.anatomy import Anatomy, Finger, unit
from spgf_torch.handcheck.grouping import Grouping
from spgf_torch.hands.fingers import SKIN, distances, finger_shape

STEPS = 40  # of a jaw's way that are looked at
TURNED = np.radians(60)  # of a single jaw's face against the palm's: what opens by more squeezes things out


def palmar_pad(anatomy: Anatomy, grouping: Grouping, finger: Finger) -> list[float]:
    """The pad of a finger that curls, m in its tip's frame: from the tip's middle on, where its last joint moves it."""
    links = anatomy.at(0.5, grouping.held)
    last = finger.closers[-1]
    moved = grouping.signs[last] * anatomy.velocity(finger, last, 0.5, grouping.held)
    T = links[finger.name]
    towards = unit(T[:3, :3].T @ moved)
    shape = finger_shape(anatomy.robot, finger.name, [finger.name])
    local = {link: np.linalg.inv(T) @ links[link] for link, _ in shape.planes}
    points = shape.points_at({link: local[link] for link in shape.points})
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    aside = np.linalg.norm((points - middle) - np.outer((points - middle) @ towards, towards), axis=1)
    near = points[aside <= np.partition(aside, min(20, len(aside) - 1))[min(20, len(aside) - 1)]]
    return _shown(near[np.argmax(near @ towards)])


def jaw_pads(anatomy: Anatomy, grouping: Grouping, finger: Finger, palm: str) -> tuple[dict[str, list[float]], float]:
    """Pads of a jaw and of the palm that it closes on, each in its link's frame, and the joint's value there.

    The hinge, where both are always close, is left out: the far half of the jaw counts.
    """
    joint = finger.closers[0]
    low, high = anatomy.span(joint)
    open_, closed = (low, high) if grouping.signs[joint] > 0 else (high, low)
    jaw = finger_shape(anatomy.robot, finger.name, list(finger.bodies))
    other = finger_shape(anatomy.robot, palm, [anatomy.palm])
    best: tuple[float, float, np.ndarray, np.ndarray] | None = None
    for value in np.linspace(open_, closed, STEPS):
        links = anatomy.at(0.5, {joint: value})
        points = jaw.points_at(links)
        away = np.linalg.norm(points - links[finger.chain[-1].child][:3, 3], axis=1)
        far = points[away >= np.median(away)]
        gaps = distances(far, [other], links)
        if best is None or gaps.min() < best[0]:
            best = float(gaps.min()), float(value), far, gaps
        if best[0] <= 0:
            break
    assert best is not None
    _, value, far, gaps = best
    links = anatomy.at(0.5, {joint: value})
    face = far[gaps <= gaps.min() + SKIN]
    pad = face[np.linalg.norm(face - (face.min(axis=0) + face.max(axis=0)) / 2, axis=1).argmin()]
    beside = other.points_at(links)
    opposite = beside[np.linalg.norm(beside - pad, axis=1).argmin()]
    return {
        finger.name: _local(links[finger.name], pad),
        palm: _local(links[anatomy.palm], opposite),
    }, value


def _local(T: np.ndarray, point: np.ndarray) -> list[float]:
    return _shown(T[:3, :3].T @ (point - T[:3, 3]))


def _shown(point: np.ndarray) -> list[float]:
    return [round(float(value), 4) for value in point]
