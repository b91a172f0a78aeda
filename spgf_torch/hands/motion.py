"""How one preshape closes, from its settings, its URDF, or measured: joints that stand still, close, and follow."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig, PreshapeConfig
from spgf_torch.hands.fingers import FingerShape, separation
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.hands.robot import Follow, Joint

TURN = 360.0  # deg that a joint may be told to stand at
STEPS = 60  # of a closing that is looked at without physics: a degree and a half of a finger that turns by 90

# Link poses (4, 4) in the base frame -> whether opposing fingers are beside each other.
Passed = Callable[[Mapping[str, np.ndarray]], bool]


@dataclass(frozen=True)
class Motion:
    """What moves in one preshape, and how.

    Attributes:
        where: `hand.preshapes.NAME`, for what is wrong.
        held: joint -> rad or m. given: joint -> rad or m of the open hand, as far as the settings say.
        phases: joint -> direction times share. follow: joints that follow others.
        groups: opposing groups of names of fingers. shapes: finger -> its surface.
    """

    where: str
    kinematics: Kinematics
    held: dict[str, float]
    given: dict[str, float]
    phases: tuple[dict[str, float], ...]
    follow: dict[str, Follow]
    groups: tuple[tuple[str, ...], ...]
    shapes: dict[str, FingerShape]

    @cached_property
    def closing(self) -> dict[str, float]:
        """Every joint that closes, in any phase -> direction times share."""
        return {name: share for phase in self.phases for name, share in phase.items()}

    @cached_property
    def shape_groups(self) -> list[list[FingerShape]]:
        return [[self.shapes[finger] for finger in group] for group in self.groups]

    def end(self, name: str, closed: bool) -> float:
        """The limit, rad or m, that a joint closes towards, or comes from; of a continuous joint half a turn on."""
        joint, direction = self.kinematics.moving[name], math.copysign(1.0, self.closing[name])
        limit = joint.upper if (direction > 0) == closed else joint.lower
        if math.isfinite(limit):
            return limit
        return self.given.get(name, 0.0) + (math.pi if closed else 0.0) * direction

    def joints(self, values: Mapping[str, float]) -> dict[str, float]:
        """All joint values with these of the joints that close."""
        return self.kinematics.complete({**self.held, **values}, self.follow)

    def open(self) -> dict[str, float]:
        """The joints that close, at the values that are given, others at the limits that they come from."""
        return {name: self.given.get(name, self.end(name, closed=False)) for name in self.closing}

    def path(self, start: Mapping[str, float]) -> list[dict[str, float]]:
        """All joint values on the way of closing without an object: phase by phase, to the limits."""
        now, found = dict(start), [self.joints(start)]
        for phase in self.phases:
            first = {name: now[name] for name in phase}
            for step in range(1, STEPS + 1):
                share = step / STEPS
                now |= {name: first[name] + share * (self.end(name, closed=True) - first[name]) for name in phase}
                found.append(self.joints(now))
        return found

    def meeting(self, start: Mapping[str, float], passed: Passed = lambda links: False) -> dict[str, float]:
        """All joint values where two opposing groups first touch, or have `passed`, or are nearest to each other."""
        path = self.path(start)
        apart = []
        for joints in path:
            links = self.kinematics.links(joints)
            if not self.hinged:
                apart.append(separation(self.shape_groups, links))
                if apart[-1] <= 0:
                    return self._touching(path[len(apart) - 2], joints) if len(apart) > 1 else joints
            if passed(links):
                return joints
        return path[-1] if self.hinged else path[int(np.argmin(apart))]

    @cached_property
    def hinged(self) -> bool:
        """Whether a joint joins opposing groups, as a single jaw and the palm, whose shapes are then never apart."""
        robot = self.kinematics.robot
        body_of = robot.bodies()
        side: dict[str, int] = {}
        for index, shapes in enumerate(self.shape_groups):
            side |= {body_of[link]: index for shape in shapes for link in shape.points}
        pairs = [(body_of[joint.parent], body_of[joint.child]) for joint in robot.joints if joint.moves]
        return any(a in side and b in side and side[a] != side[b] for a, b in pairs)

    def _touching(self, before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, float]:
        """Between two joint values, the last that is free, to a thousandth of the way."""
        low, high = 0.0, 1.0
        for _ in range(10):
            middle = (low + high) / 2
            joints = {name: before[name] + middle * (after[name] - before[name]) for name in after}
            free = separation(self.shape_groups, self.kinematics.links(joints)) > 0
            low, high = (middle, high) if free else (low, middle)
        return {name: before[name] + low * (after[name] - before[name]) for name in after}


def motion_of(kinematics: Kinematics, config: HandConfig, name: str, shapes: dict[str, FingerShape]) -> Motion:
    """The motion of the preshape `name` of a hand whose fingers have these shapes.

    Raises InputError for names that are not there, and values out of reach.
    """
    where, preshape = f"hand.preshapes.{name}", config.preshapes[name]
    groups = _groups(where, preshape, tuple(config.fingers))
    held = _values(f"{where}.hold", preshape.hold, kinematics)
    given = _values(f"{where}.open", preshape.open, kinematics)
    for key in ("hold", "open"):
        check_known(f"{where}.{key}", getattr(preshape, key), kinematics.moving, "a joint that moves")
    phases = _phases(where, preshape, kinematics)
    named = {joint for phase in phases for joint in phase}
    if both := named & held.keys():
        raise InputError(f"{where}.close: expected joints that do not stand in hold, got {min(both)}")
    mimics = {j.name: j.mimic for j in kinematics.moving.values() if j.mimic and j.name not in named | held.keys()}
    follow = {**mimics, **_parallel(where, preshape, kinematics, given)}
    if both := named & follow.keys():
        raise InputError(f"{where}.parallel: expected joints that do not stand in close, got {min(both)}")
    motion = Motion(where, kinematics, held, given, phases, follow, groups, shapes)
    if not phases:
        motion = _measured(motion, config)
    still = {n: v for n, v in kinematics.at_rest().items() if n not in motion.closing and n not in follow}
    return Motion(where, kinematics, {**still, **held}, given, motion.phases, follow, groups, shapes)


def _groups(where: str, preshape: PreshapeConfig, fingers: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Opposing groups of fingers; without any settings each finger is one."""
    if len(fingers) < 2:
        raise InputError(f"hand.fingers: expected two or more, got {len(fingers)}; a palm may be one")
    if not preshape.oppose:
        return tuple((finger,) for finger in fingers)
    groups = tuple((group,) if isinstance(group, str) else tuple(group) for group in preshape.oppose)
    named = [finger for group in groups for finger in group]
    check_known(f"{where}.oppose", named, fingers, "a finger")
    if len(groups) < 2 or len(named) != len(set(named)) or not all(groups):
        raise InputError(f"{where}.oppose: expected two or more groups of different fingers, got {preshape.oppose}")
    if preshape.touch is not None and preshape.touch > len(groups):
        raise InputError(f"{where}.touch: expected a number of groups up to {len(groups)}, got {preshape.touch}")
    return groups


