"""Tables full of things that a judge learns in: scenes of objects of one fold, seen from one side and from several.

World frame: the table is z = 0, z up; m. Everything above the table is one target, as in `spgf_torch.clutter`.
"""

from __future__ import annotations

import math
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
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.predictor import Predictor
from spgf_torch.proposing.clearance import Surroundings
from spgf_torch.proposing.context_features import context_features
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.proposing.judge_features import Seen, in_images, judge_features
from spgf_torch.simulation.arrangements import Placed, arranged
from spgf_torch.simulation.clutter_config import ArrangementConfig
from spgf_torch.simulation.precheck import hull

# Streams of random numbers of a scene, beside that of its arrangement.
_CAMERAS, _NOISE, _TEXLETS = 11, 12, 13


@dataclass(frozen=True)
class SceneKey:
    """Which scene: its seed, its kind (a word of `ArrangementConfig`), and the fold that its objects are of."""

    seed: int
    kind: str
    fold: int


@dataclass(frozen=True)
class SceneCloud:
    """A scene as some cameras see it, with the hypotheses there.

    Attributes:
        numbers (H, 31), context (H, 16) f32: `judge_features.NAMES` and `context_features.CONTEXT`.
        views: how many cameras.
    """

    seen: Seen
    around: Surroundings
    hypotheses: Hypotheses
    numbers: Tensor
    context: Tensor
    views: int


def scene_clouds(
    placed: Sequence[Placed], key: SceneKey, views: Sequence[int], predictor: Predictor, config: JudgeConfig
) -> list[SceneCloud]:
    """The clouds of a scene, of so many cameras each, whose azimuth and elevation are drawn; none without texlets."""
    rng = np.random.default_rng([key.seed, _CAMERAS])
    clouds = []
    for number, count in enumerate(views):
        azimuth, elevation = math.degrees(rng.uniform(0, 2 * math.pi)), rng.uniform(config.lowest_deg, config.highest_deg)
        sensing = replace(config.sensing, azimuth_deg=azimuth, elevation_deg=elevation)
        images = depth_images(
            placed, cameras_of(sensing, count), sensing, np.random.default_rng([key.seed, number, _NOISE])
        )
        try:
            scene = seen(images, scene_config(False), sensing, [key.seed, number, _TEXLETS])
        except InputError:  # nothing above the table
            continue
        if scene.no_grasp is not None:
            continue
        target = scene.of(scene.targets[0])
        its, around = Seen(target.texlets, target.views or ()), predictor.surroundings(target)
        clouds.append(described(its, around, count, predictor))
    return clouds


def described(its: Seen, around: Surroundings, views: int, predictor: Predictor) -> SceneCloud:
    """A cloud with its hypotheses and their numbers."""
    assert predictor.judged is not None  # a judge's
    search = predictor.judged.search
    hypotheses = search.hypotheses(its.texlets, around)
    hypotheses = hypotheses.at(in_images(its, hypotheses, search))
    numbers = judge_features(its, hypotheses, search)
    return SceneCloud(its, around, hypotheses, numbers, context_features(its, around, hypotheses, search), views)


class SceneCheck:
    """Whether the open hand, or what it sweeps on its way to a grasp, cuts anything of a scene, by the true meshes."""

    def __init__(self, placed: Sequence[Placed], hand: Hand, way: float) -> None:
        pieces = []
        for each in placed:
            pieces += [hull(part @ each.T_world_object[:3, :3].T + each.T_world_object[:3, 3]) for part in each.obj.parts]
        self._things = fcl.CollisionObject(triangle_tree(pieces))
        back = [0.0, 0.0, way]
        self._hands = [
            fcl.CollisionObject(
                triangle_tree([hull(np.concatenate([s.vertices, s.vertices - back])) for s in hand.preshapes[name].shapes])
            )
            for name in sorted(hand.preshapes)
        ]

    def free(self, hypotheses: Hypotheses) -> Tensor:
        """(H,) bool: the hand cuts nothing on its way."""
        request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)
        free = torch.zeros(len(hypotheses), dtype=torch.bool)
        rotations = se3.rotation_of(hypotheses.T).double().contiguous().numpy()
        positions = se3.position_of(hypotheses.T).double().contiguous().numpy()
        for k, code in enumerate(hypotheses.grasp_type.tolist()):
            hand = self._hands[code]
            hand.setTransform(fcl.Transform(rotations[k], positions[k]))
            free[k] = not fcl.collide(hand, self._things, request, fcl.CollisionResult())
        return free


def scene_of(key: SceneKey, pool: Sequence[GraspObject], count: int, config: ArrangementConfig) -> tuple[Placed, ...]:
    """The scene's objects, at rest."""
    return arranged(pool, count, key.seed, config)
