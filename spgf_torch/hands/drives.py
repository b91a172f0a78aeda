"""Drives of a hand's joints, and how hard, fast and long it closes: from its settings, else from its URDF and geometry.

What follows where nothing is said: a finger presses with three quarters of its joint's effort, what is left holds
against shaking (as the SDH-2 with 1.6 of 2.1 Nm), but with at most `PAD_FORCE`, since many URDFs hold placeholders; it
closes its whole stroke in `STROKE_TIME`, unless the URDF's velocity is less; its drive reaches the closing effort
after `LEAD` at that speed, the time that a stall must last in an episode; damping takes a quarter of the effort then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.config import ClosingConfig, HandConfig, JointConfig
from spgf_torch.hands.motion import Motion
from spgf_torch.hands.preshape import Drive
from spgf_torch.hands.robot import Follow

SHARE = 0.75  # of a joint's effort
PAD_FORCE = 50.0  # N, of a finger; as the shipped parallel jaw presses
PLACEHOLDER = 2.0  # N; an effort that gives less at the fingertip, as the WSG 50's URDF with 1 N, is no rating
STROKE_TIME = 0.8  # s from open to closed; the shipped parallel jaw's, from 80 mm to 0
LEAD = 0.04  # s
RELAX = 0.01  # s; damping over stiffness
MARGIN = 0.3  # s beyond the stroke until the fingers must stand still
LINKAGE = 4.0  # times the closing effort that what follows (gears, four-bars) bears


# Of one preshape its motion, and the joints (rad or m) of the open and of the closed hand.
Span = tuple[Motion, Mapping[str, float], Mapping[str, float]]


def closing_settings(config: HandConfig, spans: Sequence[Span]) -> ClosingConfig:
    """Effort, speed and time of a hand that closes so; what the settings give stays as it is."""
    told = config.closing
    effort = told.effort or min(effort for motion, start, _ in spans for effort in _efforts(motion, start))
    strokes = [_strokes(span) for span in spans]
    velocities = [motion.kinematics.moving[name].velocity for motion, _, _ in spans for name in motion.closing]
    longest = max(max(stroke) for stroke in strokes)
    speed = told.speed or min([longest / STROKE_TIME or 1.0, *(v for v in velocities if v is not None)])
    time = told.time or round(max(sum(stroke) for stroke in strokes) / speed + MARGIN, 3)
    return ClosingConfig(effort, speed, time)


def drives_of(config: HandConfig, motion: Motion, closing: ClosingConfig) -> dict[str, Drive]:
    """The drive of every joint that closes or follows. Raises InputError for a joint that cannot press as it shall."""
    assert closing.effort is not None
    drives = {}
    for name, share in motion.closing.items():
        told, joint = config.joints.get(name, JointConfig()), motion.kinematics.moving[name]
        push = abs(share) * closing.effort
        rated = joint.effort if config.closing.effort or (joint.effort or 0.0) >= push else None  # else a placeholder
        most = told.effort or rated or push / SHARE
        if most < push:
            raise InputError(f"hand.closing.effort: expected at most {most:g}, the effort of {name}; got {push:g}")
        drives[name] = _drive(told, most, push / (LEAD * (closing.speed or 1.0)), abs(share))
    for name, rule in motion.follow.items():
        told, joint = config.joints.get(name, JointConfig()), motion.kinematics.moving[name]
        most = told.effort or max(joint.effort or 0.0, LINKAGE * closing.effort / max(abs(rule.ratio), 0.1))
        drives[name] = _drive(told, most, most / (LEAD * _speed(rule, closing)), 1.0)
    return drives


def _drive(told: JointConfig, effort: float, stiffness: float, share: float) -> Drive:
    """With the damping by the share: weak fingers would close slowly, and a strong one would arrive first."""
    stiffness = stiffness if told.stiffness is None else told.stiffness
    damping = RELAX * stiffness if told.damping is None else share * told.damping
    return Drive(stiffness, damping, effort)


def _speed(rule: Follow, closing: ClosingConfig) -> float:
    return max(abs(rule.ratio), 0.1) * (closing.speed or 1.0)


def _strokes(span: Span) -> list[float]:
    """rad or m, the longest way of a joint in each phase."""
    motion, start, end = span
    return [max(abs(end[name] - start[name]) for name in phase) for phase in motion.phases]


def _efforts(motion: Motion, start: Mapping[str, float]) -> list[float]:
    """Nm or N that each joint that closes may press with at a share of 1."""
    first = {name: start[name] for name in motion.closing}
    before = motion.kinematics.links(start)
    found = []
    for name, share in motion.closing.items():
        step = 0.01 * (motion.end(name, closed=True) - motion.end(name, closed=False))
        after = motion.kinematics.links(motion.joints({**first, name: first[name] + step}))
        levers = [
            np.linalg.norm(shape.points_at(after) - shape.points_at(before), axis=1).max() / abs(step)
            for shape in motion.shapes.values()
        ]
        effort = motion.kinematics.moving[name].effort
        most, least = (force * float(max(levers)) for force in (PAD_FORCE, PLACEHOLDER))
        found.append((min(most, SHARE * effort) if effort and effort > least else most) / abs(share))
    return [effort for effort in found if effort > 0] or [1.0]
