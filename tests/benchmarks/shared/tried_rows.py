"""The trials that a judge learned from, made again from its settings and the cache of outcomes, with their poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from spgf_torch.cache import Cache
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.experiment.labelled_grasps import open_hand, tables_of
from spgf_torch.files.reading import yaml_values
from spgf_torch.hands.config import grasp_types
from spgf_torch.hands.hand import load_hand
from spgf_torch.judging.clouds import training_clouds
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.learning import judge_of, learn_judge
from spgf_torch.judging.resumable_trials import tried
from spgf_torch.judging.rounds import choose
from spgf_torch.judging.training_rows import SAMPLED, SUCCESS, Bench, Chosen, Rows
from spgf_torch.objects.folders import read_objects
from spgf_torch.progress import ProgressReporter, show
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.settings import typed
from spgf_torch.simulation.execute import provenance_of, sample
from spgf_torch.simulation.table import TrialTable, pose_matrix
from spgf_torch.simulation.worker import Trials
from spgf_torch.threads import in_parts


@dataclass(frozen=True)
class Tried:
    """All trials of one hand.

    Attributes:
        rows: as a judge learns from them; T (R, 4, 4) f32, grasp_type (R,) int64: the pose of each row.
        nth (R,) int64: of a random trial, which of its object and type it was, from 0; of others their rank.
        fold (objects,): in which each object is held out.
    """

    config: JudgeConfig
    search: Search
    benches: list[Bench]
    fold: np.ndarray
    rows: Rows
    T: Tensor
    grasp_type: Tensor
    nth: Tensor
    trials: Trials
    cache: Cache

    @property
    def folds(self) -> Tensor:
        """(R,) int64: of each row's object."""
        return torch.from_numpy(self.fold)[self.rows.obj]

    @property
    def own(self) -> Tensor:
        """(R,) bool: hypotheses in the cloud that proposed them, on which judges are measured."""
        return self.rows.home & (self.rows.rank > SAMPLED)

    def try_(self, poses: Mapping[int, Hypotheses]) -> dict[int, Tensor]:
        """Object -> the outcomes (M,) int64 of its poses, kept in the cache."""
        requests, where = [], []
        for index, its in poses.items():
            for code, kind in enumerate(grasp_types(self.trials.hand.config)):
                if len(which := (its.grasp_type == code).nonzero()[:, 0]):
                    requests.append((self.benches[index].obj, kind, its.T[which]))
                    where.append((index, which))
        found = {index: torch.zeros(len(its), dtype=torch.int64) for index, its in poses.items()}
        ended = tried(requests, self.trials, self.config.workers, self.cache)
        for (index, which), codes in zip(where, ended, strict=True):
            found[index][which] = codes
        return found


def tried_with(run: Path, cache: Path, objects: str, trials: str) -> Tried:
    """What `judge` tried in the run's folder, whose settings are in its config.yaml: random trials, then rounds."""
    values = yaml_values(run / "config.yaml", "the settings of a run of judge", sealed=True)
    config = typed(JudgeConfig, {k: v for k, v in values.items() if k in JudgeConfig.__dataclass_fields__})
    config = replace(config, objects=objects, trials=config.trials and trials, workers=2)
    stages, proposing = ProgressReporter(), config.proposing
    found = read_objects(config, stages, Cache(None)).objects
    clearance = Clearance(
        open_hand(config.hand), proposing.plane_clearance, proposing.between, proposing.obstacle_clearance
    )
    search = Search.of(clearance, config.hypotheses)
    with stages.stage("hypotheses", len(found), "objects") as advance:

        def bench(index: int) -> Bench:
            return Bench.of(index, found[index], training_clouds(found[index], config), search)

        benches = [(advance(1), done)[1] for done in in_parts(bench, range(len(found)))]
    fold = stratified_folds([obj.category for obj in found], config.folds, config.seed)
    empty = torch.zeros(0, dtype=torch.int64)
    made = Tried(
        config, search, benches, fold, Rows.together([]), torch.zeros(0, 4, 4), empty, empty,
        Trials(load_hand(config.hand), config.episode), Cache(cache),
    )  # fmt: skip
    made = _and(made, _random(made), 0)
    for number in range(1, config.rounds + 1):
        judges = {
            held_out: judge_of(learn_judge(made.rows.at(made.folds != held_out), config, ["images"]), [], config)
            for held_out in range(config.folds)
        }
        made = _and(made, [choose(b, judges[int(fold[b.index])], number, config) for b in benches], number)
    show(f"{len(made.rows)} rows, {int(made.own.sum())} of hypotheses at home, {int(made.rows.success.sum())} held")
    return made


