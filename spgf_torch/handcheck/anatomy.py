"""What a bare URDF tells of a hand: where its palm looks, which chains of links are fingers, and which joints close."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.hands.robot import Follow, Joint, Robot

SNAP = np.cos(np.radians(30))  # a direction nearer than this to an axis of the root is meant to be that axis
PARALLEL = np.cos(np.radians(30))  # axes of one finger's flexors are nearly parallel; spread and abduction are not
SHORT = 0.9  # of the reach of the fingers that a part of a linkage, such as a four-bar's inner knuckle, stays below
SAME_WAY = 0.5  # cosine between closing directions of fingers that press together, not against each other
NEAR_ROOT = 0.01  # m; a frame nearer to the root is the root's own under another name
STEP = 1e-3  # rad or m; of a derivative
SAMPLES = (0.25, 0.5, 0.75)  # of every joint's range, where directions are looked at


@dataclass(frozen=True)
class Finger:
    """A chain of links that ends freely.

    Attributes:
        name: its last body with shapes. bodies: from the tip on, those with shapes that its flexors move.
        chain: its moving joints, the nearest to the palm first. flexors: those of them that curl it.
        closers: joints that follow no other, and turn flexors. held: others, which spread or turn it.
    """

    name: str
    bodies: tuple[str, ...]
    chain: tuple[Joint, ...]
    flexors: tuple[str, ...]
    closers: tuple[str, ...]
    held: tuple[str, ...]


@dataclass(frozen=True)
class Anatomy:
    """A hand as far as its URDF tells. Directions and positions are in the frame of its root."""

    robot: Robot
    kinematics: Kinematics
    points: dict[str, np.ndarray] = field(repr=False)
    follow: dict[str, Follow]

    @staticmethod
    def of(robot: Robot) -> Anatomy:
        """The anatomy of a robot; `points` of each body are the corners of its shapes in its frame."""
        body_of = robot.bodies()
        kinematics = Kinematics(robot)
        rest = kinematics.links(kinematics.complete({}, {}))
        points: dict[str, list[np.ndarray]] = {}
        for piece in robot.collisions:
            body = body_of[piece.link]
            T = np.linalg.inv(rest[body]) @ rest[piece.link] @ piece.T_link_shape
            points.setdefault(body, []).append(piece.mesh.vertices @ T[:3, :3].T + T[:3, 3])
        joined = {body: np.concatenate(parts) for body, parts in points.items()}
        return Anatomy(robot, kinematics, joined, {j.name: j.mimic for j in robot.joints if j.moves and j.mimic})

    @cached_property
    def moving(self) -> dict[str, Joint]:
        return self.kinematics.moving

    def driver(self, name: str) -> str:
        """The joint that a joint follows in the end; itself where it follows none."""
        while name in self.follow:
            name = self.follow[name].of
        return name

    def span(self, name: str) -> tuple[float, float]:
        """Limits of a joint, rad or m; of a continuous one a quarter turn each way."""
        joint = self.moving[name]
        ends = (joint.lower, joint.upper)
        return ends if np.isfinite(ends).all() else (-np.pi / 2, np.pi / 2)

    def at(self, share: float, values: Mapping[str, float] | None = None) -> dict[str, np.ndarray]:
        """Link -> T_base_link with joints at a share of their range, but for `values`."""
        ends = {name: self.span(name) for name in self.moving if name not in self.follow}
        joints = {name: low + share * (high - low) for name, (low, high) in ends.items()}
        return self.kinematics.links(self.kinematics.complete({**joints, **(values or {})}, self.follow))

    def placed(self, body: str, links: Mapping[str, np.ndarray]) -> np.ndarray:
        """(P, 3) corners of a body's shapes."""
        T = links[body]
        return np.asarray(self.points[body] @ T[:3, :3].T + T[:3, 3])

    @property
    def palm(self) -> str:
        """The body of the root."""
        return self.robot.bodies()[self.robot.root]

    @cached_property
    def frame(self) -> np.ndarray | None:
        """(3,) the farthest frame without shapes that is fixed to the palm, as a tool or grasp frame; None if none."""
        body_of = self.robot.bodies()
        links = self.kinematics.links(self.kinematics.complete({}, self.follow))
        shaped = {piece.link for piece in self.robot.collisions}
        bare = [links[name][:3, 3] for name in self.robot.links if body_of[name] == self.palm and name not in shaped]
        farthest = max(bare, key=lambda at: float(np.linalg.norm(at)), default=np.zeros(3))
        return farthest if np.linalg.norm(farthest) > NEAR_ROOT else None

    @cached_property
    def closed_share(self) -> float:
        """Of a hand with one finger: 0 or 1, the end of its joint's range where its far half is nearest to the palm.

        Where a frame tells of a place to grasp at, nearest to that.
        """
        tip, chain = self._chains[0]
        gaps = []
        for share in (0.0, 1.0):
            links = self.at(share)
            points, other = self.placed(tip, links), self.frame
            away = np.linalg.norm(points - links[chain[-1].child][:3, 3], axis=1)
            others = self.placed(self.palm, links) if other is None else other[None]
            gaps.append(np.linalg.norm(points[away >= np.median(away)][:, None] - others[None], axis=2).min())
        return float(np.argmin(gaps))

    @cached_property
    def _chains(self) -> list[tuple[str, tuple[Joint, ...]]]:
        """Bodies with shapes that no moving joint leads on from, with the joints that lead there."""
        body_of = self.robot.bodies()
        above = {body_of[joint.child]: joint for joint in self.moving.values()}
        found: dict[str, tuple[Joint, ...]] = {}
        for body in above.keys() - {body_of[joint.parent] for joint in self.moving.values()}:
            tip = body
            chain: list[Joint] = []
            while tip not in self.points and tip in above:
                tip = body_of[above[tip].parent]
            at = tip
            while at in above:
                chain.insert(0, above[at])
                at = body_of[above[at].parent]
            if chain:
                found[tip] = tuple(chain)
        order = {joint.name: index for index, joint in enumerate(self.robot.joints)}
        return sorted(found.items(), key=lambda entry: order[entry[1][0].name])

    @cached_property
    def outwards(self) -> np.ndarray:
        """(3,) mean direction from the first joint of each chain to its end, over the range of the joints.

        A single finger closes on the palm: it looks to where a frame tells of a place to grasp at, or else out of the
        palm when it is closed.
        """
        poses = [self.at(share) for share in SAMPLES]
        if len(self._chains) == 1 and self.palm in self.points:
            if self.frame is not None:
                return unit(self.frame)
            poses = [self.at(self.closed_share)]
        ways = []
        for links in poses:
            for tip, chain in self._chains:
                way = self.placed(tip, links).mean(axis=0) - links[chain[0].child][:3, 3]
                ways.append(way / max(float(np.linalg.norm(way)), 1e-9))
        mean = np.mean(ways, axis=0)
        return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-9))

    @cached_property
    def approach(self) -> np.ndarray:
        """(3,) the axis of the root that `outwards` is near to; itself where it is near to none."""
        axis = np.zeros(3)
        index = int(np.argmax(np.abs(self.outwards)))
        axis[index] = np.sign(self.outwards[index])
        return axis if self.outwards @ axis > SNAP else np.round(self.outwards, 3)

    @cached_property
    def fingers(self) -> list[Finger]:
        """Chains but for parts of linkages."""
        links = self.at(0.5)
        reach = {tip: float((self.placed(tip, links) @ self.approach).max()) for tip, _ in self._chains}
        floor = min((links[chain[0].child][:3, 3] @ self.approach for _, chain in self._chains), default=0.0)
        found = []
        for tip, chain in self._chains:
            drivers = {self.driver(joint.name) for joint in chain}
            beside = [reach[t] for t, c in self._chains if drivers & {self.driver(joint.name) for joint in c}]
            dependent = all(joint.name in self.follow for joint in chain)
            if not (dependent and reach[tip] - floor < SHORT * (max(beside) - floor)):
                found.append(self._finger(tip, chain))
        return found

    def _finger(self, tip: str, chain: Sequence[Joint]) -> Finger:
        links = self.kinematics.links(self.kinematics.complete({}, self.follow))
        axes = {joint.name: links[joint.child][:3, :3] @ joint.axis for joint in chain}
        last = chain[-1]
        flexors = [
            joint
            for joint in chain
            if (joint.kind == "prismatic") == (last.kind == "prismatic")
            and abs(axes[joint.name] @ axes[last.name]) > PARALLEL
        ]
        closers = tuple(dict.fromkeys(self.driver(joint.name) for joint in flexors))
        held = tuple(dict.fromkeys(n for n in (self.driver(j.name) for j in chain) if n not in closers))
        body_of = self.robot.bodies()
        moved = chain[chain.index(flexors[0]) :]
        bodies = [body for joint in reversed(moved) if (body := body_of[joint.child]) in self.points]
        names = tuple(joint.name for joint in flexors)
        return Finger(tip, tuple(bodies), tuple(chain), names, closers, held)

    def curl(self, finger: Finger, joint: str) -> float:
        """1 where a joint turns a finger the same way as its first flexor with growing values, else -1; 0 of others."""
        links = self.kinematics.links(self.kinematics.complete({}, self.follow))
        parts = [j for j in finger.chain if j.name in finger.flexors]
        axes = [links[part.child][:3, :3] @ part.axis for part in parts]
        for part, axis in zip(parts, axes, strict=True):
            if self.driver(part.name) == joint:
                ratio = 1.0 if part.name == joint else self.follow[part.name].ratio
                return float(np.sign(axis @ axes[0] * ratio))
        return 0.0

    def velocity(self, finger: Finger, closer: str, share: float, values: Mapping[str, float]) -> np.ndarray:
        """(3,) m per rad or m that a finger's end moves with one joint, the others at a share of their ranges."""
        low, high = self.span(closer)
        at = values.get(closer, low + share * (high - low))
        ends = []
        for value in (at - STEP, at + STEP):
            ends.append(self.placed(finger.name, self.at(share, {**values, closer: value})).mean(axis=0))
        return np.asarray((ends[1] - ends[0]) / (2 * STEP))

    def across(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) without their part along the approach."""
        return np.asarray(vectors - (vectors @ self.approach)[..., None] * self.approach)


def unit(vector: np.ndarray) -> np.ndarray:
    """The direction of a vector (3,), or zeros."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else np.zeros(3)
