"""Who plans a grasp in a scene: ours, random and antipodal grasps without learning, Contact-GraspNet.

All get the same images, and all but ours the same search: hands that are free of what is sensed, and of the table, and
that have something between their pads. Ours searches as its own settings say. Places where grasps failed are avoided
by all alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.sensed_collision import hand_volumes
from spgf_torch.clearing.config import ANTIPODAL, OURS, RANDOM, ClutterConfig
from spgf_torch.clearing.contact_graspnet import ContactGraspNet, Raw, Served, back_projected, in_cube
from spgf_torch.errors import InputError
from spgf_torch.hands.hand import Hand
from spgf_torch.predictor import Predictor, surroundings_of
from spgf_torch.proposing.antipodal import antipodal
from spgf_torch.proposing.bodies import bodies_of
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.proposing.judge_proposer import searched
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.views import View
from spgf_torch.sensing.sense import ABOVE
from spgf_torch.settings import plain

TRIES = 4000  # random hands; a hundred or so of them are free
TILT = math.radians(10)  # rad; standard deviation of their closing axis off a sensed normal
JITTER = 0.005  # m; standard deviation of their place along each axis
STROKE = "WPG"  # the grasp type of the Panda whose hand is open to its whole stroke, as the network's is


@dataclass(frozen=True)
class Sensed:
    """What was sensed: images, and the scene that they show. `seed`: of whatever a method draws there."""

    views: Sequence[View]
    scene: Scene
    seed: int


@dataclass(frozen=True)
class Chosen:
    """A planned grasp.

    Attributes:
        T_world_tcp: (4, 4) f64, the open hand. probability: that it holds; NaN of a method that foretells none.
        seconds: of the processor that were spent in another process.
    """

    grasp_type: str
    T_world_tcp: np.ndarray
    probability: float = math.nan
    seconds: float = 0.0


class Method(Protocol):
    """`avoid`: (A, 3) m, places near which grasps failed. None: it finds no grasp."""

    def choose(self, sensed: Sensed, avoid: np.ndarray) -> Chosen | None: ...


@dataclass(frozen=True)
class Ours:
    """What was learned plans, and tries no grasp that is less likely to hold than `least`."""

    predictor: Predictor
    least: float

    @staticmethod
    def of(folders: tuple[str, str], config: ClutterConfig) -> Ours:
        """Model and judge in these folders. Raises InputError for a model of another hand than `config.hand`."""
        model, judge = folders
        found = Predictor.load(model, "cpu", config.proposing, config.attempt.approach, judge)
        learned = found.model or found.judged.judge  # type: ignore[union-attr]
        if (its := learned.settings["hand"]) != plain(config.hand):
            other = " of other settings" if its["name"] == config.hand.name else ""
            raise InputError(f"model: expected one of hand={config.hand.name}, got one of {its['name']}{other}")
        return Ours(found, config.least_probability)

    def choose(self, sensed: Sensed, avoid: np.ndarray) -> Chosen | None:
        found = self.predictor.predict(sensed.scene, 1, avoid=avoid)
        best = next((grasp for grasp in found if grasp.probability >= self.least), None)
        return None if best is None else Chosen(best.type, best.T_input_tcp, best.probability)


@dataclass(frozen=True)
class Unlearned:
    """What the methods without a model share: the search, and what a hand must keep clear of."""

    search: Search
    config: ProposingConfig
    retreat: float

    @staticmethod
    def of(hand: Hand, config: ClutterConfig) -> Unlearned:
        proposing = config.proposing
        clearance = Clearance.of(hand_volumes(hand), proposing)
        search = Search.of(clearance, searched(config.hypotheses, proposing))
        return Unlearned(search, proposing, config.attempt.approach)

    def around(self, scene: Scene, avoid: np.ndarray) -> Surroundings:
        return surroundings_of(scene, self.config, self.retreat, torch.from_numpy(avoid).float())

    def free(self, hands: Hypotheses, scene: Scene, avoid: np.ndarray) -> Tensor:
        """(F,) int64, which hands are free of all that is sensed; away from where grasps failed, if any of them are."""
        around, positions = self.around(scene, avoid), scene.texlets.positions.float()
        free = self.search.free(hands.T, hands.grasp_type, positions, around)
        away = free & ~around.failed_at(hands.T[:, :3, 3])
        return (away if away.any() else free).nonzero()[:, 0]

    def chosen(self, hands: Hypotheses, index: int, **said: float) -> Chosen:
        grasp_type = self.search.clearance.grasp_types[int(hands.grasp_type[index])]
        return Chosen(grasp_type, hands.T[index].double().numpy(), **said)


@dataclass(frozen=True)
class Random:
    """The first free one of hands at random: their closing axis near a sensed normal, something between their pads."""

    tools: Unlearned

    def choose(self, sensed: Sensed, avoid: np.ndarray) -> Chosen | None:
        rng, positions = np.random.default_rng(sensed.seed), sensed.scene.texlets.positions.float()
        hands = random_hands(sensed.scene, [hand.region.half for hand in self.tools.search.hands], rng)
        hands = hands.at(self.tools.free(hands, sensed.scene, avoid))
        closes = self.tools.search.closes(hands.T, hands.grasp_type, positions).nonzero()[:, 0]
        return self.tools.chosen(hands, int(closes[0])) if len(closes) else None


@dataclass(frozen=True)
class Antipodal:
    """The best-scored of the hypotheses that a judge gets (`proposing.antipodal`)."""

    tools: Unlearned

    def choose(self, sensed: Sensed, avoid: np.ndarray) -> Chosen | None:
        tools, scene = self.tools, sensed.scene
        neighbours = tools.config.neighbours
        bodies = None if neighbours is None else bodies_of(scene.texlets, neighbours)
        seen = Seen(scene.texlets, scene.views or (), bodies)
        poses = antipodal(tools.search, tools.config, seen, tools.around(scene, avoid)).poses
        return tools.chosen(poses, 0) if len(poses) else None


@dataclass(frozen=True)
class Network:
    """The most confident of Contact-GraspNet's grasps that are free of all that is sensed, as ours must be."""

    tools: Unlearned
    served: Served

    def choose(self, sensed: Sensed, avoid: np.ndarray) -> Chosen | None:
        points = np.concatenate([back_projected(view.depth, view.camera) for view in sensed.views])
        near = in_cube(points, sensed.scene.texlets.positions.numpy())
        raw = Raw(points[near].astype(np.float32), points[near, 2] > ABOVE)
        its = self.served.grasps(raw, sensed.seed)
        code = self.tools.search.clearance.grasp_types.index(STROKE)
        hands = Hypotheses(its.T, torch.full((len(its.T),), code))
        free = self.tools.free(hands, sensed.scene, avoid).tolist()
        if not free:
            return None
        best = free[0]
        return self.tools.chosen(hands, best, probability=float(its.confidence[best]), seconds=its.seconds)


