"""Which fingers oppose which, with which of their joints standing where, and how far the hand opens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from spgf_torch.handcheck.anatomy import SAME_WAY, Anatomy, Finger, unit

CLEAR = 0.3  # of a finger's motion that is towards the others, from which on that settles its sign
REACH = 0.6  # of a finger's longest reach ahead of the palm that it keeps while it opens: SDH-2's -60/+30 deg does
STEPS = 49  # of a joint's range that are looked at
MOST_HELD = 4  # joints that spread or turn one finger, of which three values each are tried


@dataclass(frozen=True)
class Grouping:
    """Fingers that move, with the directions that they close in.

    Attributes:
        held: joint -> rad or m, where spread and abduction joints stand.
        signs: joint that closes -> the direction of it.
    """

    anatomy: Anatomy
    held: dict[str, float]
    signs: dict[str, float]

    def closing(self, finger: Finger) -> np.ndarray:
        """(3,) unit across the approach: where a finger's end goes when it closes."""
        moved = sum(
            (self.signs[joint] * self.anatomy.velocity(finger, joint, 0.5, self.held) for joint in finger.closers),
            np.zeros(3),
        )
        return unit(self.anatomy.across(moved))

    @cached_property
    def groups(self) -> list[list[Finger]]:
        """Fingers that go the same way, together; three that go three ways are three groups."""
        found: list[list[Finger]] = []
        for finger in self.anatomy.fingers:
            way = self.closing(finger)
            near = [group for group in found if float(self.closing(group[0]) @ way) > SAME_WAY]
            if near:
                near[0].append(finger)
            else:
                found.append([finger])
        return found

    @property
    def opposed(self) -> float:
        """How well the groups oppose each other: 1 where their directions cancel, 0 where all go the same way."""
        ways = [np.mean([self.closing(finger) for finger in group], axis=0) for group in self.groups]
        return 1.0 - float(np.linalg.norm(np.mean(ways, axis=0))) if len(ways) > 1 else 0.0

    def open_at(self, share: float) -> dict[str, float]:
        """Closers of all fingers at a share (0 to 1) of what each opens to; joints beyond the first are straight."""
        values: dict[str, float] = {}
        for finger in self.anatomy.fingers:
            straight = {name: _nearest(0.0, self.anatomy.span(name)) for name in finger.closers[1:]}
            values |= {finger.closers[0]: self._opened(finger, straight, share), **straight}
        return values

    def _opened(self, finger: Finger, straight: dict[str, float], share: float) -> float:
        """The first closer at a share of the way out that keeps `REACH`, from where the finger reaches farthest."""
        anatomy, first = self.anatomy, finger.closers[0]
        base = next(joint for joint in finger.chain if joint.name in finger.flexors)
        low, high = anatomy.span(first)
        values = np.linspace(low, high, STEPS)
        inwards, reach, out = self.closing(finger), [], []
        for value in values:
            links = anatomy.at(0.5, {**self.held, **straight, first: value})
            tip = anatomy.placed(finger.name, links).mean(axis=0) - links[base.child][:3, 3]
            reach.append(float(tip @ anatomy.approach))
            out.append(-float(tip @ inwards))
        farthest = int(np.argmax(reach))
        kept = np.array(reach) >= REACH * max(reach)
        widest = int(np.argmax(np.where(kept, out, -np.inf)))
        return float(values[farthest] + share * (values[widest] - values[farthest]))


def grouping_of(anatomy: Anatomy) -> Grouping:
    """The signs of all closers; spread joints at rest, or where the fingers oppose each other best."""
    rest = anatomy.kinematics.at_rest()
    held = {name: rest[name] for finger in anatomy.fingers for name in finger.held}
    best = Grouping(anatomy, held, _signs(anatomy, held))
    if best.opposed > 0.5 or len(anatomy.fingers) < 2:
        return best
    for finger in anatomy.fingers:
        if not 0 < len(finger.held) <= MOST_HELD:
            continue
        ends = [anatomy.span(name) for name in finger.held]
        for values in product(*[(low, (low + high) / 2, high) for low, high in ends]):
            other = {**held, **dict(zip(finger.held, values, strict=True))}
            tried = Grouping(anatomy, other, _signs(anatomy, other))
            if tried.opposed > best.opposed + 0.05:
                best = tried
    return best


def _signs(anatomy: Anatomy, held: dict[str, float]) -> dict[str, float]:
    """Joint -> +1 or -1, such that each finger, all its joints curling one way, comes nearer to the others.

    Where that is not clear, as of fingers beside each other, a finger curls to the longer side of its joints' ranges.
    """
    if len(anatomy.fingers) == 1:
        (finger,) = anatomy.fingers
        end = 2 * anatomy.closed_share - 1
        return {joint: end * (anatomy.curl(finger, joint) or 1.0) for joint in finger.closers}
    middles = _middles(anatomy, held)
    votes: dict[str, float] = {}
    for finger in anatomy.fingers:
        others = [middles[other.name] for other in anatomy.fingers if other is not finger]
        inwards = unit(anatomy.across(np.mean(others, axis=0) - middles[finger.name]))
        curls = {joint: anatomy.curl(finger, joint) for joint in finger.closers}
        moved = sum((sign * anatomy.velocity(finger, j, 0.5, held) for j, sign in curls.items()), np.zeros(3))
        towards = float(unit(anatomy.across(moved)) @ inwards)
        spans = {joint: anatomy.span(joint) for joint in finger.closers}
        longer = sum(curls[joint] * (low + high) / (high - low) for joint, (low, high) in spans.items())
        clear = abs(towards) > CLEAR or abs(longer) < CLEAR
        for joint, sign in curls.items():
            votes[joint] = votes.get(joint, 0.0) + sign * (towards if clear else CLEAR * np.sign(longer))
    return {joint: 1.0 if vote >= 0 else -1.0 for joint, vote in votes.items()}


def _middles(anatomy: Anatomy, held: dict[str, float]) -> dict[str, np.ndarray]:
    links = anatomy.at(0.5, held)
    return {finger.name: anatomy.placed(finger.name, links).mean(axis=0) for finger in anatomy.fingers}


def _nearest(value: float, span: tuple[float, float]) -> float:
    return min(max(value, span[0]), span[1])
