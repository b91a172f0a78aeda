"""A trial as a robot makes it: from a table or out of the air, squeezing on, turned, with what it does not know drawn.

In the frame of the hand, as `episode`: while it lifts, the table sinks away from it, and while it turns, gravity does.
How far the hand comes freely is geometry's to say (`arrival`); physics begins with closing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.hands.preshape import Preshape
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.arrival import Arrival
from spgf_torch.simulation.articulation import physx, pose_of, sapien
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.draws import Draw
from spgf_torch.simulation.episode import CHECK_STEPS, Simulator, Trial
from spgf_torch.simulation.fast_forward import FastForward
from spgf_torch.simulation.fingers import Begun
from spgf_torch.simulation.label import Label

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand

# Gravity along these axes of the TCP's frame, each 90 deg from the one before: all ways, whichever is the first.
TOUR = np.concatenate([np.eye(3), -np.eye(3)])
TABLE = (0.05, 0.6, 0.6)  # m, half its thickness and sides: more than hand and object cover


class RobotTrials:
    """The trials of one grasp type on one object; `episode.robot` is set."""

    def __init__(self, obj: GraspObject, hand: Hand, episode: EpisodeConfig, grasp_type: str) -> None:
        assert episode.robot is not None
        self.grasp_type, self.arrival = grasp_type, Arrival(obj, hand, episode.robot, grasp_type)
        self.simulator = Simulator(obj, hand, episode)
        preshape, self.forward = hand.preshapes[grasp_type], None
        if episode.robot.fast_forward and len(preshape.closing.phases) == 1:
            self.forward = FastForward.of(hand, grasp_type, episode)
        self.lost = "+".join(group_names(preshape))

    def run(self, T_object_tcp: np.ndarray) -> Label:
        """How the grasp at T_object_tcp (4, 4) ends."""
        draw = self.arrival.drawn(T_object_tcp)
        if met := self.arrival.met(draw):
            return Label("collision", "approach", met)
        begun = None
        if self.forward is not None:
            begun = self.forward.until(self.arrival.check.there, draw.T_object_tcp, draw.up, draw.height)
            if begun is None:
                return Label("missed", "close", "nothing", lost=self.lost)
        return RobotTrial(self.simulator, draw, self.grasp_type).label(begun)


def group_names(preshape: Preshape) -> list[str]:
    """Of each opposing group of fingers the links that touch."""
    return ["+".join(group) for group in preshape.groups]


class RobotTrial(Trial):
    """Close, settle, lift, turn and shake; then how it ended."""

    def __init__(self, simulator: Simulator, draw: Draw, grasp_type: str) -> None:
        friction = simulator.config.friction * draw.friction
        simulator.material.static_friction = simulator.material.dynamic_friction = friction
        super().__init__(simulator, draw.T_object_tcp, grasp_type)
        self.draw, self.material, self.phase = draw, simulator.material, "close"
        self.mass = self.object.mass = simulator.obj.mass * draw.mass
        self.object.inertia = simulator.moments * draw.mass
        self.weight = (-self.mass * self.config.gravity * draw.up).astype(np.float32)
        self.names = group_names(simulator.hand.preshapes[grasp_type])
        self.sunk = 0  # steps that the table has sunk
        self.table = None if draw.height is None else self._add_table(draw.height)

    def run(self) -> str:
        return self.label().word

    def label(self, begun: Begun | None = None) -> Label:
        """Run the trial; `begun`: from there on."""
        self._close(begun)
        touched = self._touching()
        for step in range(1, round(self.config.settle_time / self.config.dt) + 1):
            self.fingers.squeeze()
            self._step()
            if step % CHECK_STEPS == 0:
                touched |= self._touching()
        if not touched:
            return self._missed()
        touching = self._touching()
        start = self.object.entity.pose
        for phase, accelerations in self._moves():
            self.phase = phase
            if phase != "lift" and self.table is not None:
                self.scene.remove_entity(self.table.entity)
                self.table = None
            failure = self._push([(self.mass * a).astype(np.float32) for a in accelerations], start)
            if failure and phase == "lift" and len(touching) < self.touch:
                return self._missed()
            if failure:
                return self._label(failure)
        if not self._held():
            return self._label("dropped")
        self.phase = "held"
        return self._label("success")

    def _step(self) -> None:
        """A step before lifting: weight acts where a table bears it."""
        if self.table is not None:
            self.object.add_force_torque(self.weight, np.zeros(3, dtype=np.float32))
        super()._step()

    def _drive(self) -> None:
        self.fingers.squeeze()
        if self.table is not None:
            self.sunk += 1
            self.table.kinematic_target = self._table_pose(self.config.hold_acceleration)

    def _moves(self) -> list[tuple[str, np.ndarray]]:
        """(phase, accelerations (S, 3) of the object in the hand's frame, m/s2): lift; turn, and shake, six times.

        Shaking is away from gravity, so that it adds to the weight. The first way is the nearest to gravity's.
        """
        config, robot = self.config, self.config.robot
        assert robot is not None
        down = -self.draw.up
        lift = np.tile((config.gravity + config.hold_acceleration) * down, (round(config.hold_time / config.dt), 1))
        moves = [("lift", lift)]
        ways = TOUR @ self.draw.T_object_tcp[:3, :3].T
        part = np.linspace(0, 1, round(robot.turn_time / config.dt) + 1)[1:, None]
        shakes = round(config.shake_time / config.dt)
        for way in np.roll(ways, -int(np.argmax(ways @ down)), axis=0):
            turning = (1 - part) * down + part * way
            moves.append(("turn", config.gravity * turning / np.linalg.norm(turning, axis=1, keepdims=True)))
            moves.append(("shake", np.tile((config.gravity + config.shake_acceleration) * way, (shakes, 1))))
            down = way
        return moves

    def _add_table(self, height: float) -> physx.PhysxRigidDynamicComponent:
        up, (thick, *_) = self.draw.up, TABLE
        side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        side /= np.linalg.norm(side)
        self._table_axes = np.column_stack([up, side, np.cross(up, side)])
        below = np.eye(3) - np.outer(up, up)  # under the object
        self._table_centre = (
            below @ np.asarray(self.object.cmass_local_pose.p, dtype=np.float64) + (height - thick) * up
        )
        table = physx.PhysxRigidDynamicComponent()
        table.attach(physx.PhysxCollisionShapeBox(half_size=TABLE, material=self.material))
        table.kinematic = True
        entity = sapien.Entity()
        entity.add_component(table)
        entity.pose = self._table_pose(0.0)
        self.scene.add_entity(entity)
        return table

    def _table_pose(self, acceleration: float) -> sapien.Pose:
        """Where the table is after `sunk` steps of such an acceleration, m/s2."""
        way = acceleration / 2 * (self.sunk * self.config.dt) ** 2
        return pose_of(self._table_axes, self._table_centre - way * self.draw.up)

    def _missed(self) -> Label:
        """Too few fingers had the object before it was lifted.

        Which these are at one moment flickers; so it is lifted if one touches, and that decides.
        """
        if self.phase == "lift":
            return self._label("missed", "one_side")
        return self._label("missed", "table" if self._on_table() else "nothing")

    def _on_table(self) -> bool:
        """Whether a finger presses on the table."""
        return any(
            self.table in contact.bodies and self.object not in contact.bodies
            for contact in self.system.get_contacts()
            if any(np.any(point.impulse) for point in contact.points)
        )

    def _label(self, outcome: str, cause: str = "none") -> Label:
        forces = self._forces()
        lost = "+".join(name for name, force in zip(self.names, forces, strict=True) if not force)
        return Label(outcome, self.phase, cause, sorted(forces, reverse=True)[self.touch - 1], lost)

    def _forces(self) -> list[float]:
        """N with which each group of fingers presses on the object, in the last step."""
        forces = [0.0] * len(self.groups)
        for contact in self.system.get_contacts():
            if self.object not in contact.bodies:
                continue
            impulse = sum(float(np.linalg.norm(point.impulse)) for point in contact.points)
            for k, group in enumerate(self.groups):
                if any(shape in contact.shapes for shape in group):
                    forces[k] += impulse / self.config.dt
        return forces
