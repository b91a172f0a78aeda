"""A preshape of a hand as shapes in space: what picture and page draw. Base frame, m."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spgf_torch.handcheck.posed import Posed

SIDES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")  # of opposing groups in turn (Okabe and Ito)
PALM, PASSIVE, IDLE = "#c9d0d6", "#efe3c4", "#a9b4bd"  # the palm, what is not simulated, and fingers that do not close
AXES = (("#c8102e", "closing"), ("#2c7d32", ""), ("#1f4fd8", "approach"))  # of the TCP
TCP_LENGTH, JOINT_LENGTH = 0.04, 0.012  # m of an axis that is drawn, from the TCP and each way from a joint


@dataclass(frozen=True)
class Part:
    """One convex piece: its link, colour, vertices (V, 3) in the link's frame, faces (F, 3)."""

    link: str
    colour: str
    vertices: np.ndarray
    faces: np.ndarray


def parts(posed: Posed) -> list[Part]:
    """All collision shapes, coloured by the group of their finger."""
    colours = _colours(posed)
    found = []
    for piece in posed.hand.robot.collisions:
        mesh = piece.mesh.copy().apply_transform(piece.T_link_shape)
        colour = PASSIVE if piece.link in posed.hand.robot.passive else colours[posed.bodies[piece.link]]
        found.append(Part(piece.link, colour, np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    return found


def _colours(posed: Posed) -> dict[str, str]:
    """Body -> colour: that of its group where it counts as touching, else palm or idle."""
    fingers = posed.hand.config.fingers
    colours = {body: IDLE if first else PALM for body, first in posed.fingers_of.items()}
    for index, group in enumerate(posed.groups):
        for link in (link for finger in group for link in fingers[finger]):
            colours[posed.bodies[link]] = SIDES[index % len(SIDES)]
    return colours


def poses(posed: Posed, fractions: np.ndarray) -> list[dict[str, np.ndarray]]:
    """Link -> T_base_link (4, 4) at fractions (F,) of the way from open to closed."""
    start, end = posed.preshape.joints, posed.preshape.closed
    along = posed.kinematics.along([{n: start[n] + float(f) * (end[n] - start[n]) for n in start} for f in fractions])
    return [{link: T[index] for link, T in along.items()} for index in range(len(fractions))]


def joint_lines(posed: Posed, links: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Joint that moves -> (2, 3) its axis, to the side that its value grows about or along."""
    lines = {}
    for name, joint in posed.kinematics.moving.items():
        T = links[joint.child]
        lines[name] = np.stack([T[:3, 3] + sign * JOINT_LENGTH * (T[:3, :3] @ joint.axis) for sign in (-1, 1)])
    return lines


def tcp_lines(posed: Posed) -> np.ndarray:
    """(3, 2, 3): the axes of the TCP."""
    T = posed.preshape.T_base_tcp
    return np.stack([np.stack([T[:3, 3], T[:3, 3] + TCP_LENGTH * T[:3, axis]]) for axis in range(3)])