def random_hands(scene: Scene, half: Sequence[float], rng: np.random.Generator) -> Hypotheses:
    """`TRIES` hands at sensed points, of types that open to `half` (m) on either side of the TCP; none from below."""
    positions, normals = (part.double().numpy() for part in (scene.texlets.positions, scene.texlets.normals))
    at = rng.integers(len(positions), size=TRIES)
    x = _unit(normals[at] + TILT * rng.standard_normal((TRIES, 3)))
    z = rng.standard_normal((TRIES, 3))
    z = _unit(z - (z * x).sum(axis=1, keepdims=True) * x)
    z[z[:, 2] > 0] *= -1
    grasp_type = rng.integers(len(half), size=TRIES)
    depth = rng.uniform(0, 1, TRIES) * np.asarray(half)[grasp_type]
    T = np.tile(np.eye(4), (TRIES, 1, 1))
    T[:, :3, :3] = np.stack([x, np.cross(z, x), z], axis=2)
    T[:, :3, 3] = positions[at] - depth[:, None] * x + JITTER * rng.standard_normal((TRIES, 3))
    return Hypotheses(torch.from_numpy(T).float(), torch.from_numpy(grasp_type))


def method_of(config: ClutterConfig, hand: Hand, folders: tuple[str, str]) -> Method:
    """The method of the settings; `folders`: model and judge of ours. Raises InputError where it cannot plan."""
    if config.method == OURS:
        return Ours.of(folders, config)
    tools = Unlearned.of(hand, config)
    if config.method == RANDOM:
        return Random(tools)
    if config.method == ANTIPODAL:
        return Antipodal(tools)
    return Network(tools, ContactGraspNet.of(str(config.cgn)).serving())


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
