"""One grasp trial in SAPIEN (docs/design/simulation.md). The only importer of sapien.

The hand's base stands still in the object's frame (z up) and the object floats between the fingers; gravity and the
accelerations of lifting and shaking act on the object as forces, which is the same physics in the hand's frame.
Every trial has a scene of its own: a reused one is neither exact nor free of leaks.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.hands.hand import Hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.config import EpisodeConfig

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message=".*libvulkan.*")
    import sapien
    from sapien import physx
    from sapien.wrapper.urdf_loader import URDFLoader

# The six directions of shaking, in the world.
DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
CHECK_STEPS = 10  # steps between looks at the object, so that a dropped one ends the trial early


class Simulator:
    """Trials of one hand on one object; what does not change between trials is cooked once."""

    def __init__(self, obj: GraspObject, hand: Hand, config: EpisodeConfig) -> None:
        self.obj, self.hand, self.config = obj, hand, config
        _configure(config)
        self._material = physx.PhysxMaterial(config.friction, config.friction, 0.0)
        self._builder = _hand_builder(hand, self._material)
        self._parts = [
            physx.PhysxCollisionShapeConvexMesh(
                vertices=np.asarray(part, dtype=np.float32), scale=[1, 1, 1], material=self._material
            )
            for part in obj.parts
        ]
        moments, axes = np.linalg.eigh(obj.inertia)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])  # right-handed
        self._moments, self._cmass = moments, _pose(axes, obj.com)

    def run(self, T_object_tcp: np.ndarray, grasp_type: str) -> str:
        """The outcome of grasping at T_object_tcp (4, 4): one of `table.OUTCOMES` but "collision"."""
        return Trial(self, np.asarray(T_object_tcp, dtype=np.float64), grasp_type).run()

    def add_object(self, scene: sapien.Scene) -> physx.PhysxRigidDynamicComponent:
        body = physx.PhysxRigidDynamicComponent()
        for part in self._parts:
            body.attach(part)
        body.mass = self.obj.mass
        body.cmass_local_pose = self._cmass
        body.inertia = self._moments
        body.max_depenetration_velocity = self.config.depenetration
        entity = sapien.Entity()
        entity.add_component(body)
        scene.add_entity(entity)
        return body

    def add_hand(self, scene: sapien.Scene, T_object_base: np.ndarray) -> physx.PhysxArticulation:
        self._builder.set_scene(scene)
        self._builder.set_initial_pose(_pose(T_object_base[:3, :3], T_object_base[:3, 3]))
        return self._builder.build(fix_root_link=True, build_mimic_joints=False)


class Trial:
    """The phases of one trial: close, settle, hold, shake."""

    def __init__(self, simulator: Simulator, T_object_tcp: np.ndarray, grasp_type: str) -> None:
        self.config, self.hand = simulator.config, simulator.hand
        _configure(self.config)
        preshape = simulator.hand.preshapes[grasp_type]
        self.system = physx.PhysxCpuSystem()
        self.scene = sapien.Scene([self.system])
        self.scene.timestep = self.config.dt
        self.object = simulator.add_object(self.scene)
        self.mass = simulator.obj.mass
        self.articulation = simulator.add_hand(self.scene, T_object_tcp @ np.linalg.inv(preshape.T_base_tcp))
        self._set_joints(preshape.joints)
        self.tcp = sapien.Pose(p=T_object_tcp[:3, 3])
        self.least_cosine = math.cos(math.radians(self.config.max_rotation_deg) / 2)

    def _set_joints(self, joints: dict[str, float]) -> None:
        active = self.articulation.active_joints
        names = [joint.name for joint in active]
        config, fingers = self.hand.config, self.hand.config.fingers
        self.proximal = [names.index(finger.proximal) for finger in fingers]
        self.distal = [names.index(finger.distal) for finger in fingers if finger.distal]
        self.proximal_joints = [active[index] for index in self.proximal]
        self.distal_joints = [active[index] for index in self.distal]
        self.pads = [self.articulation.find_link_by_name(finger.pad_link) for finger in fingers]
        self.articulation.set_qpos([joints[name] for name in names])
        for joint in self.proximal_joints:
            joint.set_drive_properties(config.proximal_stiffness, config.proximal_damping, config.proximal_limit)
        for joint in self.distal_joints:
            joint.set_drive_properties(config.distal_stiffness, config.distal_damping, config.distal_limit)
        for joint in active:
            joint.set_drive_target(joints[joint.name])

    def run(self) -> str:
        self._close()
        if not self._touching():
            return "missed"
        self._follow(self.config.settle_time)
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

    def _close(self) -> None:
        """Run the proximal targets ahead of the joints, never back, until the fingers stand still."""
        config, closing = self.hand.config, self.hand.closing
        self.object.linear_damping = self.object.angular_damping = self.config.damping
        lead, stride = config.closing_torque / config.proximal_stiffness, config.closing_speed * self.config.dt
        window = max(1, round(self.config.stall_window / self.config.dt))
        q = self.articulation.qpos
        targets = [closing * float(q[index]) for index in self.proximal]
        before, still = list(targets), 0
        for step in range(1, round(self.config.close_time / self.config.dt) + 1):
            for k, index in enumerate(self.proximal):
                ahead = min(targets[k] + stride, closing * float(q[index]) + lead)
                targets[k] = max(targets[k], ahead)
                self.proximal_joints[k].set_drive_target(closing * targets[k])
            self._turn_distal(q)
            self.system.step()
            q = self.articulation.qpos
            if step % window == 0:
                now = [closing * float(q[index]) for index in self.proximal]
                moved = max(abs(a - b) for a, b in zip(now, before, strict=True))
                before, still = now, still + 1 if moved < self.config.stall_motion else 0
                if still == 2:
                    break
        self.object.linear_damping = self.object.angular_damping = 0.0

    def _turn_distal(self, q: np.ndarray) -> None:
        for k, joint in enumerate(self.distal_joints):
            joint.set_drive_target(-float(q[self.proximal[k]]))

    def _follow(self, duration: float) -> None:
        """Proximal targets frozen, distal joints still following: the grasp settles."""
        for _ in range(round(duration / self.config.dt)):
            self._turn_distal(self.articulation.qpos)
            self.system.step()

    def _load(self, acceleration: np.ndarray, duration: float, start: sapien.Pose) -> str | None:
        """Accelerate the object for a while; the failure, if it moved too far in the hand."""
        force, torque = (self.mass * acceleration).astype(np.float32), np.zeros(3, dtype=np.float32)
        steps = round(duration / self.config.dt)
        for step in range(1, steps + 1):
            self.object.add_force_torque(force, torque)
            self.system.step()
            if step % CHECK_STEPS == 0 or step == steps:
                failure = self._failure(start)
                if failure:
                    return failure
        return None

    def _failure(self, start: sapien.Pose) -> str | None:
        """How the object has left its place in the hand since `start`, if it has: slip is measured at the TCP."""
        motion = self.object.entity.pose * start.inv()
        if math.dist((motion * self.tcp).p, self.tcp.p) > self.config.max_slip:
            return "slipped" if self._held() else "dropped"
        return "rotated" if abs(motion.q[0]) < self.least_cosine else None

    def _held(self) -> bool:
        return len(self._touching()) == len(self.pads)

    def _touching(self) -> set[int]:
        """The fingers that press on the object (PhysX also lists near pairs, with zero impulse)."""
        touching: set[int] = set()
        for contact in self.system.get_contacts():
            bodies = contact.bodies
            if self.object in bodies and any(np.any(point.impulse) for point in contact.points):
                touching.update(k for k, pad in enumerate(self.pads) if pad in bodies)
        return touching


def _configure(config: EpisodeConfig) -> None:
    """PhysX reads these when a scene, a shape or a body is made; editing them later has no effect."""
    physx.set_scene_config(gravity=[0, 0, 0], enable_tgs=True, enable_pcm=False, cpu_workers=0)
    physx.set_shape_config(contact_offset=config.contact_offset, rest_offset=0.0)
    physx.set_body_config(
        solver_position_iterations=config.position_iterations,
        solver_velocity_iterations=config.velocity_iterations,
        sleep_threshold=0.0,
    )


class _Unseen(URDFLoader):
    """Leaves the visual shapes out: even to parse their colours SAPIEN would need a renderer."""

    def _build_link(self, link: Any, link_builder: Any) -> None:
        link.visuals = []
        super()._build_link(link, link_builder)


def _hand_builder(hand: Hand, material: physx.PhysxMaterial) -> sapien.ArticulationBuilder:
    """The hand's links and joints, parsed once.

    Links that never move (`hand.fixed`) become one with the base, each shape in its place: half the links, and
    PhysX's cost of an articulation grows with them at every solver iteration.
    """
    loader = _Unseen()
    loader.set_scene(sapien.Scene([physx.PhysxCpuSystem()]))
    (builder,), _, _ = loader.parse(str(hand.urdf))
    base, *others = builder.link_builders
    T_base_still, moving = {base.index: sapien.Pose()}, [base]
    for link in others:
        joint = link.joint_record
        if joint.name in hand.fixed and link.parent.index in T_base_still:
            half = hand.fixed[joint.name] / 2  # about the joint frame's x axis
            rotation = sapien.Pose(q=[math.cos(half), math.sin(half), 0, 0])
            T_base_link = T_base_still[link.parent.index] * joint.pose_in_parent * rotation * joint.pose_in_child.inv()
            T_base_still[link.index] = T_base_link
            for shape in link.collision_records:
                shape.pose = T_base_link * shape.pose
            base.collision_records += link.collision_records
        else:
            if link.parent.index in T_base_still:
                joint.pose_in_parent = T_base_still[link.parent.index] * joint.pose_in_parent
                link.parent = base
            moving.append(link)
    for index, link in enumerate(moving):
        link.index = index
        for shape in link.collision_records:
            shape.material = material
    builder.link_builders = moving
    built = sum(len(link.collision_shapes) for link in builder.build(fix_root_link=True).links)
    wanted = len(next(iter(hand.preshapes.values())).shapes)
    if built != wanted:  # SAPIEN silently skips shapes that it cannot cook
        raise InputError(f"{hand.urdf}: expected {wanted} collision shapes in SAPIEN, got {built}")
    return builder


def _pose(rotation: np.ndarray, position: np.ndarray) -> sapien.Pose:
    quaternion = trimesh.transformations.quaternion_from_matrix(np.asarray(rotation, dtype=np.float64))  # wxyz
    return sapien.Pose(np.asarray(position, dtype=np.float32), quaternion.astype(np.float32))
