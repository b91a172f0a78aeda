"""What scenes teach a judge: how likely a hypothesis among other things meets nothing, and then holds.

A judge of single objects has said of each hypothesis what it thinks; boosted trees weigh that together with all numbers
(`proposing.judge.SCENE_NUMBERS`). That judge has not seen the scene's objects, as in use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from torch import Tensor

from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.learning import fit
from spgf_torch.judging.scene_benches import KINDS, SceneBench
from spgf_torch.judging.scene_rounds import OBJECT, SCENE, SceneShop, choose
from spgf_torch.judging.scene_trials import SceneTrials
from spgf_torch.judging.scene_validation import compared
from spgf_torch.proposing.judge import FACTORS, SCENE_NUMBERS, Judge
from spgf_torch.proposing.judge import SCENE as KNOWN
from spgf_torch.proposing.judge_features import judge_features
from spgf_torch.proposing.tree_ensembles import Form

Factors = dict[tuple[str, str], Form]


@dataclass(frozen=True)
class SceneRows:
    """R hypotheses in clouds of scenes.

    Attributes:
        numbers: (R, 33) f32, `SCENE_NUMBERS`. free (R,) bool: nothing is met on the way, by the true meshes.
        success (R,) bool: of those tried. rank (R,) int64: place among the best; -1: at random; -2: not tried.
        scene (R,) int64: which of all scenes, counted. fold (R,) int64: of its objects.
    """

    numbers: Tensor
    free: Tensor
    success: Tensor
    rank: Tensor
    scene: Tensor
    fold: Tensor

    def __len__(self) -> int:
        return len(self.free)

    def at(self, chosen: Tensor) -> SceneRows:
        """Those of the mask (R,) bool."""
        return SceneRows(*(getattr(self, part.name)[chosen] for part in fields(self)))

    @staticmethod
    def together(parts: Sequence[SceneRows]) -> SceneRows:
        """All of them, one after the other."""
        return SceneRows(*(torch.cat([getattr(part, f.name) for part in parts]) for f in fields(SceneRows)))


@dataclass(frozen=True)
class SceneLessons:
    """What scenes taught: all trials, factors of each fold (key: the fold) and of all (None), rates."""

    trials: SceneTrials
    factors: Mapping[int | None, Factors]
    results: dict[str, Any]

    def taught(self, judge: Judge, fold: int | None) -> Judge:
        """A judge of single objects with what the scenes taught it."""
        return replace(judge, factors={**judge.factors, **self.factors[fold]})


def scene_lessons(shop: SceneShop, given: SceneTrials | None) -> SceneLessons:
    """Rounds in scenes, learning after each, and what judges then choose; `given`: the trials of an earlier call."""
    config, folds = shop.shop.config, len(shop.pools)
    rows, trials, taught = [], [], dict(shop.judges)
    by = OBJECT
    for number in range(1, shop.scenes.rounds + 1):
        for bench in shop.benches(number):
            chosen = _given(given, bench, number)
            if chosen is None:
                chosen = shop.tried(bench, choose(bench, {by: taught[bench.key.fold]}, number, shop))
            trials.append(chosen)
            rows.append(rows_of(bench, chosen, shop))
        known = SceneRows.together(rows)
        factors: dict[int | None, Factors] = {f: learn_scenes(known.at(known.fold != f), config) for f in range(folds)}
        taught = {f: replace(judge, factors={**judge.factors, **factors[f]}) for f, judge in shop.judges.items()}
        by = SCENE
    factors[None] = learn_scenes(known, config)
    lessons = SceneLessons(SceneTrials.together(trials), factors, {})
    measured = [_measured(bench, lessons, given, shop) for bench in shop.benches(shop.scenes.rounds + 1)]
    if not measured:
        return lessons
    last = SceneTrials.together(measured)
    return replace(lessons, trials=SceneTrials.together([lessons.trials, last]), results=compared(last, config))


def rows_of(bench: SceneBench, tried: SceneTrials, shop: SceneShop) -> SceneRows:
    """Rows of what was tried in the clouds of a scene, and of hypotheses at random of which the meshes tell."""
    rng = torch.Generator().manual_seed(bench.key.seed * len(KINDS) + KINDS.index(bench.key.kind))
    judge, search = shop.judges[bench.key.fold], shop.predictor.judged.search  # type: ignore[union-attr]
    parts = [_none()]
    for index, cloud in enumerate(bench.clouds):
        if cloud is None:
            continue
        its = tried.at(tried.cloud == index)
        some = torch.randperm(len(cloud.hypotheses), generator=rng)[: shop.scenes.surveyed]
        surveyed = cloud.hypotheses.at(some)
        numbers = judge_features(cloud.seen, its.poses, search)
        said = judge.scene_numbers(torch.cat([cloud.numbers[some], numbers]))
        free = torch.cat([bench.check.free(surveyed), bench.check.free(its.poses)])
        none, without = torch.zeros(len(some), dtype=torch.bool), torch.full((len(some),), -2)
        success, rank = torch.cat([none, its.success]), torch.cat([without, its.rank])
        scene, fold = (torch.full((len(free),), value) for value in (_number(bench), bench.key.fold))
        parts.append(SceneRows(said, free, success, rank, scene, fold))
    return SceneRows.together(parts)


def learn_scenes(rows: SceneRows, config: JudgeConfig) -> Factors:
    """P(nothing is met) from all rows, P(holds | so) from those that were tried; each scene counts alike."""
    held = rows.at((rows.rank > -2) & rows.free)
    free = fit(rows.numbers, rows.free, _weights(rows.scene), config)
    holds = fit(held.numbers, held.success, _weights(held.scene), config)
    return dict(zip([(KNOWN, factor) for factor in FACTORS], (free, holds), strict=True))


def _measured(bench: SceneBench, lessons: SceneLessons, given: SceneTrials | None, shop: SceneShop) -> SceneTrials:
    number, fold = shop.scenes.rounds + 1, bench.key.fold
    if (known := _given(given, bench, number)) is not None:
        return known
    old = shop.judges[fold]
    return shop.tried(bench, choose(bench, {OBJECT: old, SCENE: lessons.taught(old, fold)}, number, shop))


def _given(given: SceneTrials | None, bench: SceneBench, number: int) -> SceneTrials | None:
    """What an earlier call tried in a scene; None: nothing."""
    if given is None:
        return None
    kind = KINDS.index(bench.key.kind)
    its = given.at((given.scene == bench.key.seed) & (given.kind == kind) & (given.round == number))
    return its if len(its) else None


def _weights(scene: Tensor) -> Tensor:
    weight = 1 / torch.bincount(scene).clamp(min=1)[scene].double()
    return weight / weight.mean() if len(weight) else weight


def _number(bench: SceneBench) -> int:
    return bench.key.seed * len(KINDS) + KINDS.index(bench.key.kind)


def _none() -> SceneRows:
    whole, no = torch.zeros(0, dtype=torch.int64), torch.zeros(0, dtype=torch.bool)
    return SceneRows(torch.zeros(0, len(SCENE_NUMBERS)), no, no, whole, whole, whole)
