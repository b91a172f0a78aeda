"""What a URDF says of a hand: joints, links, and collision shapes as convex pieces."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh


@dataclass(frozen=True)
class Follow:
    """A joint's value is `ratio` times that of the joint `of`, plus `offset` (rad or m)."""

    of: str
    ratio: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """One joint of a URDF.

    Attributes:
        kind: revolute, continuous, prismatic or fixed.
        axis: (3,) unit, in the joint's frame.
        lower, upper: rad or m; infinite of a continuous joint.
        effort, velocity: Nm or N, rad/s or m/s; None where the URDF does not say, or says 0.
        mimic: of its `<mimic>`, if it has one.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    effort: float | None
    velocity: float | None
    mimic: Follow | None

    @property
    def moves(self) -> bool:
        return self.kind != "fixed"


@dataclass(frozen=True)
class Collision:
    """One convex piece of a link's collision shapes.

    Attributes:
        link: its link. cut: whether it is a piece of a mesh file, and not a shape that the XML itself describes.
        mesh: closed and convex, m, in the frame of its `<collision>` element.
        T_link_shape: (4, 4) float64 of that element.
    """

    link: str
    cut: bool
    mesh: trimesh.Trimesh
    T_link_shape: np.ndarray


@dataclass(frozen=True)
class Robot:
    """A hand as its URDF describes it.

    Attributes:
        path: the file that was given.
        root: the base link of the hand.
        xml: a URDF of the hand alone: from `root` on, nothing but links with their inertias and those collision shapes
            that are no meshes, and joints without `<mimic>`.
        links, joints: in the order of the file; parents before children is not promised.
        collisions: all convex pieces, links in the order of the file, elements in the order of their link.
        passive: links that are posed but not simulated, and what is fixed to them.
        digest: SHA-256 over `xml`, the pieces and the passive links; not over where the files lie.
        notes: what was put right, a line each.
    """

    path: Path
    root: str
    xml: str = field(repr=False)
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    collisions: tuple[Collision, ...] = field(repr=False)
    passive: frozenset[str]
    digest: str
    notes: tuple[str, ...] = ()

    def joint(self, name: str) -> Joint:
        return next(joint for joint in self.joints if joint.name == name)

    def bodies(self) -> dict[str, str]:
        """Link -> the link that its rigid body is named after: the first of those that fixed joints join to it."""
        parent = {joint.child: joint for joint in self.joints}
        found: dict[str, str] = {}
        for link in self.links:
            top = link
            while top in parent and not parent[top].moves:
                top = parent[top].parent
            found[link] = top
        return found
