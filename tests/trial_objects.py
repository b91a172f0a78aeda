"""Objects and hands made by hand for the tests of trials (m, kg)."""

from __future__ import annotations

import numpy as np
import trimesh

from spgf_torch.objects.grasp_object import GraspObject


def solid(name: str, mesh: trimesh.Trimesh, mass: float, category: str = "boxes") -> GraspObject:
    """A convex object of uniform density."""
    inertia = mesh.moment_inertia * (mass / mesh.mass)
    return GraspObject(name, category, mesh, (np.asarray(mesh.vertices),), mass, mesh.center_mass, inertia)


def lift(height: float) -> np.ndarray:
    return trimesh.transformations.translation_matrix([0, 0, height])


def box(size: tuple[float, float, float], mass: float = 0.2) -> GraspObject:
    return solid("box", trimesh.creation.box(size, transform=lift(size[2] / 2)), mass)


def can(radius: float = 0.033, height: float = 0.12, mass: float = 0.3) -> GraspObject:
    mesh = trimesh.creation.cylinder(radius, height, sections=32, transform=lift(height / 2))
    return solid("can", mesh, mass, "curved")


def ball(radius: float = 0.035, mass: float = 0.1) -> GraspObject:
    return solid("ball", trimesh.creation.icosphere(subdivisions=3, radius=radius).apply_transform(lift(radius)), mass)


def cup(radius: float = 0.04, height: float = 0.09, wall: float = 0.003, mass: float = 0.25) -> GraspObject:
    """A straight cup: a floor and 24 wall segments, exact parts of the mesh."""
    sides = 24
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])

    def ring(r: float, z: float) -> np.ndarray:
        return np.column_stack([r * circle, np.full(sides, z)])

    corners = [ring(radius, wall), ring(radius, height), ring(radius - wall, wall), ring(radius - wall, height)]
    walls = [np.concatenate([c[[k, (k + 1) % sides]] for c in corners]) for k in range(sides)]
    floor = np.concatenate([ring(radius, 0), ring(radius, wall)])
    profile = [[0, 0], [radius, 0], [radius, height], [radius - wall, height], [radius - wall, wall], [0, wall]]
    mesh = trimesh.creation.revolve(np.array(profile), sections=sides)
    inertia = mesh.moment_inertia * (mass / mesh.mass)
    return GraspObject("cup", "containers", mesh, (floor, *walls), mass, mesh.center_mass, inertia)


def bin_(size: tuple[float, float, float] = (0.2, 0.15, 0.15), wall: float = 0.0015) -> GraspObject:
    """An open box with thin walls."""
    x, y, z = size
    slabs = [
        ((x, y, wall), (0, 0, wall / 2)),
        *(((wall, y, z), (s * (x - wall) / 2, 0, z / 2)) for s in (-1, 1)),
        *(((x - 2 * wall, wall, z), (0, s * (y - wall) / 2, z / 2)) for s in (-1, 1)),
    ]
    plates = [trimesh.creation.box(e, transform=trimesh.transformations.translation_matrix(c)) for e, c in slabs]
    mesh = trimesh.util.concatenate(plates)
    inertia = mesh.moment_inertia * (0.2 / mesh.mass)
    parts = tuple(np.asarray(plate.vertices) for plate in plates)
    return GraspObject("bin", "containers", mesh, parts, 0.2, mesh.center_mass, inertia)


def grasp(position: tuple[float, float, float], approach: tuple, closing: tuple) -> np.ndarray:
    """T_object_tcp (4, 4) float32."""
    z, x = np.array(approach, dtype=float), np.array(closing, dtype=float)
    T = np.eye(4, dtype=np.float32)
    T[:3] = np.column_stack([x, np.cross(z, x), z, position])
    return T


def from_above(height: float, x: float = 0.0) -> np.ndarray:
    return grasp((x, 0, height), (0, 0, -1), (1, 0, 0))


def from_side(height: float) -> np.ndarray:
    return grasp((0, 0, height), (0, 1, 0), (1, 0, 0))


PARALLEL_JAW = """<robot name="jaw">
  <link name="palm">
    <inertial><mass value="0.7"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>
    <collision><origin xyz="0 0 0.03"/><geometry><box size="0.06 0.2 0.06"/></geometry></collision>
  </link>
  {fingers}
</robot>"""

JAW_FINGER = """<link name="{name}">
    <inertial><origin xyz="0 0.01 0.025"/><mass value="0.05"/>
      <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0 0.01 0.025"/><geometry><box size="0.02 0.02 0.05"/></geometry></collision>
  </link>
  <joint name="{name}_joint" type="prismatic">
    <parent link="palm"/><child link="{name}"/><origin xyz="0 0 0.06" rpy="0 0 {yaw}"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.05" effort="70" velocity="0.2"/>
  </joint>"""


def parallel_jaw() -> str:
    """A gripper of two prismatic fingers whose joint values grow as it opens (as the Panda's do)."""
    fingers = [JAW_FINGER.format(name=name, yaw=yaw) for name, yaw in (("left", 0.0), ("right", 3.141592653589793))]
    return PARALLEL_JAW.format(fingers="\n  ".join(fingers))


def jaw_settings(urdf: str) -> dict:
    """Description of the parallel jaw: N/m and N where a revolute hand has Nm/rad and Nm."""
    fingers = ("left", "right")
    pinch = {
        "close": {f"{n}_joint": -1 for n in fingers},
        "pads": {n: [0, 0, 0.04] for n in fingers},
        "symmetry": 2,
    }
    return {
        "name": "jaw",
        "urdf": urdf,
        "root": "palm",
        "joints": {f"{n}_joint": {"effort": 70, "stiffness": 2000, "damping": 60} for n in fingers},
        "fingers": {n: [n] for n in fingers},
        "preshapes": {"NPG": {"opening": 0.045, **pinch}, "WPG": {"opening": 0.095, **pinch}},
        "closing": {"effort": 20, "speed": 0.1, "time": 0.9},
    }
