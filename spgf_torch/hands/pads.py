"""Where the fingers of a preshape meet: pads, the opening between them, the joints for an opening, and the TCP."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig, PreshapeConfig
from spgf_torch.hands.fingers import closing_face, projected
from spgf_torch.hands.motion import Motion, Passed

FARTHEST = 1.0  # m from a hand's base to its TCP; more is millimetres
TOUCHING = 1e-9  # m between pads that count as one point; what is left of an opening of 0 is rounding


@dataclass(frozen=True)
class Pads:
    """The points of a preshape's fingers that close on things.

    Attributes:
        links: finger -> the link that carries its pad. points: finger -> (3,) in that link's frame, m.
    """

    motion: Motion
    links: dict[str, str]
    points: dict[str, np.ndarray]

    def at(self, links: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Finger -> (3,) in the base frame, of link poses."""
        found = {}
        for finger, point in self.points.items():
            T = links[self.links[finger]]
            found[finger] = T[:3, :3] @ point + T[:3, 3]
        return found

    def sides(self, links: Mapping[str, np.ndarray]) -> np.ndarray:
        """(groups, 3): the middle of the pads of each opposing group, in the base frame."""
        pads = self.at(links)
        return np.stack([np.mean([pads[finger] for finger in group], axis=0) for group in self.motion.groups])

    def passed(self, joints: Mapping[str, float]) -> Passed:
        """Whether two opposing sides have come to the same place along their closing direction in the open hand."""
        first = self.sides(self.motion.kinematics.links(joints))
        towards = first[1] - first[0]

        def beside(links: Mapping[str, np.ndarray]) -> bool:
            sides = self.sides(links)
            return len(sides) == 2 and float((sides[1] - sides[0]) @ towards) <= 0

        return beside

    # Two opposing groups whose joints all close together, by one number: the first joint's value.

    @cached_property
    def limits(self) -> tuple[float, float]:
        """rad or m of the first joint that closes."""
        first = next(iter(self.motion.closing))
        low, high = sorted((self.motion.end(first, closed=False), self.motion.end(first, closed=True)))
        return low, high

    def joints(self, value: float) -> dict[str, float]:
        """All joint values with the first closing joint at `value`, the others as far on the way to their limits."""
        motion = self.motion
        first = next(iter(motion.closing))
        a, b = motion.end(first, closed=False), motion.end(first, closed=True)
        values = {}
        for name in motion.closing:
            c, d = motion.end(name, closed=False), motion.end(name, closed=True)
            ratio = (d - c) / (b - a)
            values[name] = ratio * value + (c - ratio * a)  # exactly `value` where the limits are the same
        return motion.joints(values)

    @cached_property
    def axis(self) -> np.ndarray:
        """(3,) unit in the base frame: from the first side to the second, where they are widest apart."""
        gaps = [np.diff(self._two(value), axis=0)[0] for value in self.limits]
        widest = max(gaps, key=lambda gap: float(np.linalg.norm(gap)))
        length = float(np.linalg.norm(widest))
        if length < TOUCHING:
            raise InputError(f"{self.motion.where}: expected pads that move apart, got pads at one point")
        return np.asarray(widest / length)

    def opening(self, value: float) -> float:
        """m between the two sides along the closing axis; negative once they have passed each other."""
        first, second = self._two(value)
        return float((second - first) @ self.axis)

    def solve(self, opening: float) -> dict[str, float]:
        """All joint values with the two sides `opening` (m) apart. Raises InputError where it is out of reach."""
        from scipy.optimize import brentq  # half a second to import

        low, high = sorted(self.opening(value) for value in self.limits)
        if not low <= opening <= high:
            at = f"{self.motion.where}.opening"
            raise InputError(f"{at}: expected {max(low, 0):.3f} to {high:.3f} m, got {opening}")
        difference: Callable[[float], float] = lambda value: self.opening(value) - opening  # noqa: E731
        return self.joints(float(brentq(difference, *self.limits, xtol=1e-12)))

    def closed(self) -> dict[str, float]:
        """The same with the pads meeting, or as near as the limits let them."""
        return self.solve(max(min(self.opening(limit) for limit in self.limits), 0.0))

    def _two(self, value: float) -> np.ndarray:
        return self.sides(self.motion.kinematics.links(self.joints(value)))

    def tcp(self, preshape: PreshapeConfig, approach: np.ndarray, links: Mapping[str, np.ndarray]) -> np.ndarray:
        """T_base_tcp (4, 4) of the open hand: as told, else midway between the sides; z the approach, x closing."""
        sides, told = self.sides(links), preshape.tcp
        where = f"{self.motion.where}.tcp"
        x = sides[1:].mean(axis=0) - sides[0]
        if told is not None and told.closing:
            x = _vector(told.closing, f"{where}.closing")
        elif np.linalg.norm(x) < TOUCHING:
            x = self.axis  # pads that touch define no direction; this is the one they came from
        origin = (sides[0] + sides[1]) / 2 if len(sides) == 2 else sides.mean(axis=0)
        if told is not None and told.xyz:
            origin = _vector(told.xyz, f"{where}.xyz")
            if np.abs(origin).max() > FARTHEST:
                raise InputError(f"{where}.xyz: expected metres within {FARTHEST:g} of the base, got {told.xyz}")
        x = x - (x @ approach) * approach
        if np.linalg.norm(x) < TOUCHING:
            raise InputError(f"{where}.closing: expected a direction across the approach {approach}, got along it")
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3] = np.column_stack([x, np.cross(approach, x), approach, origin])
        return T