def _phases(where: str, preshape: PreshapeConfig, kinematics: Kinematics) -> tuple[dict[str, float], ...]:
    """Mappings of joints to direction times share, one a phase."""
    if preshape.close and preshape.phases:
        raise InputError(f"{where}: expected close or phases, got both")
    phases = [preshape.close] if preshape.close else preshape.phases
    for phase in phases:
        if not isinstance(phase, dict) or not phase:
            raise InputError(f"{where}.phases: expected joints and their shares, got {phase!r:.40}")
        check_known(f"{where}.close", phase, kinematics.moving, "a joint that moves")
        for joint, share in phase.items():
            if not isinstance(share, int | float) or not 0 < abs(share) <= 1:
                raise InputError(f"{where}.close.{joint}: expected a share from -1 to 1, not 0, got {share!r:.40}")
    return tuple({joint: float(share) for joint, share in phase.items()} for phase in phases)


def _parallel(
    where: str, preshape: PreshapeConfig, kinematics: Kinematics, given: Mapping[str, float]
) -> dict[str, Follow]:
    """Rules of joints that turn against others such that what they carry keeps its direction."""
    rules: dict[str, Follow] = {}
    check_known(f"{where}.parallel", preshape.parallel, kinematics.moving, "a joint that moves")
    for name, rule in preshape.parallel.items():
        told: dict[str, Any] = rule if isinstance(rule, dict) else {"of": rule}
        if unknown := set(told) - {"of", "ratio", "offset"}:
            raise InputError(f"{where}.parallel.{name}: expected of, ratio and offset, got {min(unknown)}")
        check_known(f"{where}.parallel.{name}", [told.get("of")], kinematics.moving, "a joint that moves")
        of = str(told["of"])
        if of == name:
            raise InputError(f"{where}.parallel.{name}: expected another joint that it follows, got itself")
        ratio = float(told.get("ratio", -_same_way(kinematics, name, of)))
        offset = _radians(kinematics.moving[name], float(told.get("offset", 0.0)))
        if name in given and of in given and "offset" not in told:
            offset = given[name] - ratio * given[of]
        rules[name] = Follow(of, ratio, offset)
    return rules


