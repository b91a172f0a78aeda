"""The hand: a URDF and a description, made into one preshape for each grasp type.

Frames: `base` is the root link, with the axes of its URDF; `tcp` lies between the pads, +z along the approach, +x
closing. Everything about a hand follows from its URDF and its description (docs/howto/hand.md); there is no code for
one hand.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.config import ClosingConfig, HandConfig, PreshapeConfig, grasp_types
from spgf_torch.hands.drives import closing_settings, drives_of
from spgf_torch.hands.fingers import finger_shape
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.hands.motion import Motion, check_known, motion_of
from spgf_torch.hands.pads import Pads, pads_of
from spgf_torch.hands.preshape import Closing, Preshape
from spgf_torch.hands.robot import Robot
from spgf_torch.hands.urdf import read_robot
from spgf_torch.settings import plain, typed

ALL_TYPES = "CG"  # all types of a hand together, as the paper calls it
PAD = 0.01  # m, half a fingertip's width: what of a finger is level with the TCP

__all__ = ["Hand", "closing_poses", "load_hand"]


@dataclass(frozen=True)
class Hand:
    """A hand with the preshape of every grasp type; picklable, so that workers need neither kinematics nor files.

    Attributes:
        config: its description. robot: what its URDF says.
        preshapes: grasp type -> Preshape, sorted by name.
        digest: SHA-256 over the URDF, its meshes and the description, wherever the files lie.
    """

    config: HandConfig
    robot: Robot = field(repr=False)
    preshapes: dict[str, Preshape] = field(repr=False)
    digest: str

    @property
    def base_link(self) -> str:
        """The URDF's link of frame base."""
        return self.robot.root

    @property
    def urdf(self) -> Path:
        return self.robot.path


def load_hand(config: HandConfig) -> Hand:
    """The hand of a description; cached by content.

    Raises InputError for a missing or unreadable URDF, a link or joint that it lacks, a value out of reach.
    """
    robot, settings = read_robot(config), json.dumps(plain(config), sort_keys=True)
    key = (robot.digest + _mimics(robot), str(robot.path), settings)
    if key not in _HANDS:
        if len(_HANDS) >= MOST_HANDS:
            _HANDS.pop(next(iter(_HANDS)))
        _HANDS[key] = _hand(robot, typed(HandConfig, json.loads(settings)))
    return _HANDS[key]


MOST_FINGERS, MOST_TYPES = 20, 50
MOST_HANDS = 16  # kept of those that were loaded
_HANDS: dict[tuple[str, str, str], Hand] = {}


def _hand(robot: Robot, config: HandConfig) -> Hand:
    if not config.preshapes:
        raise InputError("hand.preshapes: expected one or more, got none")
    for name in config.preshapes:  # columns, files and partitions of shards are called so
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}", name) or name == ALL_TYPES:
            raise InputError(f"hand.preshapes: expected names of letters, digits, _ and -, not CG; got {name!r:.60}")
    config = _with_known_names(robot, config)
    kinematics = Kinematics(robot)
    approach = np.asarray(config.approach, dtype=np.float64)
    if approach.shape != (3,) or not np.linalg.norm(approach) > 0:
        raise InputError(f"hand.approach: expected three numbers, not all 0; got {config.approach}")
    shapes = {finger: finger_shape(robot, finger, links) for finger, links in config.fingers.items()}
    opened = [_opened(config, name, motion_of(kinematics, config, name, shapes)) for name in grasp_types(config)]
    closing = closing_settings(config, [(each.pads.motion, each.joints, each.closed) for each in opened])
    preshapes = {
        name: _preshape(each, config, closing, approach / np.linalg.norm(approach))
        for name, each in zip(grasp_types(config), opened, strict=True)
    }
    told = {key: value for key, value in plain(config).items() if key not in ("urdf", "packages")}
    followed = any(set(preshapes[name].closing.follow) - set(config.preshapes[name].parallel) for name in preshapes)
    content = robot.digest + json.dumps(told, sort_keys=True) + (_mimics(robot) if followed else "")
    return Hand(config, robot, preshapes, hashlib.sha256(content.encode()).hexdigest())


def _mimics(robot: Robot) -> str:
    """The rules of a URDF's `<mimic>` joints, which its XML for SAPIEN leaves out."""
    rules = {j.name: [j.mimic.of, j.mimic.ratio, j.mimic.offset] for j in robot.joints if j.mimic is not None}
    return json.dumps(rules, sort_keys=True)


def _with_known_names(robot: Robot, config: HandConfig) -> HandConfig:
    """The same with each finger a list of links. Raises InputError for links and joints that the URDF has not."""
    if len(config.fingers) > MOST_FINGERS or len(config.preshapes) > MOST_TYPES:
        got = f"{len(config.fingers)} fingers, {len(config.preshapes)} preshapes"
        raise InputError(f"hand: expected at most {MOST_FINGERS} fingers and {MOST_TYPES} preshapes, got {got}")
    fingers = {name: [links] if isinstance(links, str) else links for name, links in config.fingers.items()}
    for name, links in fingers.items():
        if not isinstance(links, list) or not links:
            raise InputError(f"hand.fingers.{name}: expected a list of links, got {links!r:.40}")
        check_known(f"hand.fingers.{name}", links, robot.links, "a link")
    check_known("hand.joints", config.joints, (j.name for j in robot.joints if j.moves), "a joint that moves")
    return replace(config, fingers=fingers)


