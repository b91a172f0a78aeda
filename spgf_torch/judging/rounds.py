"""Trials that teach: random ones on the mesh, then hypotheses that judges chose who had not seen the object.

Random candidates lie across a wall and never close on nothing; hypotheses of what one view shows do. Only trials of
hypotheses, the best and some at random, teach the difference.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from spgf_torch.cache import Cache
from spgf_torch.config import GRASP_TYPES, JudgeConfig
from spgf_torch.experiment.tried import tables_of
from spgf_torch.judging.rows import PICKED, SAMPLED, Bench, Chosen, Rows
from spgf_torch.judging.trying import tried
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import Stages
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.spreading import suppress
from spgf_torch.threads import in_parts
from spgf_torch.trials.runner import Trials, origin, sample
from spgf_torch.trials.table import pose_matrix


@dataclass(frozen=True)
class Workshop:
    """What trials are made with: how they run, the search of hypotheses, settings, what is kept, progress."""

    trials: Trials
    search: Search
    config: JudgeConfig
    cache: Cache
    stages: Stages


def random_trials(benches: Sequence[Bench], shop: Workshop) -> Rows:
    """The first `config.candidates` random trials of each type on each object: from tables, or tried here."""
    objects, config = [bench.obj for bench in benches], shop.config
    if config.trials is not None:
        tables = tables_of(objects, config.trials, shop.trials, config.sampler)
        kept = [_first(table.grasp_type, config.candidates) for table in tables]
        poses = [Hypotheses(t.T_object_tcp[k], t.grasp_type[k]) for t, k in zip(tables, kept, strict=True)]
        outcomes = [table.outcome[k] for table, k in zip(tables, kept, strict=True)]
    else:
        poses = [_sampled(obj, shop.trials, config) for obj in objects]
        outcomes = _tried(benches, poses, shop)
    return _rows(benches, [_alike(each, SAMPLED) for each in poses], outcomes, 0, shop)


def own_trials(
    benches: Sequence[Bench], judges: Mapping[int, Judge], fold: np.ndarray, number: int, shop: Workshop
) -> Rows:
    """Round `number`: in each cloud the best hypotheses of the judge of the object's fold, and some at random.

    The round after the last is that of validation: the best alone.
    """
    chosen = [choose(bench, judges[int(fold[bench.index])], number, shop.config) for bench in benches]
    outcomes = _tried(benches, [each.poses for each in chosen], shop)
    return _rows(benches, chosen, outcomes, number, shop)


def choose(bench: Bench, judge: Judge, number: int, config: JudgeConfig) -> Chosen:
    """In each cloud of an object the `best` hypotheses that are no two the same grasp, then `random` of the others."""
    rng = torch.Generator().manual_seed(zlib.crc32(f"{config.seed}/{number}/{bench.obj.name}".encode()))
    T, kind, cloud, rank, probability = [], [], [], [], []
    for index, (hypotheses, numbers) in enumerate(zip(bench.hypotheses, bench.numbers, strict=True)):
        p = judge.probability(numbers, images=True)
        alike = torch.zeros(len(p), dtype=torch.int64)
        best = suppress(hypotheses.T, alike, p, config.proposing.apart, config.proposing.apart_deg)[: config.best]
        others = torch.randperm(len(p), generator=rng)
        others = others[~torch.isin(others, best)][: config.random if number <= config.rounds else 0]
        both = torch.cat([best, others])
        T.append(hypotheses.T[both])
        kind.append(hypotheses.grasp_type[both])
        cloud.append(torch.full((len(both),), index))
        rank.append(torch.cat([torch.arange(len(best)), torch.full((len(others),), PICKED)]))
        probability.append(p[both])
    return Chosen(Hypotheses(torch.cat(T), torch.cat(kind)), *map(torch.cat, (cloud, rank, probability)))


def _rows(
    benches: Sequence[Bench], chosen: Sequence[Chosen], outcomes: Sequence[torch.Tensor], number: int, shop: Workshop
) -> Rows:
    triples = list(zip(benches, chosen, outcomes, strict=True))
    with shop.stages.stage("rows", len(triples), "objects") as advance:
        work = in_parts(lambda t: t[0].rows(t[1], t[2], number, shop.search), triples)
        return Rows.together([(advance(1), rows)[1] for rows in work])


def _tried(benches: Sequence[Bench], poses: Sequence[Hypotheses], shop: Workshop) -> list[torch.Tensor]:
    """The outcomes (M,) int64 of each object's poses."""
    requests, where = [], []
    for bench, its in zip(benches, poses, strict=True):
        for code, kind in enumerate(GRASP_TYPES):
            which = (its.grasp_type == code).nonzero()[:, 0]
            if len(which):
                requests.append((bench.obj, kind, its.T[which]))
                where.append((bench.index, which))
    with shop.stages.stage("trials", sum(map(len, poses)), "grasps") as advance:
        ended = tried(requests, shop.trials, shop.config.workers, shop.cache, advance)
    outcomes = {
        bench.index: torch.zeros(len(its), dtype=torch.int64) for bench, its in zip(benches, poses, strict=True)
    }
    for (index, which), codes in zip(where, ended, strict=True):
        outcomes[index][which] = codes
    return [outcomes[bench.index] for bench in benches]


def _sampled(obj: GraspObject, trials: Trials, config: JudgeConfig) -> Hypotheses:
    """What `simulate candidates=N` with the same seed would try."""
    poses = sample(obj, origin(obj, trials, config.sampler, config.candidates, config.seed))
    grasp_type = torch.arange(len(GRASP_TYPES)).repeat_interleave(config.candidates)
    return Hypotheses(pose_matrix(poses.position, poses.quaternion), grasp_type)


def _first(grasp_type: torch.Tensor, count: int) -> torch.Tensor:
    """Indices of the first `count` of each type."""
    return torch.cat([(grasp_type == code).nonzero()[:count, 0] for code in range(len(GRASP_TYPES))])


def _alike(poses: Hypotheses, rank: int) -> Chosen:
    """Poses that were proposed in no cloud."""
    nowhere = torch.full((len(poses),), -1)
    return Chosen(poses, nowhere, torch.full((len(poses),), rank), torch.full((len(poses),), torch.nan))
