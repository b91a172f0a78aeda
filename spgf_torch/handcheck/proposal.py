"""A description for a bare URDF: what geometry tells, and what it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.handcheck.anatomy import Anatomy, Finger, unit
from spgf_torch.handcheck.arms import check_no_arm
from spgf_torch.handcheck.faces import TURNED, jaw_pads, palmar_pad
from spgf_torch.handcheck.grouping import Grouping, grouping_of
from spgf_torch.hands.config import ClosingConfig, HandConfig, JointConfig, PreshapeConfig
from spgf_torch.hands.drives import SHARE
from spgf_torch.hands.fingers import finger_shape
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.motion import Motion, motion_of
from spgf_torch.hands.pads import pads_of
from spgf_torch.hands.robot import Robot
from spgf_torch.hands.urdf import read_robot

WIDE, NARROW = "wide", "narrow"
NARROWER = 0.5  # of the wide opening: the SDH-2's and the Panda's narrow preshapes are half of the wide ones
LEAST_OPENING = 0.005  # m between fingers that count as open
LEAST_STROKE = math.radians(2)  # a joint that closes by less stands still
FINEST_SHARE = 0.05  # shares are rounded to this
PALM = "palm"  # the finger that a single jaw closes on


@dataclass
class Proposal:
    """A proposed description.

    Attributes:
        config: the description. doubts: key of it -> sentences on what the URDF does not tell.
        hand: as it was loaded; None where it cannot be. error: why.
    """

    config: HandConfig
    doubts: dict[str, list[str]] = field(default_factory=dict)
    hand: Hand | None = None
    error: str = ""

    def doubt(self, key: str, words: str) -> None:
        self.doubts.setdefault(key, []).append(words)


def propose(bare: HandConfig) -> Proposal:
    """A description of the URDF that `bare` names, with its root and packages.

    Raises InputError for a URDF that cannot be read, is of a whole arm, or has no joint that moves a link with a shape.
    """
    check_no_arm(bare)
    robot = read_robot(bare)
    if not any(joint.moves for joint in robot.joints):
        raise InputError(f"{robot.path}: expected a hand with joints that move, got none")
    anatomy = Anatomy.of(robot)
    if not anatomy.fingers:
        raise InputError(f"{robot.path}: expected fingers with collision shapes, got none behind joints that move")
    grouping = grouping_of(anatomy)
    config = replace(bare, approach=[float(value) for value in anatomy.approach])
    config.fingers = {finger.name: list(finger.bodies) for finger in anatomy.fingers}
    if len(anatomy.fingers) == 1:
        config.fingers[PALM] = [anatomy.palm]
    proposal = Proposal(config)
    _shape(proposal, anatomy, grouping)
    _told(proposal, robot, anatomy, grouping)
    try:
        proposal.hand = load_hand(config)
        _closing(proposal, proposal.hand)
    except InputError as error:
        proposal.error = str(error)
    return proposal


def _shape(proposal: Proposal, anatomy: Anatomy, grouping: Grouping) -> None:
    """The preshapes `wide` and `narrow`: by openings of jaws with a joint a finger, by joints of others."""
    groups = [[finger.name for finger in group] for group in grouping.groups]
    hold = {name: _told_value(anatomy, name, value) for name, value in sorted(grouping.held.items())}
    fingers = anatomy.fingers
    common = PreshapeConfig(hold=hold, close=dict(grouping.signs), oppose=groups, opening=0.0)
    if len(fingers) == 1 and len(fingers[0].closers) == 1:
        common.oppose = [*groups, [PALM]]
        common.pads, met = jaw_pads(anatomy, grouping, fingers[0], PALM)
        _single_jaw(proposal, anatomy, common, met)
        return
    if len(groups) == 2 and all(len(finger.closers) == 1 for finger in fingers):
        _jaw(proposal, common, _widest(proposal, anatomy, common))
        return
    wide = grouping.open_at(1.0)
    shares, still = _shares(anatomy, grouping, wide)
    hold |= {name: _told_value(anatomy, name, wide[name]) for name in still}
    pads: dict[str, Any] = {finger.name: palmar_pad(anatomy, grouping, finger) for finger in fingers}
    for name, share in ((WIDE, 1.0), (NARROW, NARROWER)):
        values = {joint: value for joint, value in grouping.open_at(share).items() if joint in shares}
        opened = {joint: _told_value(anatomy, joint, value) for joint, value in values.items()}
        proposal.config.preshapes[name] = PreshapeConfig(hold=hold, open=opened, close=shares, oppose=groups, pads=pads)


def _jaw(proposal: Proposal, common: PreshapeConfig, widest: float) -> None:
    """Two preshapes of a jaw, as wide as it opens (m) and half of that."""
    openings = {WIDE: widest, NARROW: round(NARROWER * widest, 3)}
    proposal.config.preshapes = {name: replace(common, opening=value) for name, value in openings.items()}


def _single_jaw(proposal: Proposal, anatomy: Anatomy, common: PreshapeConfig, met: float) -> None:
    """Two preshapes of a jaw that closes on the palm at the joint's value `met`: open as far as may be, and by half."""
    joint, sign = next(iter(common.close.items()))
    low, high = anatomy.span(joint)
    end = low if sign > 0 else high
    way = abs(end - met) if anatomy.moving[joint].kind == "prismatic" else min(abs(end - met), TURNED)
    for name, share in ((WIDE, 1.0), (NARROW, NARROWER)):
        opened = {joint: _told_value(anatomy, joint, met - sign * share * way)}
        proposal.config.preshapes[name] = replace(common, opening=None, open=opened)


