"""Forward kinematics of a hand (pytorch-kinematics), with joints that follow others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spgf_torch.deferred_imports import deferred
from spgf_torch.errors import InputError
from spgf_torch.files.reading import unreadable
from spgf_torch.hands.robot import Follow, Joint, Robot


class Kinematics:
    """Where the links of a hand are for given joint values (rad or m)."""

    def __init__(self, robot: Robot) -> None:
        import torch

        with deferred("matplotlib", "pyplot", "cm"):  # a second of import, for plots of inverse kinematics
            import pytorch_kinematics as pk

        try:
            self.chain = pk.build_chain_from_urdf(robot.xml.encode()).to(dtype=torch.float64)
        except Exception as error:  # the parser raises whatever its XML library does
            raise unreadable(robot.path, "a URDF of a hand", error) from None
        self.robot = robot
        self.names: list[str] = self.chain.get_joint_parameter_names()  # its order, not SAPIEN's
        self.moving = {joint.name: joint for joint in robot.joints if joint.moves}
        if set(self.names) != set(self.moving):
            odd = min(set(self.names) ^ set(self.moving))
            raise InputError(f"{robot.path}: expected a joint {odd} that pytorch-kinematics reads, got none")

    def at_rest(self) -> dict[str, float]:
        """Every moving joint at 0, or at the limit that is nearest to it."""
        return {name: min(max(0.0, self.moving[name].lower), self.moving[name].upper) for name in self.names}

    def complete(self, joints: Mapping[str, float], follow: Mapping[str, Follow]) -> dict[str, float]:
        """All joint values, those that follow others computed from them."""
        values = {**self.at_rest(), **joints}
        done: set[str] = set()

        def resolve(name: str) -> float:
            if name in follow and name not in done:
                done.add(name)
                rule = follow[name]
                values[name] = rule.ratio * resolve(rule.of) + rule.offset
            return values[name]

        for name in follow:
            resolve(name)
        return values

    def links(self, joints: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Link name -> T_base_link (4, 4) float64."""
        return {name: poses[0] for name, poses in self.along([joints]).items()}

    def along(self, path: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
        """Link name -> T_base_link (B, 4, 4) float64, of so many sets of joint values."""
        import torch

        values = torch.tensor([[joints[name] for name in self.names] for joints in path], dtype=torch.float64)
        if not self.names:
            raise InputError(f"{self.robot.path}: expected a hand with joints that move, got none")
        poses = self.chain.forward_kinematics(values)
        return {name: pose.get_matrix().expand(len(path), 4, 4).numpy() for name, pose in poses.items()}


def drivers(follow: Mapping[str, Follow], joints: Sequence[Joint]) -> list[Joint]:
    """The moving joints that follow no other."""
    return [joint for joint in joints if joint.moves and joint.name not in follow]
