"""A hand that is carried about without turning: its base on three joints that slide, in place of a robot's arm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.simulation.articulation import HandBuilder, physx, sapien

if TYPE_CHECKING:
    from spgf_torch.hands.preshape import Preshape
    from spgf_torch.hands.robot import Robot
    from spgf_torch.simulation.clutter_config import AttemptConfig

# The joints that carry the base, and the turn (wxyz) that takes their x axis, along which SAPIEN slides, to x, y, z.
HALF = math.sqrt(0.5)
SLIDES: Mapping[str, list[float]] = {
    "carrier x": [1, 0, 0, 0],
    "carrier y": [HALF, 0, 0, HALF],
    "carrier z": [HALF, 0, -HALF, 0],
}
REACH = 1.0  # m that each of them slides to either side
INERTIA = [0.01] * 3  # kg m2; what slides does not turn, so that it does not count


class CarriedHandBuilder(HandBuilder):
    """Builds a hand whose base slides along its own axes, weightless as if an arm bore it."""

    def __init__(self, robot: Robot, preshape: Preshape, material: physx.PhysxMaterial, config: AttemptConfig) -> None:
        super().__init__(robot, preshape, material)
        self._config = config
        base, *fingers = self._builder.link_builders
        self._builder.link_builders = []
        parent = self._builder.create_link_builder()
        parent.set_name("carrier root")
        carriers = [parent := self._builder.create_link_builder(parent) for _ in list(SLIDES)[:-1]]
        base.parent = parent
        for link, (name, turn) in zip([*carriers, base], SLIDES.items(), strict=True):
            along = sapien.Pose(q=turn)
            link.set_joint_name(name)
            link.set_joint_properties("prismatic", [[-REACH, REACH]], along, along)
            link.set_mass_and_inertia(config.arm_mass, sapien.Pose(), INERTIA)
        for link, name in zip(carriers, SLIDES, strict=False):
            link.set_name(name)
        self._builder.link_builders += [base, *fingers]
        for index, link in enumerate(self._builder.link_builders):
            link.index = index
            self._shape_links.setdefault(link.name, [])

    def build(self, scene: sapien.Scene, T_world_base: np.ndarray | None = None) -> physx.PhysxArticulation:
        """The hand in a scene, its base at T_world_base (4, 4), where it is held until `Carrier` moves it."""
        articulation = super().build(scene, T_world_base)
        for link in articulation.links:
            link.disable_gravity = True
        return articulation

    def group_shapes(
        self, articulation: physx.PhysxArticulation, robot: Robot, preshape: Preshape
    ) -> list[list[physx.PhysxCollisionShape]]:
        """The collision shapes of each opposing group of fingers, and of what is fixed to them."""
        bodies, groups = robot.bodies(), []
        for group in preshape.groups:
            touching = {bodies[link] for link in group}
            groups.append(self.shapes(articulation, {link for link, body in bodies.items() if body in touching}))
        return groups


class Carrier:
    """Moves the base of a carried hand."""

    def __init__(self, articulation: physx.PhysxArticulation, T_world_base: np.ndarray, config: AttemptConfig) -> None:
        joints = {joint.name: (place, joint) for place, joint in enumerate(articulation.active_joints)}
        self._articulation, self._rotation, self._start = articulation, T_world_base[:3, :3], T_world_base[:3, 3]
        self._places = [joints[name][0] for name in SLIDES]
        self._joints = [joints[name][1] for name in SLIDES]
        for joint in self._joints:
            joint.set_drive_properties(config.arm_stiffness, config.arm_damping, config.arm_effort)
            joint.set_drive_target(0.0)

    def go(self, way: np.ndarray) -> None:
        """Aim so far from the start: (3,) m in the world."""
        for joint, value in zip(self._joints, self._rotation.T @ way, strict=True):
            joint.set_drive_target(float(value))

    @property
    def way(self) -> np.ndarray:
        """(3,) m in the world, how far the base has come."""
        return self._rotation @ np.asarray(self._articulation.qpos, dtype=np.float64)[self._places]
