"""The hand as an articulation in SAPIEN: a rigid body of all links that stand still to each other, joints that move.

What is held or fixed is one with the body that it is fixed to, wherever in a finger: that is exact, nothing is limp,
and PhysX's cost of an articulation grows with its links at every solver iteration.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.hands.preshape import Preshape
from spgf_torch.hands.robot import Robot
from spgf_torch.simulation.fingers import moving_joints
from spgf_torch.simulation.precheck import trees_touch

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message=".*libvulkan.*")
    import sapien
    from sapien import physx
    from sapien.wrapper.articulation_builder import ArticulationBuilder, LinkBuilder
    from sapien.wrapper.urdf_loader import URDFLoader

IGNORED = 32  # bits of SAPIEN's collision group that parts what does not collide


@dataclass(frozen=True)
class Inertia:
    """Mass, kg; centre (3,), m, and tensor (3, 3) about it, kg m2, in the frame of a body."""

    mass: float
    centre: np.ndarray
    tensor: np.ndarray

    def moved(self, T: np.ndarray) -> Inertia:
        """The same in a frame where this one's stands at T (4, 4)."""
        R = T[:3, :3]
        return Inertia(self.mass, R @ self.centre + T[:3, 3], R @ self.tensor @ R.T)

    @staticmethod
    def together(parts: list[Inertia]) -> Inertia:
        """Of several parts in one frame."""
        mass = sum(part.mass for part in parts)
        centre = sum((part.mass * part.centre for part in parts), np.zeros(3)) / mass
        tensor = np.zeros((3, 3))
        for part in parts:
            away = part.centre - centre
            tensor += part.tensor + part.mass * (away @ away * np.eye(3) - np.outer(away, away))  # parallel axes
        return Inertia(mass, centre, tensor)


class _Link(LinkBuilder):
    """One body: the shapes of its links and the names of these links, those of the URDF's own shapes first."""

    def __init__(self, index: int, parent: _Link | None) -> None:
        super().__init__(index, parent)
        self.record_links: list[str] = []
        self.pieces: list[physx.PhysxCollisionShapeConvexMesh] = []
        self.piece_links: list[str] = []

    def build_physx_component(self, link_parent: Any = None) -> physx.PhysxArticulationLinkComponent:
        body = super().build_physx_component(link_parent)
        for piece in self.pieces:
            piece.set_collision_groups(self.collision_groups)
            body.attach(piece)
        return body


class _Builder(ArticulationBuilder):
    def create_link_builder(self, parent: _Link | None = None) -> _Link:
        self.link_builders.append(_Link(len(self.link_builders), parent))
        return self.link_builders[-1]


class HandBuilder:
    """Builds the hand in the open pose of one preshape, as often as wanted; read, merged and cooked once."""

    def __init__(self, robot: Robot, preshape: Preshape, material: physx.PhysxMaterial) -> None:
        self._builder = _parsed(robot)
        for link in self._builder.link_builders:
            _add_pieces(link, robot, material)
            for record in link.collision_records:
                record.material = material
        self._builder.link_builders = _merged(self._builder.link_builders, robot, preshape)
        _part(self._builder.link_builders, preshape)
        self._shape_links = {link.name: link.record_links + link.piece_links for link in self._builder.link_builders}
        built = sum(len(link.collision_shapes) for link in self.build(sapien.Scene([physx.PhysxCpuSystem()])).links)
        wanted = sum(shape.link not in robot.passive for shape in robot.collisions)
        if built != wanted:  # SAPIEN silently skips shapes that it cannot cook
            raise InputError(f"{robot.path}: expected {wanted} collision shapes in SAPIEN, got {built}")

    def build(self, scene: sapien.Scene, T_world_base: np.ndarray | None = None) -> physx.PhysxArticulation:
        """The hand in a scene, its base fixed at T_world_base (4, 4)."""
        T = np.eye(4) if T_world_base is None else T_world_base
        self._builder.set_scene(scene)
        self._builder.set_initial_pose(pose_of(T[:3, :3], T[:3, 3]))
        return self._builder.build(fix_root_link=True, build_mimic_joints=False)

    def shapes(self, articulation: physx.PhysxArticulation, links: set[str]) -> list[physx.PhysxCollisionShape]:
        """The collision shapes of these links of the URDF."""
        return [
            shape
            for body in articulation.links
            for shape, link in zip(body.collision_shapes, self._shape_links[body.name], strict=True)
            if link in links
        ]

    def body_of(self, link: str) -> str:
        """The body that has the collision shapes of a link of the URDF."""
        return next(body for body, links in self._shape_links.items() if link in links)


class _Unseen(URDFLoader):
    """Leaves the visual shapes out: even to parse their colours SAPIEN would need a renderer."""

    def _build_link(self, link: Any, link_builder: Any) -> None:
        link.visuals = []
        super()._build_link(link, link_builder)
        link_builder.record_links = [link.name] * len(link_builder.collision_records)


def _parsed(robot: Robot) -> _Builder:
    loader = _Unseen()
    loader.set_scene(SimpleNamespace(create_articulation_builder=_Builder))
    loader.urdf_dir = loader.package_dir = ""
    loader.ignore_pairs = []
    (builder,), _, _ = loader._parse_urdf(robot.xml)
    return builder