def _widest(proposal: Proposal, anatomy: Anatomy, preshape: PreshapeConfig) -> float:
    """m, to the millimetre below, between the pads of two fingers where the limits let them go."""
    config = replace(proposal.config, preshapes={WIDE: preshape})
    pads = pads_of(_motion(anatomy, config), config, preshape)
    widest = max(pads.opening(limit) for limit in pads.limits)
    return math.floor(1000 * widest + 1e-6) / 1000


def _motion(anatomy: Anatomy, config: HandConfig) -> Motion:
    shapes = {name: finger_shape(anatomy.robot, name, links) for name, links in config.fingers.items()}
    return motion_of(anatomy.kinematics, config, WIDE, shapes)


def _shares(anatomy: Anatomy, grouping: Grouping, wide: dict[str, float]) -> tuple[dict[str, float], list[str]]:
    """Joint -> direction times share, such that all groups press alike; and joints that have no way left to close."""
    levers: dict[str, float] = {}
    still = []
    for group in grouping.groups:
        for finger in group:
            for joint in finger.closers:
                low, high = anatomy.span(joint)
                sign = grouping.signs[joint]
                if ((high if sign > 0 else low) - wide[joint]) * sign < LEAST_STROKE:
                    still.append(joint)
                    continue
                moved = anatomy.velocity(finger, joint, 0.5, {**grouping.held, **wide})
                levers[joint] = max(levers.get(joint, 0.0), float(np.linalg.norm(moved)) / len(group))
    most = max(levers.values(), default=1.0)
    rounded = {joint: max(round(lever / most / FINEST_SHARE), 1) * FINEST_SHARE for joint, lever in levers.items()}
    return {joint: round(grouping.signs[joint] * share, 2) for joint, share in rounded.items()}, still


def _told(proposal: Proposal, robot: Robot, anatomy: Anatomy, grouping: Grouping) -> None:
    """What the URDF leaves open, beside the key that says what was assumed."""
    if abs(np.abs(anatomy.approach).max() - 1) > 1e-6:
        proposal.doubt("approach", "the fingers look between the axes of root; is this the way out of the palm?")
    if len(anatomy.fingers) == 1:
        proposal.doubt("fingers", f"one finger moves: it is taken to close on {anatomy.palm}")
    elif grouping.opposed < 0.5:
        ways = ", ".join(f"{f.name} {_direction(grouping, f)}" for f in anatomy.fingers)
        proposal.doubt("oppose", f"no fingers close against each other; their ends go {ways}")
    if grouping.held:
        proposal.doubt("hold", "these joints spread or turn fingers; other values make other grasp types")
    for name, preshape in proposal.config.preshapes.items():
        if preshape.opening is not None and preshape.opening < LEAST_OPENING:
            proposal.doubt("opening", f"{name} is hardly open: do the fingers close the way that close says?")
    without = sorted({j for f in anatomy.fingers for j in f.closers if anatomy.moving[j].effort is None})
    if without:
        proposal.doubt("closing", f"the URDF gives no effort of {', '.join(without)}: what is here presses with 50 N")
    for note in robot.notes:
        proposal.doubt("urdf", note)


def _closing(proposal: Proposal, hand: Hand) -> None:
    """Write down what was measured of effort, speed and time, rounded."""
    closing = next(iter(hand.preshapes.values())).closing
    effort, speed = (float(f"{value:.2g}") for value in (closing.effort, closing.speed))
    time = math.ceil(10 * closing.time * closing.speed / speed) / 10
    pushes = {n: abs(share) * effort for p in hand.preshapes.values() for n, share in p.closing.phases[0].items()}
    rated = {joint.name: joint.effort for joint in hand.robot.joints if joint.effort}
    weak = sorted(name for name, push in pushes.items() if rated.get(name, push) < push)
    for name in weak:
        proposal.doubt("joints", f"the URDF rates {name} at {rated[name]:g}, which holds nothing: see its data sheet")
    efforts = {name: JointConfig(effort=float(f"{pushes[name] / SHARE:.2g}")) for name in weak}
    proposal.config = replace(proposal.config, joints=efforts, closing=ClosingConfig(effort, speed, time))
    proposal.hand = load_hand(proposal.config)


def _told_value(anatomy: Anatomy, joint: str, value: float) -> float:
    """A joint's value as descriptions say it, deg or m, rounded towards the middle of its range."""
    low, high = anatomy.span(joint)
    if anatomy.moving[joint].kind == "prismatic":
        factor, digits = 1.0, 1e4
    else:
        factor, digits = 180 / math.pi, 1.0
    shown = value * factor * digits
    rounded = math.floor(shown + 1e-6) if value > (low + high) / 2 else math.ceil(shown - 1e-6)
    return float(rounded / digits)


def _direction(grouping: Grouping, finger: Finger) -> str:
    return str([round(float(value), 1) for value in unit(grouping.closing(finger))])
