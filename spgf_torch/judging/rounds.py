"""Trials that teach: random ones on the mesh, then hypotheses that judges chose who had not seen the object.

Random candidates lie across a wall and never close on nothing; hypotheses of what one view shows do. Only trials of
hypotheses, the best and some at random, teach the difference.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from spgf_torch.cache import Cache
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.own_trials import OwnProvenance, OwnTrials
from spgf_torch.judging.resumable_trials import tried
from spgf_torch.judging.training_rows import PICKED, SAMPLED, Bench, Chosen, Rows
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.sampling import non_maximum_suppression
from spgf_torch.simulation.execute import Trials, ended_table, provenance_of, sample
from spgf_torch.simulation.executors import Executor
from spgf_torch.simulation.table import TrialTable, pose_matrix
from spgf_torch.threads import in_parts


@dataclass(frozen=True)
class Workshop:
    """What trials are made with: how they run, the search of hypotheses, settings, what is kept, progress.

    Attributes:
        executor: makes what runs the trials of one stage.
    """

    trials: Trials
    search: Search
    config: JudgeConfig
    cache: Cache
    stages: ProgressReporter
    executor: Callable[[], Executor]


def random_tables(objects: Sequence[GraspObject], shop: Workshop) -> list[TrialTable]:
    """`config.candidates` random trials of each type on each object: the tables that `simulate` would make."""
    config = shop.config
    provenances = [provenance_of(obj, shop.trials, config.sampler, config.candidates, config.seed) for obj in objects]
    poses = [sample(obj, its, shop.trials.samplers) for obj, its in zip(objects, provenances, strict=True)]
    sampled = [Hypotheses(pose_matrix(each.position, each.quaternion), each.grasp_type) for each in poses]
    ended = _tried(objects, sampled, shop)
    return [ended_table(*parts) for parts in zip(provenances, poses, ended, strict=True)]


def random_rows(benches: Sequence[Bench], tables: Sequence[TrialTable], shop: Workshop) -> Rows:
    """Rows of the first `config.candidates` random trials of each type on each object."""
    chosen, outcomes = [], []
    for table in tables:
        first = _first(table.grasp_type, shop.config.candidates)
        chosen.append(_unranked(Hypotheses(table.T_object_tcp[first], table.grasp_type[first])))
        outcomes.append(table.outcome[first])
    return _rows(benches, chosen, outcomes, 0, shop)


def own_round(
    benches: Sequence[Bench], judges: Mapping[int, Judge], fold: np.ndarray, number: int, shop: Workshop
) -> list[OwnTrials]:
    """Round `number`: in each cloud the best hypotheses of the judge of the object's fold, and some at random.

    The round after the last is that of validation: the best alone.
    """
    drafts = []
    for bench in benches:
        chosen = choose(bench, judges[int(fold[bench.index])], number, shop.config, shop.search)
        provenance = OwnProvenance.of(bench.obj, shop.trials, shop.config)
        drafts.append(OwnTrials.of(provenance, chosen, number, shop.trials.grasp_types))
    ended = _tried([bench.obj for bench in benches], [draft.chosen.poses for draft in drafts], shop)
    return [draft.ended(words) for draft, words in zip(drafts, ended, strict=True)]


def own_rows(benches: Sequence[Bench], own: Sequence[OwnTrials], number: int, shop: Workshop) -> Rows:
    """Rows of the trials of round `number`."""
    its = [each.at_round(number) for each in own]
    return _rows(benches, [each.chosen for each in its], [each.outcome for each in its], number, shop)


def choose(bench: Bench, judge: Judge, number: int, config: JudgeConfig, search: Search) -> Chosen:
    """In each cloud of an object the `best` hypotheses that are no two the same grasp, then `random` of the others."""
    rng = torch.Generator().manual_seed(zlib.crc32(f"{config.seed}/{number}/{bench.obj.name}".encode()))
    T, grasp_type, cloud, rank, probability = [], [], [], [], []
    for index, (hypotheses, numbers) in enumerate(zip(bench.hypotheses, bench.numbers, strict=True)):
        p = judge.probability(numbers, images=True)
        alike = torch.zeros(len(p), dtype=torch.int64)
        limits = config.proposing.apart, config.proposing.apart_deg
        symmetry = search.clearance.symmetry(hypotheses.grasp_type)
        best = non_maximum_suppression(hypotheses.T, alike, p, *limits, symmetry)[: config.best]
        others = torch.randperm(len(p), generator=rng)
        others = others[~torch.isin(others, best)][: config.random if number <= config.rounds else 0]
        both = torch.cat([best, others])
        T.append(hypotheses.T[both])
        grasp_type.append(hypotheses.grasp_type[both])
        cloud.append(torch.full((len(both),), index))
        rank.append(torch.cat([torch.arange(len(best)), torch.full((len(others),), PICKED)]))
        probability.append(p[both])
    return Chosen(Hypotheses(torch.cat(T), torch.cat(grasp_type)), *map(torch.cat, (cloud, rank, probability)))


def _rows(
    benches: Sequence[Bench], chosen: Sequence[Chosen], outcomes: Sequence[torch.Tensor], number: int, shop: Workshop
) -> Rows:
    triples = list(zip(benches, chosen, outcomes, strict=True))
    with shop.stages.stage("rows", len(triples), "objects") as advance:
        work = in_parts(lambda t: t[0].rows(t[1], t[2], number, shop.search), triples)
        return Rows.together([(advance(1), rows)[1] for rows in work])


def _tried(objects: Sequence[GraspObject], poses: Sequence[Hypotheses], shop: Workshop) -> list[list[str]]:
    """How each of each object's poses ended: words of `label.Label`."""
    requests, where = [], []
    for index, (obj, its) in enumerate(zip(objects, poses, strict=True)):
        for code, kind in enumerate(shop.trials.grasp_types):
            which = (its.grasp_type == code).nonzero()[:, 0]
            if len(which):
                requests.append((obj, kind, its.T[which]))
                where.append((index, which))
    with shop.stages.stage("trials", sum(map(len, poses)), "grasps") as advance:
        ended = tried(requests, shop.trials, shop.executor, shop.cache, advance)
    found = [[""] * len(its) for its in poses]
    for (index, which), words in zip(where, ended, strict=True):
        for place, word in zip(which.tolist(), words, strict=True):
            found[index][place] = word
    return found


def _first(grasp_type: torch.Tensor, count: int) -> torch.Tensor:
    """Indices of the first `count` of each type."""
    return torch.cat([(grasp_type == code).nonzero()[:count, 0] for code in grasp_type.unique().tolist()])


def _unranked(poses: Hypotheses) -> Chosen:
    """Poses that were proposed in no cloud."""
    nowhere, rank = (torch.full((len(poses),), value) for value in (-1, SAMPLED))
    return Chosen(poses, nowhere, rank, torch.full((len(poses),), torch.nan))