def _add_pieces(link: _Link, robot: Robot, material: physx.PhysxMaterial) -> None:
    for collision in robot.collisions:
        if collision.cut and collision.link == link.name:
            vertices = np.asarray(collision.mesh.vertices, dtype=np.float32)
            piece = physx.PhysxCollisionShapeConvexMesh(vertices=vertices, scale=[1, 1, 1], material=material)
            piece.local_pose = sapien.Pose(collision.T_link_shape)
            link.pieces.append(piece)
            link.piece_links.append(link.name)


def _merged(links: list[_Link], robot: Robot, preshape: Preshape) -> list[_Link]:
    """The bodies that move, parents first; those links that do not are part of them, passive links are left out."""
    base, moving = links[0], moving_joints(preshape)
    bodies, T_body_link = {base.name: base}, {base.name: sapien.Pose()}
    inertias: dict[str, list[Inertia]] = {base.name: []}
    for link in links[1:]:
        if link.name in robot.passive:
            continue
        joint, body = link.joint_record, bodies[link.parent.name]
        joint.pose_in_parent = T_body_link[link.parent.name] * joint.pose_in_parent
        if joint.name in moving:
            link.parent, body, T = body, link, sapien.Pose()
            inertias[link.name] = []
        else:
            T = joint.pose_in_parent * _motion(robot, joint.name, preshape) * joint.pose_in_child.inv()
            _give_shapes(link, body, T)
        bodies[link.name], T_body_link[link.name] = body, T
        inertias[body.name].append(_inertia(link).moved(T.to_transformation_matrix().astype(np.float64)))
    merged = [link for link in links if bodies.get(link.name) is link]
    for index, link in enumerate(merged):
        link.index = index
        if index and len(inertias[link.name]) > 1:  # the base is fixed
            inertia = Inertia.together(inertias[link.name])
            moments, axes = principal_axes(inertia.tensor)
            link.set_mass_and_inertia(inertia.mass, pose_of(axes, inertia.centre), moments)
    return merged


def _motion(robot: Robot, name: str, preshape: Preshape) -> sapien.Pose:
    """What a joint that is held adds, along or about the x axis of its frame in SAPIEN."""
    joint = robot.joint(name)
    if not joint.moves:
        return sapien.Pose()
    value = preshape.joints[name]
    if joint.kind == "prismatic":
        return sapien.Pose(p=[value, 0, 0])
    return sapien.Pose(q=[math.cos(value / 2), math.sin(value / 2), 0, 0])


def _give_shapes(link: _Link, body: _Link, T_body_link: sapien.Pose) -> None:
    for record in link.collision_records:
        record.pose = T_body_link * record.pose
    for piece in link.pieces:
        piece.local_pose = T_body_link * piece.local_pose
    body.collision_records += link.collision_records
    body.record_links += link.record_links
    body.pieces += link.pieces
    body.piece_links += link.piece_links


def _inertia(link: _Link) -> Inertia:
    """Of one link in its own frame; nothing of a link that is a frame alone."""
    if link._auto_inertial:
        return Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    T = link._cmass_local_pose.to_transformation_matrix().astype(np.float64)
    return Inertia(link._mass, np.zeros(3), np.diag(link._inertia)).moved(T)


def _part(links: list[_Link], preshape: Preshape) -> None:
    """Let links collide with those of other fingers alone, so that pads meet, but no joint jams.

    Shapes of neighbours overlap in the files of real hands, and do so elsewhere as the joints turn. A finger is what
    hangs from one joint of the base. Fingers whose shapes overlap in the open hand do not collide either.
    """
    finger: dict[str, int] = {}
    for link in links[1:]:
        finger[link.name] = finger.get(link.parent.name, len(set(finger.values())))
    count = len(set(finger.values()))
    of_link = {name: finger[body.name] for body in links[1:] for name in body.record_links + body.piece_links}
    shapes: list[list[trimesh.Trimesh]] = [[] for _ in range(count)]
    for shape, name in zip(preshape.shapes, preshape.shape_links, strict=True):
        if name in of_link:
            shapes[of_link[name]].append(shape)
    trees = [triangle_tree(meshes) if meshes else None for meshes in shapes]
    overlapping = [pair for pair in combinations(range(count), 2) if trees_touch(*(trees[k] for k in pair))]
    bits = [1 << k for k in range(count)]
    for bit, pair in enumerate(overlapping, count):
        for k in pair:
            bits[k] |= 1 << bit
    if count + len(overlapping) > IGNORED:
        bits = [1] * count
    for link in links:
        ignored = bits[finger[link.name]] if link.name in finger else (1 << IGNORED) - 1
        link.collision_groups = [1, 1, ignored, 0]


def principal_axes(tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments (3,) and right-handed axes (3, 3), columns, of an inertia tensor."""
    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


def pose_of(rotation: np.ndarray, position: np.ndarray) -> sapien.Pose:
    quaternion = trimesh.transformations.quaternion_from_matrix(np.asarray(rotation, dtype=np.float64))  # wxyz
    return sapien.Pose(np.asarray(position, dtype=np.float32), quaternion.astype(np.float32))
