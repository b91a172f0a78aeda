"""One preshape of a hand with all that its checks look at, computed once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spgf_torch.hands.fingers import FingerShape, finger_shape, separation
from spgf_torch.hands.hand import Hand
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.hands.preshape import Preshape

STEP = 1e-4  # rad or m; of a derivative
EDGE = 5e-4  # m below the highest plane within which a face counts as the one a pad lies on


@dataclass(frozen=True)
class Posed:
    """A preshape of a hand, open and closed.

    Attributes:
        finger_shapes: finger -> its surface, of all that some preshape closes.
    """

    hand: Hand
    name: str
    kinematics: Kinematics
    finger_shapes: Mapping[str, FingerShape]

    @staticmethod
    def all_of(hand: Hand) -> list[Posed]:
        """Every preshape of a hand."""
        kinematics, fingers = Kinematics(hand.robot), hand.config.fingers
        closing = {name for preshape in hand.preshapes.values() for name in preshape.pads}
        shapes = {name: finger_shape(hand.robot, name, links) for name, links in fingers.items() if name in closing}
        return [Posed(hand, name, kinematics, shapes) for name in hand.preshapes]

    @property
    def preshape(self) -> Preshape:
        return self.hand.preshapes[self.name]

    @cached_property
    def closed_links(self) -> dict[str, np.ndarray]:
        """Link -> T_base_link (4, 4) of the closed hand."""
        return self.kinematics.links(self.preshape.closed)

    @cached_property
    def bodies(self) -> dict[str, str]:
        """Link -> the link that its rigid body is named after."""
        return self.hand.robot.bodies()

    @cached_property
    def groups(self) -> list[list[str]]:
        """The names of the fingers of each opposing group."""
        fingers, found = self.hand.config.fingers, []
        for links in self.preshape.groups:
            bodies = {self.bodies[link] for link in links}
            found.append([name for name in self.preshape.pads if self.bodies[fingers[name][0]] in bodies])
        return found

    @cached_property
    def carriers(self) -> dict[str, str]:
        """Finger -> the link that carries its pad."""
        return {name: self.hand.config.fingers[name][0] for name in self.preshape.pads}

    @cached_property
    def pad_points(self) -> dict[str, np.ndarray]:
        """Finger -> (3,) pad in the frame of its link, m."""
        points = {}
        for name, point in self.preshape.pads.items():
            T = self.preshape.T_base_link[self.carriers[name]]
            points[name] = T[:3, :3].T @ (point - T[:3, 3])
        return points

    def pads_at(self, links: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Finger -> (3,) in the base frame for these poses of links."""
        poses = {name: links[self.carriers[name]] for name in self.pad_points}
        return {name: poses[name][:3, :3] @ point + poses[name][:3, 3] for name, point in self.pad_points.items()}

    def across(self, vector: np.ndarray) -> np.ndarray:
        """A vector (..., 3) of the base frame without its part along the approach."""
        z = self.preshape.T_base_tcp[:3, 2]
        return np.asarray(vector - (vector @ z)[..., None] * z)

    @cached_property
    def inwards(self) -> dict[str, np.ndarray]:
        """Finger -> (3,) unit across the approach in the base frame: from its pad to the middle of the other groups."""
        pads, found = self.preshape.pads, {}
        for group in self.groups:
            others = [np.mean([pads[name] for name in other], axis=0) for other in self.groups if other is not group]
            for name in group:
                way = self.across(np.mean(others, axis=0) - np.mean([pads[each] for each in group], axis=0))
                found[name] = way / max(float(np.linalg.norm(way)), 1e-9)
        return found

    @cached_property
    def levers(self) -> dict[str, dict[str, np.ndarray]]:
        """Joint that closes -> finger -> (3,) m per rad, or per m, that its pad moves in the direction of closing."""
        before, found = self.preshape.pads, {}
        for joint, share in self.closing.items():
            moved = {**self.preshape.joints, joint: self.preshape.joints[joint] + np.sign(share) * STEP}
            after = self.pads_at(self.kinematics.links(self.kinematics.complete(moved, self.preshape.closing.follow)))
            found[joint] = {name: (after[name] - before[name]) / STEP for name in before}
        return found

    @cached_property
    def closing(self) -> dict[str, float]:
        """Joint that closes, in any phase -> direction times share."""
        return {joint: share for phase in self.preshape.closing.phases for joint, share in phase.items()}

    @cached_property
    def forces(self) -> dict[str, float]:
        """Finger -> N that its pad can press inwards with: of its joints' efforts over their levers the least."""
        effort, found = self.preshape.closing.effort, {}
        for finger, inwards in self.inwards.items():
            levers = {joint: float(of[finger] @ inwards) for joint, of in self.levers.items()}
            pushes = [abs(self.closing[j]) * effort / lever for j, lever in levers.items() if lever > 10 * STEP]
            found[finger] = min(pushes, default=0.0)
        return found

    @cached_property
    def mimics(self) -> set[str]:
        """Joints that follow another because the URDF says so."""
        return {joint.name for joint in self.hand.robot.joints if joint.mimic is not None}

    @cached_property
    def one_sided(self) -> bool:
        """Whether one finger alone moves."""
        return sum(force > 0 for force in self.forces.values()) == 1

    @cached_property
    def hinged(self) -> bool:
        """Whether a joint joins bodies of opposing fingers: a jaw to the palm that it closes on."""
        fingers = self.hand.config.fingers
        of = {self.bodies[link]: i for i, group in enumerate(self.groups) for f in group for link in fingers[f]}
        pairs = (tuple(pair) for pair in self.joined)
        return any(a in of and b in of and of[a] != of[b] for a, b in pairs)

    @cached_property
    def joined(self) -> set[frozenset[str]]:
        """Pairs of bodies that a joint joins."""
        return {frozenset((self.bodies[j.parent], self.bodies[j.child])) for j in self.hand.robot.joints if j.moves}

    @cached_property
    def fingers_of(self) -> dict[str, str]:
        """Body -> the first body of its finger, which hangs from the palm by a joint; the palm has none."""
        parent = {self.bodies[j.child]: self.bodies[j.parent] for j in self.hand.robot.joints if j.moves}
        palm, found = self.bodies[self.hand.robot.root], {}
        for body in set(self.bodies.values()):
            at, first = body, ""
            while at != palm and at in parent:
                at, first = parent[at], at
            found[body] = first
        return found

    def gap(self, links: Mapping[str, np.ndarray]) -> float:
        """m between opposing groups of fingers for these poses of links; negative where they stand in each other.

        Of fingers that a hinge joins, whose shapes are never apart, between their pads.
        """
        if not self.hinged:
            shapes = [[self.finger_shapes[name] for name in group] for group in self.groups]
            return separation(shapes, links)
        pads = self.pads_at(links)
        first, second = (np.mean([pads[name] for name in group], axis=0) for group in self.groups[:2])
        return float(np.linalg.norm(second - first))

    def behind(self, finger: str) -> set[str]:
        """All joints between the base and the pad of a finger."""
        parents, link, found = {j.child: j for j in self.hand.robot.joints}, self.carriers[finger], set()
        while link in parents:
            found.add(parents[link].name)
            link = parents[link].parent
        return found

    def surface(self, finger: str) -> tuple[float, np.ndarray]:
        """How far (m) a pad is off the surface of its body's shapes, and the outward normal (3,) there, base frame.

        On an edge, and where pieces meet, the face that looks inwards most counts. Infinite, and no direction, where
        the body has no shapes.
        """
        pad, inwards = self.preshape.pads[finger], self.inwards[finger]
        heights, normals = [np.full(1, np.inf)], [np.zeros((1, 3))]
        for link, planes in self.finger_shapes[finger].planes:
            if self.bodies[link] == self.bodies[self.carriers[finger]]:
                T = self.preshape.T_base_link[link]
                height = planes[:, :3] @ (T[:3, :3].T @ (pad - T[:3, 3])) - planes[:, 3]
                top = height >= height.max() - EDGE
                heights.append(np.full(top.sum(), height.max()))
                normals.append(planes[top, :3] @ T[:3, :3].T)
        all_heights, all_normals = np.concatenate(heights), np.concatenate(normals)
        least = float(all_heights.min())
        near = all_normals[all_heights <= least + EDGE]
        return abs(least), near[np.argmax(near @ inwards)]

    def free_way(self, direction: np.ndarray) -> float:
        """m from the TCP in a direction (3,) of the TCP frame to the first shape of the open hand; infinite if none."""
        ways = [_entry(planes, direction) for planes in self._planes]
        return min(ways, default=np.inf)

    def room(self) -> float:
        """m from the TCP to the nearest shape of the open hand, at least; negative inside."""
        return min(float((-planes[:, 3]).max()) for planes in self._planes)

    @cached_property
    def _planes(self) -> list[np.ndarray]:
        """Of each shape in the TCP frame (F, 4): outward normals and offsets."""
        found = []
        for shape in self.preshape.shapes:
            normals = np.asarray(shape.face_normals)
            found.append(np.column_stack([normals, np.einsum("ij,ij->i", normals, shape.triangles[:, 0])]))
        return found


def _entry(planes: np.ndarray, direction: np.ndarray) -> float:
    """m from the origin along a direction to a convex shape given by planes (F, 4); infinite where it is missed."""
    speed = planes[:, :3] @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        at = planes[:, 3] / speed
    if (planes[np.abs(speed) < 1e-12, 3] < 0).any():
        return np.inf
    enter = float(at[speed < -1e-12].max(initial=-np.inf))
    leave = float(at[speed > 1e-12].min(initial=np.inf))
    return max(enter, 0.0) if enter <= leave and leave >= 0 else np.inf
