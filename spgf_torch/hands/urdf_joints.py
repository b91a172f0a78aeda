"""Joints of a URDF: what is read of them, and what is written for the libraries that simulate and pose a hand."""

from __future__ import annotations

import math
from copy import deepcopy
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.robot import Follow, Joint
from spgf_torch.hands.urdf_numbers import XML, number, numbers, pose

KINDS = ("revolute", "continuous", "prismatic", "fixed")
ZERO = 1e-6  # an axis that is shorter says no direction
UNIT = 1e-6  # an axis whose length differs by less stays the text that it is


class Edge(NamedTuple):
    """What any joint of the file does to the tree of links."""

    name: str
    parent: str
    child: str
    moves: bool


def read_edge(path: Path, element: XML) -> Edge:
    name, kind = element.get("name", ""), element.get("type", "")
    return Edge(name, _link_of(path, element, "parent"), _link_of(path, element, "child"), kind != "fixed")


def read_joint(path: Path, element: XML) -> Joint:
    """One `<joint>`; InputError, which names it, for one that no hand can have."""
    name, kind = element.get("name", ""), element.get("type", "")
    where = f"joint {name}"
    if kind not in KINDS:
        raise InputError(f"{path}: {where}: expected a type of {', '.join(KINDS)}; got {kind or 'none'}")
    lower, upper = _range(path, where, kind, element.find("limit"))
    limit = element.find("limit")
    return Joint(
        name=name,
        kind=kind,
        parent=_link_of(path, element, "parent"),
        child=_link_of(path, element, "child"),
        T_parent_joint=pose(path, f"{where}: origin", element.find("origin")),
        axis=_axis(path, where, element) if kind != "fixed" else np.array([1.0, 0.0, 0.0]),
        lower=lower,
        upper=upper,
        effort=_positive(path, f"{where}: effort", limit, "effort"),
        velocity=_positive(path, f"{where}: velocity", limit, "velocity"),
        mimic=_mimic(path, where, element.find("mimic")) if kind != "fixed" else None,
    )


def check_tree(path: Path, joints: list[Edge], links: dict[str, XML]) -> None:
    """InputError for joints of links that are not there, and links that two joints hold."""
    held: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise InputError(f"{path}: joint {joint.name}: expected a link of the file, got {link or 'none'}")
        if joint.child in held:
            raise InputError(f"{path}: expected one joint to hold {joint.child}, got {held[joint.child]}, {joint.name}")
        held[joint.child] = joint.name


def check_mimics(path: Path, joints: list[Joint]) -> None:
    """InputError for a joint that follows none of the hand's that moves, or in a circle itself."""
    by_name = {joint.name: joint for joint in joints}
    for joint in joints:
        followed, seen = joint, [joint.name]
        while followed.mimic is not None:
            name = followed.mimic.of
            if name not in by_name or not by_name[name].moves:
                got = "which does not move" if name in by_name else "which the hand lacks"
                raise InputError(f"{path}: joint {followed.name}: expected <mimic> of a joint, got {name}, {got}")
            if name in seen:
                raise InputError(f"{path}: expected joints that follow others, got a circle: {', '.join(seen)}")
            followed = by_name[name]
            seen.append(name)


def joint_element(joint: Joint, element: XML) -> XML:
    """The joint for SAPIEN and pytorch-kinematics: without `<mimic>`, transmissions, friction; numbers as they were."""
    made = ElementTree.Element("joint", name=joint.name, type=joint.kind)
    made.extend(deepcopy(part) for part in element if part.tag in ("parent", "child", "origin"))
    if joint.moves:
        axis = element.find("axis")
        given = axis is not None and abs(math.hypot(*map(float, axis.get("xyz", "").split())) - 1.0) <= UNIT
        text = axis.get("xyz", "") if axis is not None and given else " ".join(f"{x:.17g}" for x in joint.axis)
        ElementTree.SubElement(made, "axis", xyz=text)
    limit = element.find("limit")
    if limit is not None and joint.moves:
        kept = {key: limit.get(key, "0") for key in ("lower", "upper", "effort", "velocity")}
        ElementTree.SubElement(made, "limit", kept)
    return made


def _link_of(path: Path, element: XML, tag: str) -> str:
    part = element.find(tag)
    link = part.get("link", "") if part is not None else ""
    if not link:
        raise InputError(f"{path}: joint {element.get('name')}: expected a {tag} link, got none")
    return link


def _axis(path: Path, where: str, element: XML) -> np.ndarray:
    """(3,) of unit length; (1, 0, 0) where nothing is said, as URDF has it."""
    axis = element.find("axis")
    given = numbers(path, f"{where}: axis", axis.get("xyz") if axis is not None else "1 0 0", 3)
    length = float(np.linalg.norm(given))
    if length < ZERO:
        raise InputError(f"{path}: {where}: expected an axis of some length, got {given.tolist()}")
    return given / length if abs(length - 1.0) > UNIT else given


def _range(path: Path, where: str, kind: str, limit: XML | None) -> tuple[float, float]:
    """Limits, rad or m: infinite of a continuous joint, 0 of a fixed one."""
    if kind == "fixed":
        return 0.0, 0.0
    if kind == "continuous":
        return -math.inf, math.inf
    if limit is None or (limit.get("lower") is None and limit.get("upper") is None):
        raise InputError(f"{path}: {where}: expected <limit> with lower and upper, got none; or type=continuous")
    lower, upper = (number(path, f"{where}: {key}", limit.get(key, "0")) for key in ("lower", "upper"))
    if lower > upper:
        raise InputError(f"{path}: {where}: expected a lower limit below the upper one, got {lower:g} and {upper:g}")
    return lower, upper


def _positive(path: Path, where: str, limit: XML | None, key: str) -> float | None:
    """What a joint can do; None where nothing or 0 is said."""
    text = limit.get(key) if limit is not None else None
    value = number(path, where, text) if text is not None else 0.0
    return value if value > 0.0 else None


def _mimic(path: Path, where: str, mimic: XML | None) -> Follow | None:
    if mimic is None:
        return None
    ratio, offset = (
        number(path, f"{where}: mimic {key}", mimic.get(key, default))
        for key, default in (("multiplier", "1"), ("offset", "0"))
    )
    return Follow(mimic.get("joint", ""), ratio, offset)