def _random(made: Tried) -> list[Chosen]:
    """The random trials that `judging.rounds.random_trials` tries."""
    config, objects = made.config, [bench.obj for bench in made.benches]
    poses = []
    if config.trials is not None:
        for table in tables_of(objects, config.trials, made.trials, config.sampler):
            at = _first(table, config)
            poses.append(Hypotheses(table.T_object_tcp[at], table.grasp_type[at]))
    else:
        for obj in objects:
            provenance = provenance_of(obj, made.trials, config.sampler, config.candidates, config.seed)
            sampled = sample(obj, provenance, made.trials.samplers)
            poses.append(Hypotheses(pose_matrix(sampled.position, sampled.quaternion), sampled.grasp_type))
    nowhere = [torch.full((len(its),), -1) for its in poses]
    return [
        Chosen(its, where, torch.full_like(where, SAMPLED), torch.full((len(its),), torch.nan))
        for its, where in zip(poses, nowhere, strict=True)
    ]


def _ended(made: Tried, chosen: Sequence[Chosen], number: int) -> dict[int, Tensor]:
    """Object -> outcomes (M,) int64 of these trials of a round."""
    if number > 0 or made.config.trials is None:
        return made.try_({b.index: its.poses for b, its in zip(made.benches, chosen, strict=True)})
    tables = tables_of([b.obj for b in made.benches], made.config.trials, made.trials, made.config.sampler)
    return {b.index: t.outcome[_first(t, made.config)] for b, t in zip(made.benches, tables, strict=True)}


def _first(table: TrialTable, config: JudgeConfig) -> Tensor:
    """Indices of a table's first trials of each type."""
    of_type = [(table.grasp_type == code).nonzero()[: config.candidates, 0] for code in range(len(table.grasp_types))]
    return torch.cat(of_type)


def _and(made: Tried, chosen: Sequence[Chosen], number: int) -> Tried:
    """With rows of these trials, one list an object; their poses are found by the number that stands for p."""
    ended = _ended(made, chosen, number)
    parts, T, kind, nth = [made.rows], [made.T], [made.grasp_type], [made.nth]
    for bench, its in zip(made.benches, chosen, strict=True):
        numbered = replace(its, probability=torch.arange(len(its.poses)).float())
        rows = bench.rows(numbered, ended[bench.index], number, made.search)
        at = rows.probability.long()
        parts.append(replace(rows, probability=its.probability[at]))
        T.append(its.poses.T[at])
        kind.append(its.poses.grasp_type[at])
        nth.append(at % made.config.candidates if number == 0 else rows.rank)
    return replace(made, rows=Rows.together(parts), T=torch.cat(T), grasp_type=torch.cat(kind), nth=torch.cat(nth))


def drawn(T: Tensor) -> Tensor:
    """(G,) f64 in 0 to 1 that follow from poses (G, 4, 4) alone: the same pose is drawn in every cloud or in none."""
    return (T.flatten(1).double() @ torch.arange(1.0, 17.0).double() * 1e4) % 1


def few(made: Tried, share: float) -> Tensor:
    """(R,) bool: rows of the first random trials of each type, and of as large a share of the chosen ones."""
    count = max(1, round(share * made.config.candidates))
    return torch.where(made.rows.round == 0, made.nth < count, drawn(made.T) < share)


def trials_of(made: Tried, share: float = 1.0) -> list[tuple[Hypotheses, Tensor]]:
    """Each object's trials, the colliding ones too, and whether they held (M,) bool; `share` as in `few`."""
    count, found = max(1, round(share * made.config.candidates)), []
    at_random = _random(made)
    ended = _ended(made, at_random, 0)
    for bench, its in zip(made.benches, at_random, strict=True):
        first = torch.arange(len(its.poses)) % made.config.candidates < count
        own = made.own & (made.rows.obj == bench.index) & (drawn(made.T) < share)
        T = torch.cat([its.poses.T[first], made.T[own]])
        kind = torch.cat([its.poses.grasp_type[first], made.grasp_type[own]])
        held = torch.cat([ended[bench.index][first] == SUCCESS, made.rows.success[own]])
        found.append((Hypotheses(T, kind), held))
    return found
