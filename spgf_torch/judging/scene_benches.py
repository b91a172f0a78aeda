"""Tables full of things that a judge learns in: scenes of objects of one fold, seen from one side and from several.

World frame: the table is z = 0, z up; m. Everything above the table is one target, as in `spgf_torch.clutter`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import fcl
import numpy as np
import torch
from torch import Tensor

from spgf_torch.clearing.cameras import cameras_of, depth_images, scene_config, seen
from spgf_torch.errors import InputError
from spgf_torch.geometry import se3
from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.hands.hand import Hand
from spgf_torch.judging.config import ContextConfig, JudgeConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.predictor import Predictor
from spgf_torch.proposing.bodies import bodies_of
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.proposing.judge_features import Seen, judge_features
from spgf_torch.proposing.judge_proposer import candidates
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.simulation.arrangements import Placed, arranged
from spgf_torch.simulation.clutter_config import PACKED, PILE
from spgf_torch.simulation.precheck import hull

KINDS = (PACKED, PILE)
# Streams of random numbers of a scene, beside that of its arrangement.
_CAMERAS, _NOISE, _TEXLETS = 11, 12, 13


@dataclass(frozen=True)
class SceneKey:
    """Which scene: its seed, its kind, one of `KINDS`, and the fold that its objects are of."""

    seed: int
    kind: str
    fold: int


@dataclass(frozen=True)
class SceneCloud:
    """A scene as some cameras see it.

    Attributes:
        hypotheses: (H) that a judge weighs there. numbers: (H, 31) f32, `judge_features.NAMES` of each.
    """

    seen: Seen
    hypotheses: Hypotheses
    numbers: Tensor


@dataclass(frozen=True)
class SceneBench:
    """A scene with its clouds, one for each entry of `ContextConfig.views`; None: nothing is seen there."""

    key: SceneKey
    placed: tuple[Placed, ...]
    clouds: tuple[SceneCloud | None, ...]
    check: SceneCheck

    @staticmethod
    def of(
        key: SceneKey, pool: Sequence[GraspObject], predictor: Predictor, hand: Hand, config: JudgeConfig
    ) -> SceneBench:
        """The scene of objects of the pool; `predictor`: of a judge of the hand, whose search it is.

        Azimuth and elevation of the cameras are drawn for each cloud.
        """
        scenes = _scenes(config)
        placed = arranged(pool, scenes.count, key.seed, getattr(scenes, key.kind))
        rng = np.random.default_rng([key.seed, _CAMERAS])
        clouds = []
        for number, views in enumerate(scenes.views):
            azimuth, elevation = rng.uniform(0, 360), rng.uniform(config.lowest_deg, config.highest_deg)
            sensing = replace(config.sensing, azimuth_deg=azimuth, elevation_deg=elevation)
            clouds.append(_cloud(placed, views, [key.seed, number], predictor, sensing))
        return SceneBench(key, placed, tuple(clouds), SceneCheck(placed, hand, predictor.retreat))


class SceneCheck:
    """Whether an open hand, or what it sweeps on its way to a grasp, cuts anything of a scene, by the true meshes."""

    def __init__(self, placed: Sequence[Placed], hand: Hand, way: float) -> None:
        """`way`: m that the hand comes along its approach."""
        pieces, back = [], [0.0, 0.0, way]
        for each in placed:
            R, t = each.T_world_object[:3, :3], each.T_world_object[:3, 3]
            pieces += [hull(part @ R.T + t) for part in each.obj.parts]
        self._things = fcl.CollisionObject(triangle_tree(pieces)) if pieces else None
        self._hands = []
        for name in sorted(hand.preshapes):
            swept = [hull(np.concatenate([s.vertices, s.vertices - back])) for s in hand.preshapes[name].shapes]
            self._hands.append(fcl.CollisionObject(triangle_tree(swept)))

    def free(self, hypotheses: Hypotheses) -> Tensor:
        """(H,) bool: the hand cuts nothing on its way."""
        free = torch.ones(len(hypotheses), dtype=torch.bool)
        if self._things is None:
            return free
        request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)
        rotations = se3.rotation_of(hypotheses.T).double().contiguous().numpy()
        positions = se3.position_of(hypotheses.T).double().contiguous().numpy()
        for k, code in enumerate(hypotheses.grasp_type.tolist()):
            hand = self._hands[code]
            hand.setTransform(fcl.Transform(rotations[k], positions[k]))
            free[k] = not fcl.collide(hand, self._things, request, fcl.CollisionResult())
        return free


def _cloud(
    placed: Sequence[Placed], views: int, stream: Sequence[int], predictor: Predictor, sensing: SensingConfig
) -> SceneCloud | None:
    rng = np.random.default_rng([*stream, _NOISE])
    images = depth_images(placed, cameras_of(sensing, views), sensing, rng)
    try:
        scene = seen(images, scene_config(False), sensing, [*stream, _TEXLETS])
    except InputError:  # nothing above the table
        return None
    if scene.no_grasp is not None:
        return None
    target = scene.of(scene.targets[0])
    neighbours = predictor.config.neighbours
    assert predictor.judged is not None and neighbours is not None  # it is a judge's, for many things
    its = Seen(target.texlets, target.views or (), bodies_of(target.texlets, neighbours))
    around = predictor.surroundings(target)
    hypotheses = candidates(predictor.judged.search, predictor.config, its, around)
    return SceneCloud(its, hypotheses, judge_features(its, hypotheses, predictor.judged.search))


def _scenes(config: JudgeConfig) -> ContextConfig:
    assert config.context is not None  # who asks for scenes has settings for them
    return config.context
