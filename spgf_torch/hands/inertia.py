"""Masses and inertias of links: kept as they are where a body can have them, else taken from the link's shapes."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.robot import Collision
from spgf_torch.hands.urdf_numbers import XML, number, pose

DENSITY = 1000.0  # kg/m3, of links without a mass: SAPIEN's own for shapes
LEAST_MASS = 1e-3  # kg, of a moving link without mass and shapes: PhysX would take 1 kg
LEAST_RADIUS = 0.01  # m, of the ball that stands for such a link
SLACK = 1.05  # a principal moment may exceed the sum of the other two by this: rounding in published files
LEAST_SHARE = 1e-6  # of the largest principal moment, which the least one is at least
UPPER = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def mended_inertial(path: Path, link: XML, shapes: list[Collision], needed: bool) -> tuple[XML | None, str]:
    """The `<inertial>` of a link, its numbers the text that they were, and no words; else one from its shapes, and why.

    Args:
        needed: whether a link without a mass gets one.
    """
    given, where = link.find("inertial"), f"link {link.get('name')}: inertial"
    mass_element = given.find("mass") if given is not None else None
    mass = number(path, f"{where}: mass", mass_element.get("value")) if mass_element is not None else 0.0
    if mass < 0.0:
        raise InputError(f"{path}: {where}: expected a mass of 0 or more, got {mass:g}")
    if given is None or mass == 0.0:
        if not needed:
            return None, ""
        mass, com, inertia = _from_shapes(shapes, None)
        what = f"{DENSITY:g} kg/m3 of its shapes" if shapes else f"{LEAST_MASS * 1e3:g} g"
        return _element(mass, com, inertia), f"no mass, {what} assumed"
    if _possible(_tensor(path, where, given.find("inertia"))):
        kept = ElementTree.Element("inertial")
        kept.extend(deepcopy(part) for part in given if part.tag in ("origin", "mass", "inertia"))
        return kept, ""
    T = pose(path, f"{where}: origin", given.find("origin"))
    _, com, inertia = _from_shapes(shapes, mass)
    com = T[:3, 3] if given.find("origin") is not None or not shapes else com
    what = "its shapes" if shapes else f"a ball of {DENSITY:g} kg/m3"
    return _element(mass, com, inertia), f"an inertia that no body has, that of {what} assumed"


def _tensor(path: Path, where: str, inertia: XML | None) -> np.ndarray:
    if inertia is None:
        return np.zeros((3, 3))
    tensor = np.zeros((3, 3))
    for key, at in zip(UPPER, zip(*np.triu_indices(3), strict=True), strict=True):
        tensor[at] = tensor[at[::-1]] = number(path, f"{where}: {key}", inertia.get(key, "0"))
    return tensor


def _possible(inertia: np.ndarray) -> bool:
    """Whether some body has this inertia: positive definite, no principal moment above the sum of the others."""
    least, middle, most = np.linalg.eigvalsh(inertia)
    return bool(least > LEAST_SHARE * most and most <= SLACK * (least + middle))


def _from_shapes(shapes: list[Collision], mass: float | None) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass in the link's frame and inertia about it, of the shapes together or of a small ball."""
    if not shapes:
        if mass is None:
            mass, radius = LEAST_MASS, LEAST_RADIUS
        else:
            radius = (mass / DENSITY * 3 / (4 * np.pi)) ** (1 / 3)
        return mass, np.zeros(3), np.eye(3) * 0.4 * mass * radius**2
    meshes = [piece.mesh.copy().apply_transform(piece.T_link_shape) for piece in shapes]
    volumes = np.array([mesh.volume for mesh in meshes])
    share = volumes / volumes.sum()
    com = share @ np.array([mesh.center_mass for mesh in meshes])
    inertia = np.zeros((3, 3))
    for mesh in meshes:
        arm = mesh.center_mass - com
        inertia += mesh.moment_inertia + mesh.volume * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    mass = DENSITY * float(volumes.sum()) if mass is None else mass
    return mass, com, inertia * (mass / volumes.sum())


def _element(mass: float, com: np.ndarray, inertia: np.ndarray) -> XML:
    made = ElementTree.Element("inertial")
    ElementTree.SubElement(made, "origin", xyz=" ".join(f"{x:.9g}" for x in com), rpy="0 0 0")
    ElementTree.SubElement(made, "mass", value=f"{mass:.9g}")
    values = inertia[np.triu_indices(3)]
    ElementTree.SubElement(made, "inertia", {key: f"{x:.9g}" for key, x in zip(UPPER, values, strict=True)})
    return made