def pads_of(motion: Motion, config: HandConfig, preshape: PreshapeConfig) -> Pads:
    """The pads that the settings give, in the frame of each finger's first link; those they do not give, measured."""
    fingers = [finger for group in motion.groups for finger in group]
    carriers = {finger: config.fingers[finger][0] for finger in fingers}
    if unknown := set(preshape.pads) - set(fingers):
        raise InputError(f"{motion.where}.pads: expected fingers that oppose, got {min(unknown)}")
    points = {f: _vector(point, f"{motion.where}.pads.{f}") for f, point in preshape.pads.items()}
    missing = [finger for finger in fingers if finger not in points]
    if missing and preshape.tcp is not None and preshape.tcp.xyz:
        links, at = motion.kinematics.links(motion.joints(motion.open())), _vector(preshape.tcp.xyz, "hand.tcp.xyz")
        found = {finger: _nearest(motion, finger, carriers[finger], links, at) for finger in missing}
    elif missing:
        start = motion.open() if preshape.open else {n: motion.end(n, closed=False) for n in motion.closing}
        links = motion.kinematics.links(motion.meeting(start))
        found = {finger: _face(motion, finger, links) for finger in missing}
        if len(missing) == len(fingers) == len(motion.groups) == 2:  # a jaw: one point for both, where they meet
            middle = np.mean(list(found.values()), axis=0)
            found = {finger: projected(middle, motion.shapes[finger], links) for finger in missing}
    for finger in missing:
        T = links[carriers[finger]]
        points[finger] = T[:3, :3].T @ (found[finger] - T[:3, 3])
    return Pads(motion, carriers, {finger: points[finger] for finger in fingers})


def _face(motion: Motion, finger: str, links: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3,) in the base frame: the middle of the finger's face that meets the opposing groups."""
    others = [f for group in motion.groups if finger not in group for f in group]
    return closing_face(motion.shapes[finger], [motion.shapes[other] for other in others], links)


def _nearest(motion: Motion, finger: str, carrier: str, links: Mapping[str, np.ndarray], at: np.ndarray) -> np.ndarray:
    """(3,) in the base frame: the point of the finger's first link, the tip, that is nearest to the TCP."""
    body_of, shape = motion.kinematics.robot.bodies(), motion.shapes[finger]
    on_tip = [link for link in shape.points if body_of[link] == body_of[carrier]] or list(shape.points)
    points = np.concatenate([shape.points[link] @ links[link][:3, :3].T + links[link][:3, 3] for link in on_tip])
    return np.asarray(points[np.linalg.norm(points - at, axis=1).argmin()])


def _vector(values: object, where: str) -> np.ndarray:
    """(3,) float64. Raises InputError for anything but three finite numbers."""
    try:
        vector = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{where}: expected three numbers, got {values!r:.60}")
    return vector
