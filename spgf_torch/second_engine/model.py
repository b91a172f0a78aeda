"""Hand and object as one MuJoCo model, made from the same records as SAPIEN's articulation.

The hand's base is the world's frame. Bodies without a joint are one with their parents, as in `articulation`.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.hands.preshape import Drive, Preshape
from spgf_torch.hands.robot import Robot
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.simulation.fingers import moving_joints
from spgf_torch.simulation.precheck import trees_touch

if TYPE_CHECKING:
    from spgf_torch.simulation.config import EpisodeConfig

OBJECT = "object of the trial"  # no link of a URDF is called so
LEAST = 1e-9  # kg, kg m2: MuJoCo's own bounds of what moves are above the inertia of small links


class ModelMaker:
    """Makes the model of one object between the fingers of one preshape."""

    def __init__(self, robot: Robot, preshape: Preshape, episode: EpisodeConfig, config: MujocoConfig) -> None:
        self.robot, self.preshape, self.config = robot, preshape, config
        self.friction = episode.friction
        self.spec = mujoco.MjSpec.from_string(robot.xml)

    def model(self, obj: GraspObject) -> mujoco.MjModel:
        """Compile it: the joints that move, an actuator for each under its name, and the object with a free joint."""
        self._options()
        self._leave_out_passive()
        self._weld_held()
        self._add_pieces()
        for geom in self.spec.geoms:
            self._touch(geom)
        self._part()
        self._add_object(obj)
        moving = {joint.name for joint in self.spec.joints}
        for name, drive in self.preshape.drives.items():
            if name in moving:
                self._drive(name, drive)
        return self.spec.compile()

    def _options(self) -> None:
        spec, config = self.spec, self.config
        spec.option.timestep, spec.option.gravity = config.dt, [0, 0, 0]
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = config.impratio
        spec.compiler.boundmass = spec.compiler.boundinertia = LEAST
        spec.compiler.balanceinertia, spec.compiler.fusestatic = True, False

    def _leave_out_passive(self) -> None:
        parent = {joint.child: joint.parent for joint in self.robot.joints}
        for name in self.robot.passive:
            if parent[name] not in self.robot.passive:  # what hangs from it goes with it
                self.spec.delete(self.spec.body(name))

    def _weld_held(self) -> None:
        """Turn or shift the bodies of joints that are held, and take these joints away."""
        moving = moving_joints(self.preshape)
        for joint in list(self.spec.joints):
            if joint.name in moving:
                joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
                joint.solref_limit = self._solref()
                continue
            body, value = joint.parent, self.preshape.joints[joint.name]
            if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
                body.pos = body.pos + value * rotation_of(body.quat) @ joint.axis
            else:
                turn, turned = np.zeros(4), np.zeros(4)
                mujoco.mju_axisAngle2Quat(turn, joint.axis, value)
                mujoco.mju_mulQuat(turned, body.quat, turn)
                body.quat = turned
            self.spec.delete(joint)

    def _add_pieces(self) -> None:
        """The convex pieces of mesh files; other shapes are in the URDF."""
        for number, piece in enumerate(self.robot.collisions):
            if piece.cut and piece.link not in self.robot.passive:
                geom = self._add_mesh(self.spec.body(piece.link), f"piece {number}", piece.mesh.vertices)
                geom.pos, geom.quat = piece.T_link_shape[:3, 3], quaternion_of(piece.T_link_shape[:3, :3])

    def _add_mesh(self, body: Any, name: str, vertices: np.ndarray) -> Any:
        corners = np.asarray(vertices, dtype=np.float64).ravel()
        self.spec.add_mesh(name=name, uservert=corners, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX)
        return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0)

    def _add_object(self, obj: GraspObject) -> None:
        moments, axes = np.linalg.eigh(obj.inertia)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        body = self.spec.worldbody.add_body(name=OBJECT, mass=obj.mass, ipos=obj.com, inertia=moments)
        body.iquat, body.explicitinertial = quaternion_of(axes), True
        body.add_freejoint()
        for number, part in enumerate(obj.parts):
            self._touch(self._add_mesh(body, f"part {number}", part))

    def _touch(self, geom: Any) -> None:
        config = self.config
        geom.contype, geom.conaffinity, geom.condim = 1, 1, 4
        geom.friction, geom.solref = [self.friction, self.friction * config.torsion, 0.0], self._solref()
        geom.solimp = [config.impedance, config.impedance, 0.001, 0.5, 2]  # the same at every depth

    def _solref(self) -> list[float]:
        return [self.config.time_constant * self.config.dt, self.config.damping_ratio]

    def _part(self) -> None:
        """Let links collide with those of other fingers alone, as in `articulation`."""
        finger = fingers_of(self.robot, self.preshape)
        shapes: dict[str, list[Any]] = {}
        for shape, link in zip(self.preshape.shapes, self.preshape.shape_links, strict=True):
            if name := finger.get(link):
                shapes.setdefault(name, []).append(shape)
        trees = {name: triangle_tree(meshes) for name, meshes in shapes.items()}
        apart = {frozenset(pair) for pair in combinations(trees, 2) if not trees_touch(*(trees[k] for k in pair))}
        with_shapes = [body.name for body in self.spec.bodies if body.geoms]
        for a, b in combinations(with_shapes, 2):
            if frozenset((finger[a], finger[b])) not in apart:
                self.spec.add_exclude(bodyname1=a, bodyname2=b)

    def _drive(self, name: str, drive: Drive) -> None:
        actuator = self.spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=drive.stiffness, kv=drive.damping)
        actuator.forcelimited, actuator.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-drive.effort, drive.effort]


def fingers_of(robot: Robot, preshape: Preshape) -> dict[str, str]:
    """Link -> the joint that its finger hangs from: the first that moves, from the base on; "" of the palm."""
    above, moving = {joint.child: joint for joint in robot.joints}, moving_joints(preshape)
    found = {}
    for link in robot.links:
        finger, at = "", link
        while at in above:
            finger = above[at].name if above[at].name in moving else finger
            at = above[at].parent
        found[link] = finger
    return found


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """(4,) wxyz of a rotation (3, 3)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation, dtype=np.float64).ravel())
    return quaternion


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3) of a quaternion (4,) wxyz."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.ascontiguousarray(quaternion, dtype=np.float64))
    return matrix.reshape(3, 3)