@dataclass(frozen=True)
class _Opened:
    """One preshape: its settings, its pads, and all joint values (rad or m) open and with the fingers meeting."""

    told: PreshapeConfig
    pads: Pads
    joints: dict[str, float]
    closed: dict[str, float]


def _opened(config: HandConfig, name: str, motion: Motion) -> _Opened:
    told = config.preshapes[name]
    pads = pads_of(motion, config, told)
    if told.opening is None:
        start = motion.open()
        return _Opened(told, pads, motion.joints(start), motion.meeting(start, pads.passed(motion.joints(start))))
    if told.open:
        raise InputError(f"{motion.where}: expected opening or open, got both")
    if len(motion.groups) != 2:
        raise InputError(f"{motion.where}.opening: expected two opposing groups, got {len(motion.groups)}; say open")
    return _Opened(told, pads, pads.solve(told.opening), pads.closed())


def _preshape(opened: _Opened, config: HandConfig, closing: ClosingConfig, approach: np.ndarray) -> Preshape:
    told, pads, joints, motion = opened.told, opened.pads, opened.joints, opened.pads.motion
    links = motion.kinematics.links(joints)
    T_base_tcp = pads.tcp(told, approach, links)
    T_tcp_base = np.linalg.inv(T_base_tcp)
    collisions = motion.kinematics.robot.collisions
    jaw = len(motion.groups) == 2 and all(len(group) == 1 for group in motion.groups)
    assert closing.effort and closing.speed and closing.time
    return Preshape(
        joints=joints,
        closed=opened.closed,
        T_base_tcp=T_base_tcp,
        T_base_link=links,
        shapes=tuple(  # with the normals that they were made with: new ones differ in the last digits
            c.mesh.copy(include_cache=True).apply_transform(T_tcp_base @ links[c.link] @ c.T_link_shape)
            for c in collisions
        ),
        shape_links=tuple(c.link for c in collisions),
        drives=drives_of(config, motion, closing),
        held=frozenset(motion.held),
        closing=Closing(motion.phases, motion.follow, closing.effort, closing.speed, closing.time),
        groups=tuple(tuple(link for finger in group for link in config.fingers[finger]) for group in motion.groups),
        touch=told.touch or len(motion.groups),
        pads=pads.at(links),
        opening=_opening(told, motion, links, T_base_tcp),
        jaw=jaw,
        symmetry=told.symmetry or (2 if jaw and _both_move(motion, config) else 1),
        sampler=told.sampler,
    )


def _opening(told: PreshapeConfig, motion: Motion, links: dict[str, np.ndarray], T_base_tcp: np.ndarray) -> float:
    """m that are free between opposing groups (`Preshape.opening`), `PAD` about the height of the TCP."""
    if told.opening is not None:
        return told.opening
    T_tcp_base = np.linalg.inv(T_base_tcp)
    sides = []
    for group in motion.shape_groups:
        points = np.concatenate([shape.points_at(links) for shape in group]) @ T_tcp_base[:3, :3].T + T_tcp_base[:3, 3]
        level = np.abs(points[:, 2]) <= PAD
        sides.append(points[level] if level.any() else points)
    if len(sides) == 2:
        low, high = sorted(sides, key=lambda points: float(points[:, 0].mean()))
        return max(float(high[:, 0].min() - low[:, 0].max()), 0.0)
    return 2 * float(min(np.linalg.norm(points[:, :2], axis=1).min() for points in sides))


def _both_move(motion: Motion, config: HandConfig) -> bool:
    """Whether both fingers of a jaw close: else a hand that is turned by half a turn is another one."""
    moving = motion.closing.keys() | motion.follow.keys()
    parent = {joint.child: joint for joint in motion.kinematics.robot.joints}

    def moves(link: str) -> bool:
        while link in parent:
            if parent[link].name in moving:
                return True
            link = parent[link].parent
        return False

    return all(moves(config.fingers[finger][0]) for group in motion.groups for finger in group)


def closing_poses(hand: Hand, grasp_type: str, fractions: np.ndarray) -> np.ndarray:
    """How far the shapes of an open hand have moved at fractions (F,) of the way to `closed`: 0 open, 1 closed.

    Returns (F, shapes, 4, 4) float64 displacements in the TCP frame, of `Preshape.shapes` as they stand there.
    """
    preshape = hand.preshapes[grasp_type]
    kinematics, start, end = Kinematics(hand.robot), preshape.joints, preshape.closed
    path = [{name: start[name] + float(f) * (end[name] - start[name]) for name in start} for f in fractions]
    links, T_tcp_base = kinematics.along(path), np.linalg.inv(preshape.T_base_tcp)
    moved = [
        T_tcp_base @ links[link] @ np.linalg.inv(T_tcp_base @ preshape.T_base_link[link])
        for link in preshape.shape_links
    ]
    return np.stack(moved, axis=1)
