"""Runs of one experiment with several seeds, as one: mean rates, and intervals over seeds and objects together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.evaluation.seeds import interval_over_seeds, mean_over_seeds
from spgf_torch.evaluation.success import ALL
from spgf_torch.objects.config import CLASSES
from spgf_torch.reporting.data.runs import Block, Bounds, ObjectRow, Run, Tell, read_per_object

OfSeeds = Mapping[Any, Sequence[ObjectRow]]  # seed -> the rates of each object


@dataclass(frozen=True)
class Repeats:
    """Runs that differ in nothing but the seed: at least one.

    Attributes:
        runs: by seed.
        seeds: ranking -> the seeds of the runs that have rates by it.
        by_ranking, interval95: ranking -> means over these seeds, and 95 % intervals over seeds and objects together;
            of one seed over objects alone.
        random, random_collision_free, ceiling: means over all seeds.
    """

    runs: tuple[Run, ...]
    seeds: dict[str, tuple[int, ...]]
    by_ranking: dict[str, Block]
    interval95: dict[str, Bounds]
    random: Block
    random_collision_free: Block
    ceiling: Block

    @property
    def K(self) -> int:  # noqa: N802
        return self.runs[0].K

    @property
    def N(self) -> int:  # noqa: N802
        return self.runs[0].N

    @property
    def grasp_types(self) -> tuple[str, ...]:
        return self.runs[0].grasp_types

    @property
    def types(self) -> tuple[str, ...]:
        return self.runs[0].types

    @property
    def of_papers_hand(self) -> bool:
        return self.runs[0].of_papers_hand

    @property
    def settings(self) -> dict[str, Any]:
        """Those of the run of the smallest seed."""
        return self.runs[0].settings

    @property
    def stamp(self) -> str:
        """When the newest was started."""
        return max(run.stamp for run in self.runs)

    def rate(self, ranking: str, name: str = "all", kind: str = ALL) -> float:
        return self.by_ranking[ranking][name][kind]


def repeated(runs: Sequence[Run], resamples: int, seed: int, tell: Tell) -> Repeats:
    """Runs that differ in nothing but the seed, as one.

    Where there are several, one whose objects' rates cannot be read is told and left out.

    Args:
        resamples: draws of seeds and objects for the intervals. seed: of these draws.
    """
    runs = sorted(runs, key=lambda run: run.seed)
    rows = _rows(runs, tell) if len(runs) > 1 else {}
    kept = [run for run in runs if run.seed in rows] or runs[-1:]
    having = {
        ranking: [run for run in kept if ranking in run.by_ranking]
        for ranking in dict.fromkeys(ranking for run in kept for ranking in run.by_ranking)
    }
    by_ranking, interval95 = {}, {}
    for ranking, members in having.items():
        by_ranking[ranking], interval95[ranking] = members[0].by_ranking[ranking], members[0].interval95[ranking]
        if len(members) > 1:
            classes, rates = of_objects({run.seed: rows[run.seed] for run in members}, ranking)
            by_ranking[ranking] = mean_over_seeds(classes, rates)
            interval95[ranking] = interval_over_seeds(classes, rates, resamples, seed)
    seeds = {ranking: tuple(run.seed for run in members) for ranking, members in having.items()}
    blocks = [_mean([getattr(run, name) for run in kept]) for name in ("random", "random_collision_free", "ceiling")]
    return Repeats(tuple(kept), seeds, by_ranking, interval95, *blocks)


def of_objects(rows: OfSeeds, ranking: str) -> tuple[list[str], list[list[dict[str, float]]]]:
    """Class of each object that all seeds have, and of each seed its rates by a ranking in that order."""
    by_name = [{row.name: row for row in of_seed} for of_seed in rows.values()]
    shared = [row for row in next(iter(rows.values())) if all(row.name in known for known in by_name)]
    return [row.category for row in shared], [[known[row.name].rates[ranking] for row in shared] for known in by_name]


def per_object(repeats: Repeats, ranking: str) -> dict[int, list[ObjectRow]]:
    """Seed -> the objects, of the runs that have the ranking. Raises InputError where they cannot be read."""
    return {run.seed: read_per_object(run) for run in repeats.runs if ranking in run.by_ranking}


def seed_words(count: int) -> str:
    """`1 seed`, `5 seeds`."""
    return f"{count} seed" if count == 1 else f"{count} seeds"


def _rows(runs: Sequence[Run], tell: Tell) -> dict[int, list[ObjectRow]]:
    """Seed -> the objects of each run that can be read and that has those of the first one."""
    rows: dict[int, list[ObjectRow]] = {}
    for run in runs:
        try:
            found = read_per_object(run)
            first = next(iter(rows.values()), found)
            if {row.name for row in found} != {row.name for row in first}:
                raise InputError(
                    f"{run.folder / 'per_object.csv'}: expected the objects of the other seeds, got others"
                )
            rows[run.seed] = found
        except InputError as error:
            tell(f"left out of the mean over seeds: {error}")
    return rows


def _mean(blocks: Sequence[Block]) -> Block:
    return {
        name: {
            kind: float(np.mean([block[name][kind] for block in blocks]))
            for kind in blocks[0][name]
            if all(kind in block.get(name, {}) for block in blocks)
        }
        for name in (*CLASSES, "all")
        if name in blocks[0]
    }
