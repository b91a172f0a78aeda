"""One preshape of a hand with all that its checks look at, computed once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from spgf_torch.hands.fingers import FingerShape, finger_shape
from spgf_torch.hands.hand import Hand
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.hands.preshape import Preshape

STEP = 1e-4  # rad or m; of a derivative


@dataclass(frozen=True)
class Posed:
    """A preshape of a hand, open and closed."""

    hand: Hand
    name: str
    kinematics: Kinematics

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

    @cached_property
    def finger_shapes(self) -> dict[str, FingerShape]:
        fingers = self.hand.config.fingers
        return {name: finger_shape(self.hand.robot, name, fingers[name]) for name in self.preshape.pads}

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
    def shapes(self) -> tuple[trimesh.Trimesh, ...]:
        """The open hand's shapes in the TCP frame."""
        return self.preshape.shapes
