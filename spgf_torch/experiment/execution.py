"""Executing a model's best grasps on objects that were never tried: the engine has the last word."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.describe import Grasps
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.second_engine.physics import NAMES, makers
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.execute import Trials, codes, execute_words
from spgf_torch.simulation.table import OUTCOMES

SUCCESS, NOT_RUN = OUTCOMES.index("success"), -1


@dataclass(frozen=True)
class Executed:
    """What an engine made of one object's grasps.

    Attributes:
        best: grasp type or "CG" -> indices (<= N,) int64 of the highest-ranked grasps, best first.
        outcome: (G,) int64 codes into `OUTCOMES` of the best ones and the random sample; `NOT_RUN` of others.
        random: grasp type -> indices (R,) int64 of the random sample.
        ended: index of a grasp that ran -> how it ended (a word of `label.Label`).
    """

    best: dict[str, Tensor]
    outcome: Tensor
    random: dict[str, Tensor]
    ended: Mapping[int, str] = field(default_factory=dict)

    @property
    def success(self) -> Tensor:
        """(G,) bool, which grasps were held."""
        return self.outcome == SUCCESS

    @property
    def ran(self) -> Tensor:
        """(G,) bool, which grasps were executed."""
        return self.outcome != NOT_RUN

    def rate(self, chosen: Tensor) -> float:
        """Share of successes among the grasps `chosen`; of none it is 0."""
        return float(self.success[chosen].float().mean()) if len(chosen) else 0.0


def candidate_grasps(
    obj: GraspObject, count: int, config: SamplerConfig, seed: int, samplers: Mapping[str, str]
) -> Grasps:
    """`count` candidates of each type, by the samplers that the trial table was made with (`config.samplers_of`)."""
    rng = np.random.default_rng([seed, zlib.crc32(obj.name.encode())])
    poses = [sample_candidates(obj, count, config, rng, sampler) for sampler in samplers.values()]
    return Grasps(torch.cat(poses), torch.arange(len(samplers)).repeat_interleave(count))


def ranked_grasps(score: Tensor) -> Tensor:
    """The grasps by their score (G,), best first; ties by index. Those without a vote (-inf) are left out."""
    order = torch.argsort(score, descending=True, stable=True)
    return order[score[order] > -torch.inf]


def best_grasps(score: Tensor, grasp_type: Tensor, n: int, grasp_types: Sequence[str]) -> dict[str, Tensor]:
    """The n highest-ranked grasps of each of the types and of all together (CG), as `ranked_grasps`."""
    order = ranked_grasps(score)
    best = {name: order[grasp_type[order] == code][:n] for code, name in enumerate(grasp_types)}
    return {**best, "CG": order[:n]}


def with_random(proposed: Grasps, score: Tensor, sampled: Grasps) -> tuple[Grasps, Tensor]:
    """Proposals (P) behind candidates that were sampled at random (R): grasps, and score (R + P,) f32.

    The random ones take part in no ranking.
    """
    T = torch.cat([sampled.T_object_tcp.float(), proposed.T_object_tcp.float()])
    none = torch.full((len(sampled.grasp_type),), -torch.inf)
    return Grasps(T, torch.cat([sampled.grasp_type, proposed.grasp_type])), torch.cat([none, score])


def execute_best(
    objects: Sequence[GraspObject],
    grasps: Sequence[Grasps],
    score: Sequence[Tensor],
    trials: Trials,
    config: EvaluateConfig,
    stages: ProgressReporter,
) -> dict[str, list[Executed]]:
    """Execute the N best grasps of each type, and the first `random_trials` candidates of each: a random sample.

    Returns for each engine that `config.engine` asks for what it made of every object's grasps, the same ones in each.
    """
    types = trials.grasp_types
    best = [best_grasps(s, g.grasp_type, config.N, types) for s, g in zip(score, grasps, strict=True)]
    random = [
        {name: (g.grasp_type == code).nonzero()[:, 0][: config.random_trials] for code, name in enumerate(types)}
        for g in grasps
    ]
    chosen = [torch.cat([b[name], r[name]]).unique() for b, r in zip(best, random, strict=True) for name in types]
    pairs = [(i, name) for i in range(len(objects)) for name in types]
    requests = [
        (objects[i], name, grasps[i].T_object_tcp[which]) for (i, name), which in zip(pairs, chosen, strict=True)
    ]
    executed = {}
    for engine, make in makers(config.engine, config.mujoco).items():
        outcome = [torch.full((len(g.grasp_type),), NOT_RUN) for g in grasps]
        ended: list[dict[int, str]] = [{} for _ in grasps]
        with stages.stage(f"trials in {NAMES[engine]}", sum(map(len, chosen)), "grasps") as advance:
            told = partial(_told, advance)
            ways = execute_words(requests, trials, config.workers, told, make)
            for (i, _), which, words in zip(pairs, chosen, ways, strict=True):
                outcome[i][which] = codes(words)
                ended[i] |= zip(which.tolist(), words, strict=True)
        executed[engine] = [Executed(*row) for row in zip(best, outcome, random, ended, strict=True)]
    return executed


def execute_draws(
    objects: Sequence[GraspObject],
    grasps: Sequence[Grasps],
    score: Sequence[Tensor],
    trials: Trials,
    config: EvaluateConfig,
    stages: ProgressReporter,
) -> list[list[Executed]]:
    """Execute the N best grasps of each type in the draws after the episode's own, `config.draws` with that one.

    Returns for each further draw what became of every object's grasps; no random sample. `episode.robot` is set.
    """
    assert trials.episode.robot is not None
    robot, best_alone = trials.episode.robot, replace(config, random_trials=0)
    found = []
    for number in range(robot.draw + 1, robot.draw + config.draws):
        drawn = replace(trials, episode=replace(trials.episode, robot=replace(robot, draw=number)))
        (executed,) = execute_best(objects, grasps, score, drawn, best_alone, stages).values()
        found.append(executed)
    return found


def _told(advance: Callable[[int], None], name: str, done: int) -> None:
    advance(done)
