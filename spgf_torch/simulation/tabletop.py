"""A table with objects on it in SAPIEN, under gravity: what arrangements and attempts share.

World frame: the table's top is z = 0, z up, m. Every use builds a new scene. PhysX's global settings are read when a
shape or body is made: so all shapes are cooked first, then the settings are set, then bodies are made. What happens
is then the same to the bit whatever the process did before.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import fcl
import numpy as np
from numpy.typing import ArrayLike

from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.articulation import physx, pose_of, principal_axes, sapien
from spgf_torch.simulation.precheck import hull

TABLE = (1.0, 1.0, 0.1)  # m, half its sides and thickness
SLEEP = 5e-5  # m2/s2, kinetic energy a kilogram below which what slept sleeps again: 1 cm/s, PhysX's way of saying it
MOST_KEPT = 512  # objects whose shapes are kept


class Physics(Protocol):
    """What a scene is stepped with: keys of `config.EpisodeConfig` and `clutter_config.ArrangementConfig`."""

    dt: float
    position_iterations: int
    velocity_iterations: int
    contact_offset: float
    friction: float
    depenetration: float
    gravity: float


@dataclass(frozen=True)
class Placed:
    """An object and where it is: T_world_object (4, 4) float64."""

    obj: GraspObject
    T_world_object: np.ndarray

    @property
    def centre(self) -> np.ndarray:
        """(3,) m, the centre of mass in the world."""
        return self.T_world_object[:3, :3] @ self.obj.com + self.T_world_object[:3, 3]

    @property
    def points(self) -> np.ndarray:
        """(V, 3) m, the corners of its collision pieces in the world."""
        return np.concatenate(self.obj.parts) @ self.T_world_object[:3, :3].T + self.T_world_object[:3, 3]


class Tabletop:
    """One scene: a table and bodies, in the order of `placed`."""

    def __init__(self, placed: Sequence[Placed], physics: Physics, asleep: bool = False) -> None:
        """`asleep`: objects lie still, at no cost, until something that moves touches them."""
        self.physics = physics
        self.bodies: list[physx.PhysxRigidDynamicComponent] = []
        known = [Known.of(each.obj) for each in placed]
        shapes = [_cooked(each, physics.friction, known[:index].count(each)) for index, each in enumerate(known)]
        for piece in itertools.chain(*shapes):
            piece.contact_offset = physics.contact_offset
        configure(physics)
        self.system = physx.PhysxCpuSystem()
        self.scene = sapien.Scene([self.system])
        self.scene.timestep = physics.dt
        self.material = material_of(physics)
        self.table = self.add_box(TABLE, (0.0, 0.0, -TABLE[2]))
        for each, pieces in zip(placed, shapes, strict=True):
            self._add(each, pieces)
        if asleep:
            for body in self.bodies:
                body.sleep_threshold = SLEEP
                body.put_to_sleep()
            self.system.step()  # poses are what PhysX makes of those given, as after any step

    def add_box(self, half_size: ArrayLike, centre: ArrayLike) -> physx.PhysxRigidStaticComponent:
        """A box that stands still."""
        box = physx.PhysxRigidStaticComponent()
        box.attach(physx.PhysxCollisionShapeBox(half_size=np.asarray(half_size, np.float32), material=self.material))
        entity = sapien.Entity()
        entity.add_component(box)
        entity.pose = sapien.Pose(np.asarray(centre, dtype=np.float32))
        self.scene.add_entity(entity)
        return box

    def _add(self, placed: Placed, pieces: Sequence[physx.PhysxCollisionShapeConvexMesh]) -> None:
        body, obj = physx.PhysxRigidDynamicComponent(), placed.obj
        for piece in pieces:
            body.attach(piece)
        moments, axes = principal_axes(obj.inertia)
        body.mass, body.cmass_local_pose, body.inertia = obj.mass, pose_of(axes, obj.com), moments
        body.max_depenetration_velocity = self.physics.depenetration
        entity = sapien.Entity()
        entity.add_component(body)
        entity.pose = pose_of(placed.T_world_object[:3, :3], placed.T_world_object[:3, 3])
        self.scene.add_entity(entity)
        self.bodies.append(body)

    def poses(self) -> list[np.ndarray]:
        """T_world_object (4, 4) float64 of every body."""
        return [matrix_of(body.entity.pose) for body in self.bodies]

    def step(self, seconds: float) -> None:
        """Let so many seconds pass."""
        for _ in range(round(seconds / self.physics.dt)):
            self.system.step()


def material_of(physics: Physics) -> physx.PhysxMaterial:
    return physx.PhysxMaterial(physics.friction, physics.friction, 0.0)


def configure(physics: Physics) -> None:
    """PhysX reads these when a scene, a shape or a body is made; editing them later has no effect."""
    physx.set_scene_config(gravity=[0, 0, -physics.gravity], enable_tgs=True, enable_pcm=False, cpu_workers=0)
    physx.set_shape_config(contact_offset=physics.contact_offset, rest_offset=0.0)
    physx.set_body_config(
        solver_position_iterations=physics.position_iterations,
        solver_velocity_iterations=physics.velocity_iterations,
        sleep_threshold=0.0,
    )


@dataclass(frozen=True)
class Known:
    """An object that caches know by its digest."""

    digest: str
    obj: GraspObject = field(compare=False, repr=False)

    @staticmethod
    def of(obj: GraspObject) -> Known:
        return Known(obj.digest, obj)


@lru_cache(maxsize=MOST_KEPT)
def surface(known: Known) -> fcl.BVHModel:
    """The surface of an object's pieces in its frame, made once in a process."""
    return triangle_tree([hull(part) for part in known.obj.parts])


@lru_cache(maxsize=MOST_KEPT)
def _cooked(known: Known, friction: float, copy: int) -> list[physx.PhysxCollisionShapeConvexMesh]:
    """The shapes of an object, cooked once in a process; others of the same object have shapes of their own."""
    material = physx.PhysxMaterial(friction, friction, 0.0)
    return [
        physx.PhysxCollisionShapeConvexMesh(
            vertices=np.asarray(part, dtype=np.float32), scale=[1, 1, 1], material=material
        )
        for part in known.obj.parts
    ]


def matrix_of(pose: sapien.Pose) -> np.ndarray:
    """(4, 4) float64."""
    return np.asarray(pose.to_transformation_matrix(), dtype=np.float64)
