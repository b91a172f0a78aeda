"""Read a hand from a URDF as it comes: its links and joints, its collision shapes, and what simulators need to know."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from copy import deepcopy
from difflib import get_close_matches
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.collision_pieces import link_collisions
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.inertia import mended_inertial
from spgf_torch.hands.robot import Collision, Joint, Robot
from spgf_torch.hands.urdf_files import WHAT, urdf_root
from spgf_torch.hands.urdf_joints import Edge, check_mimics, check_tree, joint_element, read_edge, read_joint
from spgf_torch.hands.urdf_numbers import XML

NANOMETRES = 1e9


def read_robot(config: HandConfig) -> Robot:
    """The hand that `hand.urdf` describes, from `hand.root` on.

    Raises InputError, which names the file and the link or joint, for whatever cannot be posed or simulated.
    """
    path, xml = urdf_root(config)
    links, elements = _named(path, xml, "link"), _named(path, xml, "joint")
    edges = [read_edge(path, element) for element in elements.values()]
    check_tree(path, edges, links)
    root = _root(path, config.root, links, edges)
    below = _below(root, edges)
    links = {name: link for name, link in links.items() if name in below}
    joints = [read_joint(path, elements[edge.name]) for edge in edges if edge.parent in below]
    check_mimics(path, joints)
    passive = _passive(path, config, root, joints)
    collisions = [piece for link in links.values() for piece in link_collisions(path, link, config.packages)]
    inertials, notes = _inertials(path, root, links, joints, collisions)
    hand = ElementTree.Element("robot", name=xml.get("name", path.stem))
    hand.extend(_link_element(link, inertials[name]) for name, link in links.items())
    hand.extend(joint_element(joint, elements[joint.name]) for joint in joints)
    ElementTree.indent(hand)
    text = ElementTree.tostring(hand, encoding="unicode")
    return Robot(
        path=path,
        root=root,
        xml=text,
        links=tuple(links),
        joints=tuple(joints),
        collisions=tuple(collisions),
        passive=passive,
        digest=_digest(text, collisions, passive),
        notes=tuple(notes),
    )


def unknown(path: Path, kind: str, name: str, names: Collection[str], key: str) -> InputError:
    """The error for a link or joint that the setting `key` names and the URDF lacks."""
    near = get_close_matches(name, names, 3, 0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(names)}"
    return InputError(f"{key}: expected a {kind} of {path}, got {name}; {hint}")


def _named(path: Path, xml: XML, tag: str) -> dict[str, XML]:
    """Elements that stand in `<robot>`, by name."""
    found: dict[str, XML] = {}
    for element in xml.findall(tag):
        name = element.get("name", "")
        if not name or name in found:
            raise InputError(f"{path}: expected a name of its own for every {tag}, got {name or 'none'}")
        found[name] = element
    if tag == "link" and not found:
        raise InputError(f"{path}: expected {WHAT}, got a <robot> without links")
    return found


def _root(path: Path, wanted: str | None, links: dict[str, XML], joints: list[Edge]) -> str:
    """The link that the hand begins with: the one wanted, or the URDF's root past links that hold nothing."""
    held = {joint.child for joint in joints}
    roots = [name for name in links if name not in held]
    if len(roots) != 1 or len(_below(roots[0], joints)) < len(links):  # what no root leads to hangs in a circle
        raise InputError(f"{path}: expected one link that all others hang from, got {', '.join(roots) or 'a circle'}")
    if wanted is not None:
        if wanted not in links:
            raise unknown(path, "link", wanted, links, "hand.root")
        return wanted
    (root,) = roots
    while links[root].find("collision") is None and links[root].find("inertial") is None:
        children = [joint for joint in joints if joint.parent == root]
        if len(children) != 1 or children[0].moves:
            break
        root = children[0].child
    return root


def _below(root: str, joints: Sequence[Edge | Joint]) -> set[str]:
    """A link and what hangs from it."""
    found, level = {root}, {root}
    while level:
        level = {joint.child for joint in joints if joint.parent in level} - found
        found |= level
    return found


def _passive(path: Path, config: HandConfig, root: str, joints: list[Joint]) -> frozenset[str]:
    """Links that are posed but not simulated: those named, or behind `<mimic>` joints that lead to no finger.

    What hangs from a finger's link is a part of that finger, unless the finger is the palm.
    """
    fingers = {
        link for links in config.fingers.values() for link in ([links] if isinstance(links, str) else links or ())
    }
    if config.passive is not None:
        links = _below(root, joints)
        for name in config.passive:
            if name not in links:
                raise unknown(path, "link", name, sorted(links), "hand.passive")
            if name == root or _below(name, joints) & fingers:
                raise InputError(f"hand.passive: expected links that lead to no finger, got {name}")
        return frozenset(link for name in config.passive for link in _below(name, joints))
    palm = _below(root, [joint for joint in joints if not joint.moves])
    held = {link for finger in fingers - palm for link in _below(finger, joints)}
    behind = [joint.child for joint in joints if joint.mimic is not None and joint.child not in held and fingers]
    return frozenset(link for name in behind if not _below(name, joints) & fingers for link in _below(name, joints))


def _inertials(
    path: Path, root: str, links: dict[str, XML], joints: list[Joint], collisions: list[Collision]
) -> tuple[dict[str, XML | None], list[str]]:
    """The `<inertial>` of each link, put right where it has to be, and a line for each reason to do so."""
    moving = {joint.child for joint in joints if joint.moves}
    made: dict[str, XML | None] = {}
    reasons: dict[str, list[str]] = {}
    for name, link in links.items():
        shapes = [piece for piece in collisions if piece.link == name]
        made[name], why = mended_inertial(path, link, shapes, needed=name in moving or (bool(shapes) and name != root))
        if why:
            reasons.setdefault(why, []).append(name)
    return made, [f"{path.name}: {', '.join(names)}: {why}" for why, names in reasons.items()]


def _link_element(link: XML, inertial: XML | None) -> XML:
    """The link for SAPIEN and pytorch-kinematics: its inertia and those shapes that no mesh file describes."""
    made = ElementTree.Element("link", name=link.get("name", ""))
    if inertial is not None:
        made.append(inertial)
    for collision in link.findall("collision"):
        if collision.find("geometry/mesh") is None:
            shape = ElementTree.SubElement(made, "collision")
            shape.extend(deepcopy(part) for part in collision if part.tag in ("origin", "geometry"))
    return made


def _digest(xml: str, collisions: list[Collision], passive: frozenset[str]) -> str:
    """SHA-256 of all that a trial's outcome depends on, wherever the files lie; pieces to the nanometre."""
    sha = hashlib.sha256(f"{xml}|{' '.join(sorted(passive))}".encode())
    for piece in collisions:
        sha.update(piece.link.encode())
        for array in (piece.mesh.vertices, piece.T_link_shape):
            sha.update(np.round(np.asarray(array, dtype=np.float64) * NANOMETRES).astype(np.int64).tobytes())
    return sha.hexdigest()
