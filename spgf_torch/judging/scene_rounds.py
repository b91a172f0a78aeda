"""Rounds of trials in scenes: judges that have not seen a scene's objects choose, some are drawn, all are executed.

The first round is of judges that learned from single objects alone; each other of judges that learned from the scenes
before, too. A last one measures: what judges of either sort choose in scenes of their own.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from spgf_torch.cache import code_fingerprint, fingerprint
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.geometry import se3
from spgf_torch.judging.config import ContextConfig
from spgf_torch.judging.rounds import Workshop
from spgf_torch.judging.scene_benches import KINDS, SceneBench, SceneCloud, SceneKey
from spgf_torch.judging.scene_trials import PROPOSERS, SceneTrials
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.predictor import Predictor
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.judge_proposer import JudgedProposer, best_indices
from spgf_torch.settings import plain
from spgf_torch.simulation import attempts as physics
from spgf_torch.simulation.attempts import CAUSES, Attempts
from spgf_torch.simulation.execute import versions

OBJECT, SCENE, RANDOM = range(len(PROPOSERS))
KIND = "scene-outcomes"  # of entries of the cache


@dataclass(frozen=True)
class SceneShop:
    """What trials in scenes are made with.

    Attributes:
        pools: the objects of each fold. judges: fold -> one that learned from single objects of the others.
    """

    shop: Workshop
    pools: Sequence[Sequence[GraspObject]]
    judges: Mapping[int, Judge]

    @property
    def scenes(self) -> ContextConfig:
        config = self.shop.config.context
        assert config is not None  # who opens this shop has settings for it
        return config

    @cached_property
    def predictor(self) -> Predictor:
        """Whose search and surroundings are those of every judge of the hand."""
        config = self.shop.config
        judged = JudgedProposer.alone(self.judges[0], open_hand(config.hand), self.scenes.proposing)
        return Predictor(None, config.sensing, {}, None, self.scenes.attempt.approach, judged)

    @cached_property
    def attempts(self) -> dict[str, Attempts]:
        """Who executes in scenes of each kind."""
        hand, episode = self.shop.trials.hand, self.shop.trials.episode
        return {kind: Attempts(hand, episode, self.scenes.attempt, getattr(self.scenes, kind)) for kind in KINDS}

    def keys(self, number: int) -> list[SceneKey]:
        """The scenes of round `number`, from 1; the one after the last measures."""
        scenes, folds = self.scenes, len(self.pools)
        measures = number > scenes.rounds
        first = scenes.first_measured if measures else scenes.first + (number - 1) * scenes.number
        seeds = range(first, first + (scenes.measured if measures else scenes.number))
        return [SceneKey(seed, kind, seed % folds) for seed in seeds for kind in KINDS]

    def benches(self, number: int) -> Iterator[SceneBench]:
        """The scenes of a round, one after the other."""
        keys, shop = self.keys(number), self.shop
        with shop.stages.stage("scenes", len(keys), "scenes") as advance:
            for key in keys:
                yield SceneBench.of(key, self.pools[key.fold], self.predictor, shop.trials.hand, shop.config)
                advance(1)

    def tried(self, bench: SceneBench, chosen: SceneTrials) -> SceneTrials:
        """The same with how they ended; kept as soon as all of a scene have."""
        names, attempts = self.shop.trials.grasp_types, self.attempts[bench.key.kind]
        poses = chosen.poses

        def run() -> dict[str, Tensor]:
            ends: dict[tuple[bytes, int], str] = {}  # what two judges chose is tried once
            each = [(T.tobytes(), code) for T, code in zip(poses.T.numpy(), poses.grasp_type.tolist(), strict=True)]
            for T, key in zip(poses.T.double().numpy(), each, strict=True):
                if key not in ends:
                    ends[key] = attempts.run(bench.placed, T, names[key[1]]).cause
            return {"cause": torch.tensor([CAUSES.index(ends[key]) for key in each], dtype=torch.int64)}

        objects = [(each.obj.digest, each.obj.mass) for each in bench.placed]
        where = np.array([each.T_world_object for each in bench.placed])
        settings = [plain(part) for part in (attempts.episode, attempts.config, attempts.arrangement)]
        physical = (attempts.hand.digest, settings, versions(), code_fingerprint(physics.__name__))
        key = fingerprint(objects, torch.from_numpy(where), poses.T, poses.grasp_type, *physical)
        return chosen.with_causes(self.shop.cache.tensors(KIND, key, run)["cause"])


def choose(bench: SceneBench, judges: Mapping[int, Judge], number: int, shop: SceneShop) -> SceneTrials:
    """What is to be tried in a scene: in each cloud the best of each judge (into `PROPOSERS`), some at random.

    What two judges choose has a row for each.
    """
    scenes, config = shop.scenes, shop.shop.config
    word = f"{config.seed}/{number}/{bench.key.kind}/{bench.key.seed}"
    rng = torch.Generator().manual_seed(zlib.crc32(word.encode()))
    search, parts = shop.predictor.judged.search, [_none()]  # type: ignore[union-attr]
    for index, cloud in enumerate(bench.clouds):
        if cloud is None:
            continue
        taken = [torch.zeros(0, dtype=torch.int64)]
        for by, judge in judges.items():
            p = said(judge, cloud, by)
            best = best_indices(cloud.seen, cloud.hypotheses, p, search, scenes.proposing)
            taken.append(best := best[: scenes.best])
            parts.append(_chosen(bench, index, number, best, torch.arange(len(best)), by, p))
        if number <= scenes.rounds:
            others = torch.randperm(len(cloud.hypotheses), generator=rng)
            others = others[~torch.isin(others, torch.cat(taken))][: 8 * scenes.random]
            others = others[bench.check.free(cloud.hypotheses.at(others))][: scenes.random]
            nobody = torch.full((len(cloud.hypotheses),), torch.nan)
            parts.append(_chosen(bench, index, number, others, torch.full((len(others),), -1), RANDOM, nobody))
    return SceneTrials.together(parts)


def said(judge: Judge, cloud: SceneCloud, by: int) -> Tensor:
    """(H,) f32: the probability that a judge of single objects, or of scenes, gives the hypotheses of a cloud."""
    if by == OBJECT:
        return judge.probability(cloud.numbers, images=True)
    free, holds = judge.both_in_scene(cloud.numbers)
    return (free * holds).float()


def _chosen(bench: SceneBench, cloud: int, number: int, index: Tensor, rank: Tensor, by: int, p: Tensor) -> SceneTrials:
    its = bench.clouds[cloud]
    assert its is not None  # a cloud in which there was something to choose
    T = its.hypotheses.T[index]
    scene, kind, where, round_, who = (
        torch.full((len(index),), value) for value in (bench.key.seed, KINDS.index(bench.key.kind), cloud, number, by)
    )
    position, quaternion = se3.position_of(T).float(), se3.quaternion_of(T.double()).float()
    ends = torch.zeros_like(index)
    return SceneTrials(
        scene, kind, where, round_, who, rank, position, quaternion, its.hypotheses.grasp_type[index], ends, p[index]
    )


def _none() -> SceneTrials:
    whole, few = torch.zeros(0, dtype=torch.int64), torch.zeros(0)
    placed = few.view(0, 3), few.view(0, 4)
    return SceneTrials(whole, whole, whole, whole, whole, whole, *placed, whole, whole, few)