def _same_way(kinematics: Kinematics, name: str, other: str) -> float:
    """1 where two joints' axes point the same way, with all joints at rest, else -1."""
    links = kinematics.links(kinematics.complete({}, {}))
    joints = [kinematics.moving[joint] for joint in (name, other)]
    a, b = (links[joint.child][:3, :3] @ joint.axis for joint in joints)
    return 1.0 if float(a @ b) >= 0 else -1.0


def _measured(motion: Motion, config: HandConfig) -> Motion:
    """Directions such that opposing groups come nearer: of every joint on the way to a finger that follows no other."""
    moving, parent = motion.kinematics.moving, {joint.child: joint for joint in motion.kinematics.robot.joints}
    chain: set[str] = set()
    for group in motion.groups:
        for link in (link for finger in group for link in config.fingers[finger]):
            while link in parent:
                chain.add(parent[link].name)
                link = parent[link].parent
    followed = {rule.of for rule in motion.follow.values()}
    closes = [n for n in moving if n in chain | followed and n not in motion.held and n not in motion.follow]
    if not closes:
        raise InputError(f"{motion.where}.close: expected joints that move the fingers, found none")
    low = {n: moving[n].lower if math.isfinite(moving[n].lower) else -math.pi / 2 for n in closes}
    high = {n: moving[n].upper if math.isfinite(moving[n].upper) else math.pi / 2 for n in closes}
    middle = {name: (low[name] + high[name]) / 2 for name in closes}
    directions = {}
    for name in closes:
        ends = [motion.joints({**middle, name: value}) for value in (low[name], high[name])]
        apart = [_spread(motion, motion.kinematics.links(joints)) for joints in ends]
        directions[name] = 1.0 if apart[1] < apart[0] else -1.0
    return Motion(
        motion.where,
        motion.kinematics,
        motion.held,
        motion.given,
        (directions,),
        motion.follow,
        motion.groups,
        motion.shapes,
    )


def _spread(motion: Motion, links: Mapping[str, np.ndarray]) -> float:
    """m between opposing groups: of their nearest points, and a little of their middles, where they overlap."""
    middles = [np.mean([s.points_at(links).mean(axis=0) for s in group], axis=0) for group in motion.shape_groups]
    apart = [np.linalg.norm(a - b) for i, a in enumerate(middles) for b in middles[:i]]
    return max(separation(motion.shape_groups, links), 0.0) + float(np.sum(apart)) / 10


def _values(where: str, told: Mapping[str, float], kinematics: Kinematics) -> dict[str, float]:
    """Joint values in rad or m, checked against the URDF's limits (to a thousandth of a radian)."""
    check_known(where, told, kinematics.moving, "a joint that moves")
    values = {}
    for name, value in told.items():
        joint = kinematics.moving[name]
        if joint.kind != "prismatic" and not abs(value) <= TURN:
            raise InputError(f"{where}.{name}: expected degrees from -{TURN:g} to {TURN:g}, got {value:g}")
        values[name] = _radians(joint, value)
        if not joint.lower - 1e-3 <= values[name] <= joint.upper + 1e-3:
            low, high = (_told(joint, limit) for limit in (joint.lower, joint.upper))
            unit = "m" if joint.kind == "prismatic" else "deg"
            raise InputError(f"{where}.{name}: expected {low:.4g} to {high:.4g} {unit}, its limits; got {value:g}")
    return values


def _radians(joint: Joint, value: float) -> float:
    return value if joint.kind == "prismatic" else math.radians(value)


def _told(joint: Joint, value: float) -> float:
    return value if joint.kind == "prismatic" else math.degrees(value)


def check_known(where: str, names: Iterable[Any], known: Iterable[str], what: str) -> None:
    """InputError for the first name that is not known, with the nearest that is."""
    there = list(known)
    for name in names:
        if name not in there:
            near = difflib.get_close_matches(str(name), there, 1, 0.5)
            hint = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(there[:12])}"
            raise InputError(f"{where}: expected {what}, got {name}{hint}")
