"""The open hand of each grasp type, and how it closes, as records."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trimesh

from spgf_torch.hands.robot import Follow


@dataclass(frozen=True)
class Drive:
    """The drive of a joint: Nm/rad, Nm s/rad, Nm; N/m, N s/m, N of one that slides."""

    stiffness: float
    damping: float
    effort: float


@dataclass(frozen=True)
class Closing:
    """How the fingers close.

    Attributes:
        phases: one after the other; each joint -> direction (sign) times share of the effort.
        follow: joints that follow another at every step: URDF mimics, and joints that keep pads parallel.
        effort: Nm or N, of a joint whose share is 1: how far its target may run ahead, times its stiffness.
        speed: rad/s or m/s of the targets. time: s at most, over all phases.
    """

    phases: tuple[dict[str, float], ...]
    follow: dict[str, Follow]
    effort: float
    speed: float
    time: float


@dataclass(frozen=True)
class Preshape:
    """The open hand before a grasp of one type.

    Attributes:
        joints: rad or m, every moving joint of the hand.
        closed: the same with the fingers meeting, or as near as the limits let them.
        T_base_tcp: (4, 4) float64.
        T_base_link: link name -> (4, 4) float64.
        shapes: collision shapes of the open hand, closed convex meshes in the TCP frame, m.
        shape_links: the link of each.
        drives: of every joint that moves: those that close, and those that follow.
        held: joints that stand still.
        closing: how the fingers close.
        groups: of each opposing group of fingers the links whose bodies count as touching.
        touch: groups that must touch for a grasp to be held.
        pads: finger -> (3,) point of its closing face in the base frame, m.
        opening: m between the pads that the description asks for; else what is free between two opposing groups along
            closing at the height of the TCP, or of more groups the diameter that is free about the approach axis.
        jaw: whether two fingers oppose each other, and nothing else closes.
        symmetry: so many turns about the approach make the same grasp.
        sampler: how candidates are drawn: surface_pairs or approach.
    """

    joints: dict[str, float]
    closed: dict[str, float]
    T_base_tcp: np.ndarray
    T_base_link: dict[str, np.ndarray]
    shapes: tuple[trimesh.Trimesh, ...] = field(repr=False)
    shape_links: tuple[str, ...]
    drives: dict[str, Drive]
    held: frozenset[str]
    closing: Closing
    groups: tuple[tuple[str, ...], ...]
    touch: int
    pads: dict[str, np.ndarray]
    opening: float
    jaw: bool
    symmetry: int
    sampler: str
