"""What belongs together: the sweep over K that the table shows, and ablations to compare with it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.success import Rates, paired_difference
from spgf_torch.reporting.data.runs import Bounds, ObjectRow, Run

# Settings that do not change what a run's rates mean: where data stand, how it is computed, what is shown.
PROCESS = {"objects", "trials", "device", "workers", "ranking", "bootstrap", "final_model", "fold_models"}
SWEPT = {"K", "prototypes.num_clusters"}
NOMINAL_K = 20  # the paper's best combined result: what an ablation is compared with where its own K was not run

Settings = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Variant:
    """A run beside the sweep: what it varies, and the run of the sweep that it is compared with.

    Attributes:
        varies: setting -> (its value here, the sweep's), both as text; "-" where a run has no such setting.
    """

    run: Run
    reference: Run
    varies: dict[str, tuple[str, str]]

    @property
    def label(self) -> str:
        """What varies, in words: `features.layers = 1 (2)`; of more than two settings the first, and how many more."""
        told = [f"{key} = {value} ({usual})" for key, (value, usual) in self.varies.items()]
        return ", ".join(told) if len(told) <= 2 else f"{told[0]} and {len(told) - 1} more"


@dataclass(frozen=True)
class Sweep:
    """Runs that differ in K alone, by K; and the others of the same data."""

    runs: tuple[Run, ...]
    variants: tuple[Variant, ...]

    def of(self, K: int) -> Run | None:
        return next((run for run in self.runs if run.K == K), None)


@dataclass(frozen=True)
class Difference:
    """Rates of a variant minus its reference's over the same objects, class -> type, with 95 % intervals."""

    objects: int
    mean: dict[str, Rates]
    interval95: Bounds


def find_sweep(runs: Sequence[Run]) -> Sweep:
    """The largest group of runs that differ in K alone, and how the others differ from it.

    K = 1 makes no group larger. Of equal ones it is the group that the others differ least from, then the newest.

    Args:
        runs: oldest first; of runs with equal settings the last counts.
    """
    latest = {flat_settings(run): run for run in runs}
    groups: dict[Settings, dict[int, Run]] = defaultdict(dict)
    for settings, run in latest.items():
        groups[tuple(entry for entry in settings if entry[0] not in SWEPT)][run.K] = run
    main = max(groups, key=lambda key: (len(groups[key].keys() - {1}), -_apart(key, groups), _newest(groups[key])))
    swept = tuple(run for _, run in sorted(groups[main].items()))
    others = [run for key, group in groups.items() if key != main for run in group.values()]
    # A K that the paper does not have (K = 1) is an ablation, too.
    others += [run for run in swept if run.K not in paper.SUCCESS_RATE and len(swept) > 1]
    variants = [
        Variant(run, reference, _differences(run, reference)) for run in others if (reference := _nearest(swept, run))
    ]
    return Sweep(swept, tuple(sorted(variants, key=_order)))


def difference(
    variant: Sequence[ObjectRow], reference: Sequence[ObjectRow], ranking: str, resamples: int, seed: int
) -> Difference:
    """Paired difference of two runs by one ranking. Raises InputError where they share no object."""
    ours = {row.name: row for row in variant}
    shared = [(ours[row.name], row) for row in reference if row.name in ours]
    if not shared:
        raise InputError("expected objects of the run that it is compared with, got none of them")
    classes = [mine.category for mine, _ in shared]
    mine, theirs = ([pair[side].rates[ranking] for pair in shared] for side in (0, 1))
    mean, interval = paired_difference(classes, mine, theirs, resamples, seed)
    bounds = {category: {name: (low, high) for name, (low, high) in row.items()} for category, row in interval.items()}
    return Difference(len(shared), mean, bounds)


def flat_settings(run: Run) -> Settings:
    """Every setting that matters as (dotted key, text), sorted; K is the run's own."""
    entries = dict(flattened(run.settings, ""))
    kept = {
        key: value for key, value in entries.items() if key.split(".")[0] not in PROCESS and not key.startswith("cache")
    }
    return tuple(sorted((kept | {"K": str(run.K), "prototypes.num_clusters": str(run.K)}).items()))


def flattened(value: Any, key: str) -> list[tuple[str, str]]:
    """Nested settings as (dotted key, text), `key` before each."""
    if isinstance(value, Mapping):
        return [
            entry for name, inner in value.items() for entry in flattened(inner, f"{key}.{name}" if key else str(name))
        ]
    return [(key, f"{value:g}" if isinstance(value, float) else str(value))]


def _apart(settings: Settings, others: Iterable[Settings]) -> int:
    """In how many settings all the others differ from these together."""
    return sum(len(set(other) - set(settings)) for other in others)


def _newest(runs: Mapping[int, Run]) -> str:
    return max(run.stamp for run in runs.values())


def _nearest(swept: Sequence[Run], run: Run) -> Run | None:
    """The run of the sweep with this K, else the one with K = 20 or the nearest to it; never the run itself."""
    candidates = [other for other in swept if other is not run]
    same = [other for other in candidates if other.K == run.K]
    return min(same or candidates, key=lambda other: (abs(other.K - NOMINAL_K), other.K), default=None)


def _differences(run: Run, reference: Run) -> dict[str, tuple[str, str]]:
    mine, usual = dict(flat_settings(run)), dict(flat_settings(reference))
    keys = [key for key in sorted(mine.keys() | usual.keys()) if key != "prototypes.num_clusters"]
    return {key: (mine.get(key, "-"), usual.get(key, "-")) for key in keys if mine.get(key) != usual.get(key)}


def _order(variant: Variant) -> tuple[tuple[str, ...], tuple[tuple[float, str], ...], int]:
    """By what varies, then by its value: numbers as numbers."""
    return tuple(variant.varies), tuple(_number(value) for value, _ in variant.varies.values()), variant.run.K


def _number(value: str) -> tuple[float, str]:
    try:
        return float(value), ""
    except ValueError:
        return float("inf"), value
