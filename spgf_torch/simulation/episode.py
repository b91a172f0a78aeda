"""One grasp trial in SAPIEN (docs/design/simulation.md).

The hand's base stands still in the object's frame (z up) and the object floats between the fingers; gravity and the
accelerations of lifting and shaking act on the object as forces, which is the same physics in the hand's frame.
Every trial has a scene of its own: a reused one is neither exact nor free of leaks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.articulation import HandBuilder, physx, pose_of, principal_axes, sapien
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.fingers import Begun, Fingers

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand

# The six directions of shaking, in the world.
DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
CHECK_STEPS = 10  # steps between looks at the object, so that a dropped one ends the trial early


class Simulator:
    """Trials of one hand on one object; what does not change between trials is cooked once."""

    def __init__(self, obj: GraspObject, hand: Hand, config: EpisodeConfig) -> None:
        self.obj, self.hand, self.config = obj, hand, config
        configure(config)
        self.material = physx.PhysxMaterial(config.friction, config.friction, 0.0)
        self._builders: dict[str, HandBuilder] = {}
        self._parts = [
            physx.PhysxCollisionShapeConvexMesh(
                vertices=np.asarray(part, dtype=np.float32), scale=[1, 1, 1], material=self.material
            )
            for part in obj.parts
        ]
        self.moments, axes = principal_axes(obj.inertia)
        self._cmass = pose_of(axes, obj.com)

    def run(self, T_object_tcp: np.ndarray, grasp_type: str) -> str:
        """The outcome of grasping at T_object_tcp (4, 4): one of `table.OUTCOMES` but "collision"."""
        return Trial(self, np.asarray(T_object_tcp, dtype=np.float64), grasp_type).run()

    def builder(self, grasp_type: str) -> HandBuilder:
        """What builds the hand for grasps of one type."""
        if grasp_type not in self._builders:
            preshape = self.hand.preshapes[grasp_type]
            self._builders[grasp_type] = HandBuilder(self.hand.robot, preshape, self.material)
        return self._builders[grasp_type]

    def add_object(self, scene: sapien.Scene) -> physx.PhysxRigidDynamicComponent:
        body = physx.PhysxRigidDynamicComponent()
        for part in self._parts:
            body.attach(part)
        body.mass = self.obj.mass
        body.cmass_local_pose = self._cmass
        body.inertia = self.moments
        body.max_depenetration_velocity = self.config.depenetration
        entity = sapien.Entity()
        entity.add_component(body)
        scene.add_entity(entity)
        return body


class Trial:
    """The phases of one trial: close, settle, hold, shake."""

    def __init__(self, simulator: Simulator, T_object_tcp: np.ndarray, grasp_type: str) -> None:
        self.config, hand = simulator.config, simulator.hand
        self.builder = builder = simulator.builder(grasp_type)
        configure(self.config)
        preshape = hand.preshapes[grasp_type]
        self.system = physx.PhysxCpuSystem()
        self.scene = sapien.Scene([self.system])
        self.scene.timestep = self.config.dt
        self.object = simulator.add_object(self.scene)
        self.mass = simulator.obj.mass
        self.articulation = builder.build(self.scene, T_object_tcp @ np.linalg.inv(preshape.T_base_tcp))
        self.fingers = Fingers(self.articulation, hand.robot, preshape, self.config, self._step)
        bodies = hand.robot.bodies()
        self.touch, self.groups = preshape.touch, []
        for group in preshape.groups:
            touching = {bodies[link] for link in group}
            links = {link for link, body in bodies.items() if body in touching}
            self.groups.append(builder.shapes(self.articulation, links))
        self.tcp = sapien.Pose(p=T_object_tcp[:3, 3])
        self.least_cosine = math.cos(math.radians(self.config.max_rotation_deg) / 2)

    def _step(self) -> None:
        self.system.step()

    def run(self) -> str:
        self._close()
        if not self._touching():
            return "missed"
        self.fingers.settle(self.config.settle_time)
        if not self._held():
            return "missed"
        start = self.object.entity.pose
        for acceleration, duration in self._loads():
            failure = self._load(acceleration, duration, start)
            if failure:
                return failure
        return "success" if self._held() else "dropped"

    def _loads(self) -> list[tuple[np.ndarray, float]]:
        """(acceleration of the object in the hand's frame, m/s2; duration, s): lift, then shake in six directions."""
        config = self.config
        gravity = np.array([0.0, 0.0, -config.gravity])
        lift = gravity - np.array([0.0, 0.0, config.hold_acceleration])
        shakes = [(gravity + config.shake_acceleration * way, config.shake_time) for way in DIRECTIONS]
        return [(lift, config.hold_time), *shakes]

    def _close(self, begun: Begun | None = None) -> None:
        """Close the fingers while the object is damped; `begun`: go on from there."""
        self.object.linear_damping = self.object.angular_damping = self.config.damping
        self.fingers.close(begun)
        self.object.linear_damping = self.object.angular_damping = 0.0

    def _load(self, acceleration: np.ndarray, duration: float, start: sapien.Pose) -> str | None:
        """Accelerate the object for a while; the failure, if it moved too far in the hand."""
        return self._push([(self.mass * acceleration).astype(np.float32)] * round(duration / self.config.dt), start)

    def _push(self, forces: Sequence[np.ndarray], start: sapien.Pose) -> str | None:
        """Push the object with a force (3,) float32, N, at each step; the failure, if it moved too far in the hand."""
        torque, steps = np.zeros(3, dtype=np.float32), len(forces)
        for step, force in enumerate(forces, 1):
            self.object.add_force_torque(force, torque)
            self._drive()
            self.system.step()
            if step % CHECK_STEPS == 0 or step == steps:
                failure = self._failure(start)
                if failure:
                    return failure
        return None

    def _drive(self) -> None:
        """Set the drives for a step under load."""
        self.fingers.keep_linked()

    def _failure(self, start: sapien.Pose) -> str | None:
        """How the object has left its place in the hand since `start`, if it has: slip is measured at the TCP."""
        motion = self.object.entity.pose * start.inv()
        if math.dist((motion * self.tcp).p, self.tcp.p) > self.config.max_slip:
            return "slipped" if self._held() else "dropped"
        return "rotated" if abs(motion.q[0]) < self.least_cosine else None

    def _held(self) -> bool:
        return len(self._touching()) >= self.touch

    def _touching(self) -> set[int]:
        """The groups of fingers that press on the object (PhysX also lists near pairs, with zero impulse)."""
        touching: set[int] = set()
        for contact in self.system.get_contacts():
            if self.object in contact.bodies and any(np.any(point.impulse) for point in contact.points):
                shapes = contact.shapes
                touching.update(k for k, group in enumerate(self.groups) if any(shape in shapes for shape in group))
        return touching


def configure(config: EpisodeConfig) -> None:
    """PhysX reads these when a scene, a shape or a body is made; editing them later has no effect."""
    physx.set_scene_config(gravity=[0, 0, 0], enable_tgs=True, enable_pcm=False, cpu_workers=0)
    physx.set_shape_config(contact_offset=config.contact_offset, rest_offset=0.0)
    physx.set_body_config(
        solver_position_iterations=config.position_iterations,
        solver_velocity_iterations=config.velocity_iterations,
        sleep_threshold=0.0,
    )
