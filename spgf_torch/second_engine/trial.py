"""One grasp trial in MuJoCo: the episode of `simulation.episode`, with the same fingers, loads and outcomes.

All is in the frame of the hand's base, which stands still, so that the loads are turned into it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.second_engine.model import OBJECT, ModelMaker, quaternion_of, rotation_of
from spgf_torch.simulation.episode import CHECK_STEPS, DIRECTIONS
from spgf_torch.simulation.fingers import Fingers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from spgf_torch.hands.hand import Hand
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.config import EpisodeConfig


class MujocoSimulator:
    """Trials of one hand and grasp type on one object; the model is compiled once, and no trial changes it."""

    def __init__(
        self, obj: GraspObject, hand: Hand, grasp_type: str, episode: EpisodeConfig, config: MujocoConfig
    ) -> None:
        self.obj, self.robot, self.preshape, self.episode = obj, hand.robot, hand.preshapes[grasp_type], episode
        self.steps = max(1, round(episode.dt / config.dt))  # of MuJoCo in one of the episode
        config = MujocoConfig(**{**vars(config), "dt": episode.dt / self.steps})
        self.model = ModelMaker(self.robot, self.preshape, episode, config).model(obj)
        self.object = self.model.body(OBJECT).id
        bodies = self.robot.bodies()
        self.groups = []
        for group in self.preshape.groups:
            touching = {bodies[link] for link in group}
            links = [link for link, body in bodies.items() if body in touching and link not in self.robot.passive]
            self.groups.append({self.model.body(link).id for link in links})

    def run(self, T_object_tcp: np.ndarray) -> str:
        """The outcome of grasping at T_object_tcp (4, 4): one of `table.OUTCOMES` but "collision"."""
        return MujocoTrial(self, np.asarray(T_object_tcp, dtype=np.float64)).run()


class MujocoTrial:
    """The phases of one trial: close, settle, hold, shake."""

    def __init__(self, simulator: MujocoSimulator, T_object_tcp: np.ndarray) -> None:
        self.simulator, self.model, self.episode = simulator, simulator.model, simulator.episode
        self.data = mujoco.MjData(self.model)
        self.object, self.mass = simulator.object, simulator.obj.mass
        self.place = int(self.model.jnt_qposadr[self.model.body_jntadr[self.object]])
        self.speed = int(self.model.jnt_dofadr[self.model.body_jntadr[self.object]])
        T_base_object = simulator.preshape.T_base_tcp @ np.linalg.inv(T_object_tcp)
        self.R_base_world = T_base_object[:3, :3]
        self.data.qpos[self.place : self.place + 3] = T_base_object[:3, 3]
        self.data.qpos[self.place + 3 : self.place + 7] = quaternion_of(self.R_base_world)
        self.damping = 0.0
        hand: Any = MujocoHand(self.model, self.data)
        self.fingers = Fingers(hand, simulator.robot, simulator.preshape, self.episode, self.step)
        mujoco.mj_forward(self.model, self.data)
        self.tcp = simulator.preshape.T_base_tcp[:3, 3]
        self.least_cosine = math.cos(math.radians(self.episode.max_rotation_deg))

    def run(self) -> str:
        self.damping = self.episode.damping
        self.fingers.close()
        self.damping = 0.0
        if not self.touching():
            return "missed"
        self.fingers.settle(self.episode.settle_time)
        if not self.held():
            return "missed"
        start = self.pose()
        for acceleration, duration in self.loads():
            failure = self._load(acceleration, duration, start)
            if failure:
                return failure
        return "success" if self.held() else "dropped"

    def loads(self) -> list[tuple[np.ndarray, float]]:
        """(acceleration of the object in the world, m/s2; duration, s): lift, then shake in six directions."""
        episode = self.episode
        gravity = np.array([0.0, 0.0, -episode.gravity])
        lift = gravity - np.array([0.0, 0.0, episode.hold_acceleration])
        shakes = [(gravity + episode.shake_acceleration * way, episode.shake_time) for way in DIRECTIONS]
        return [(lift, episode.hold_time), *shakes]

    def step(self, acceleration: np.ndarray | None = None) -> None:
        """One step of the episode, while an acceleration (3,) in the base's frame acts on the object."""
        force = np.zeros(6)  # at the centre of mass, in the base's frame
        force[:3] = 0.0 if acceleration is None else self.mass * acceleration
        for _ in range(self.simulator.steps):
            self.data.xfrc_applied[self.object] = force + self._drag() if self.damping else force
            mujoco.mj_step(self.model, self.data)

    def _drag(self) -> np.ndarray:
        """(6,) N and Nm that slow the object down, as PhysX's damping does."""
        R = rotation_of(self.data.qpos[self.place + 3 : self.place + 7])
        velocity, spin = (self.data.qvel[self.speed + k : self.speed + k + 3] for k in (0, 3))
        obj = self.simulator.obj
        of_centre = velocity + R @ np.cross(spin, obj.com)  # the spin is in the object's frame
        return -self.damping * np.concatenate([self.mass * of_centre, R @ (obj.inertia @ spin)])

    def _load(self, acceleration: np.ndarray, duration: float, start: np.ndarray) -> str | None:
        """Accelerate the object for a while; the failure, if it moved too far in the hand."""
        turned = self.R_base_world @ acceleration
        steps = round(duration / self.episode.dt)
        for step in range(1, steps + 1):
            self.fingers.keep_linked()
            self.step(turned)
            if step % CHECK_STEPS == 0 or step == steps:
                failure = self._failure(start)
                if failure:
                    return failure
        return None

    def _failure(self, start: np.ndarray) -> str | None:
        """How the object has left its place in the hand since `start`, if it has: slip is measured at the TCP."""
        motion = self.pose() @ np.linalg.inv(start)
        if not math.dist(motion[:3, :3] @ self.tcp + motion[:3, 3], self.tcp) <= self.episode.max_slip:
            return "slipped" if self.held() else "dropped"
        return "rotated" if (np.trace(motion[:3, :3]) - 1) / 2 < self.least_cosine else None

    def pose(self) -> np.ndarray:
        """(4, 4) of the object in the base's frame."""
        T, place = np.eye(4), self.data.qpos[self.place : self.place + 7]
        T[:3, :3], T[:3, 3] = rotation_of(place[3:]), place[:3]
        return T

    def held(self) -> bool:
        return len(self.touching()) >= self.simulator.preshape.touch

    def touching(self) -> set[int]:
        """The groups of fingers that press on the object."""
        found: set[int] = set()
        contacts, force = self.data.contact, np.zeros(6)
        bodies = self.model.geom_bodyid[contacts.geom]
        for index, pair in enumerate(bodies.tolist()):
            if self.object in pair:
                mujoco.mj_contactForce(self.model, self.data, index, force)
                if force[0] > 0:
                    found.update(k for k, group in enumerate(self.simulator.groups) if group.intersection(pair))
        return found


class MujocoHand:
    """The joints that `Fingers` drives, with the names that SAPIEN has for what it asks of them."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.data = data
        self.active_joints = [MujocoJoint(data, index, model.actuator(index).name) for index in range(model.nu)]
        self._places = np.array([model.jnt_qposadr[model.actuator_trnid[index, 0]] for index in range(model.nu)])

    @property
    def qpos(self) -> np.ndarray:
        return self.data.qpos[self._places]

    def set_qpos(self, values: Sequence[float]) -> None:
        self.data.qpos[self._places] = values


@dataclass(frozen=True)
class MujocoJoint:
    """One joint and its actuator."""

    data: mujoco.MjData
    index: int
    name: str

    def set_drive_properties(self, stiffness: float, damping: float, effort: float) -> None:
        """Nothing to do: they are compiled into the model."""

    def set_drive_target(self, target: float) -> None:
        self.data.ctrl[self.index] = target
