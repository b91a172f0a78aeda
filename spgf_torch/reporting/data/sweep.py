"""What belongs together: seeds of one experiment, the sweep over K that the table shows, ablations beside it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.seeds import interval_over_seeds, mean_over_seeds
from spgf_torch.evaluation.success import Rates
from spgf_torch.reporting.data.runs import Bounds, Run, Tell
from spgf_torch.reporting.data.seeds import OfSeeds, Repeats, of_objects, repeated

# Settings that do not change what a run's rates mean: where data stand, how it is computed, what is shown.
PROCESS = {"objects", "trials", "device", "workers", "ranking", "bootstrap", "final_model", "fold_models"}
SWEPT = {"K", "prototypes.num_clusters"}
SEED = "seed"
REACH = "affordance.reach"  # m: how far from a grasp a feature may vote for it
CLASSWISE = "classwise"
OLDER = {CLASSWISE: "False"}  # what runs that do not say had
NOMINAL_K = 20  # the paper's best combined result: what an ablation is compared with where its own K was not run

Settings = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Variant:
    """An experiment beside the sweep: what it varies, and the row of the sweep that it is compared with.

    Attributes:
        varies: setting -> (its value here, the sweep's), both as text; "-" where a run has no such setting.
    """

    runs: Repeats
    reference: Repeats
    varies: dict[str, tuple[str, str]]

    @property
    def label(self) -> str:
        """What varies, in words: `features.layers = 1 (2)`; of more than two settings the first, and how many more."""
        told = [f"{key} = {value} ({usual})" for key, (value, usual) in self.varies.items()]
        return ", ".join(told) if len(told) <= 2 else f"{told[0]} and {len(told) - 1} more"


@dataclass(frozen=True)
class Sweep:
    """Experiments that differ in K alone, by K; and the others of the same data."""

    rows: tuple[Repeats, ...]
    variants: tuple[Variant, ...]

    def of(self, K: int) -> Repeats | None:
        return next((row for row in self.rows if row.K == K), None)

    def by_reach(self) -> dict[float, tuple[Repeats, ...]]:
        """How far features vote (m) -> the experiments that differ from the sweep in that and in K alone, by K."""
        beside = [variant.runs for variant in self.variants if REACH in variant.varies.keys() <= {REACH, "K"}]
        found: dict[float, dict[int, Repeats]] = defaultdict(dict)
        for runs in (*self.rows, *beside):
            text = dict(flat_settings(runs.runs[0])).get(REACH)
            if text is not None:
                found[float(text)][runs.K] = runs
        return {reach: tuple(runs for _, runs in sorted(of.items())) for reach, of in sorted(found.items())}

    def classwise(self) -> tuple[Repeats, ...]:
        """The experiments that differ from the sweep in that each class was learned by itself, and in K, by K."""
        alone = [variant.runs for variant in self.variants if CLASSWISE in variant.varies.keys() <= {CLASSWISE, "K"}]
        return tuple(sorted(alone, key=lambda runs: runs.K))


@dataclass(frozen=True)
class Difference:
    """Rates of a variant minus its reference's over the same seeds and objects, class -> type, with 95 % intervals."""

    objects: int
    seeds: int
    mean: dict[str, Rates]
    interval95: Bounds


def find_sweep(runs: Sequence[Run], resamples: int, seed: int, tell: Tell) -> Sweep:
    """The largest group of runs that differ in K and seed alone, and how the others differ from it.

    K = 1 makes no group larger. Of equal ones it is the group that the others differ least from, then the one of more
    runs, then the newest.

    Args:
        runs: oldest first; of runs with equal settings the last counts, of those that kept the models of their folds if
            there are any.
        resamples, seed, tell: see `repeated`.
    """
    latest = {flat_settings(run): run for run in sorted(runs, key=lambda run: run.keeps_folds)}
    groups: dict[Settings, dict[int, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for settings, run in latest.items():
        groups[tuple(entry for entry in settings if entry[0] not in SWEPT | {SEED})][run.K].append(run)
    main = max(groups, key=lambda key: (len(groups[key].keys() - {1}), -_apart(key, groups), *_size(groups[key])))
    joined = {
        key: [repeated(members, resamples, seed, tell) for _, members in sorted(group.items())]
        for key, group in groups.items()
    }
    swept = tuple(joined.pop(main))
    others = [row for group in joined.values() for row in group]
    # A K that the paper does not have (K = 1) is an ablation, too.
    others += [row for row in swept if row.K not in paper.SUCCESS_RATE and len(swept) > 1]
    variants = [
        Variant(row, reference, _differences(row, reference)) for row in others if (reference := _nearest(swept, row))
    ]
    return Sweep(swept, tuple(sorted(variants, key=_order)))


def difference(variant: OfSeeds, reference: OfSeeds, ranking: str, resamples: int, seed: int) -> Difference:
    """Difference of two experiments by one ranking, paired by seed and object, with 95 % intervals over both.

    Raises InputError where they share no seed or no object.
    """
    seeds = sorted(variant.keys() & reference.keys())
    if not seeds:
        raise InputError("expected a seed of the runs that it is compared with, got none of them")
    paired = {("mine", s): variant[s] for s in seeds} | {("theirs", s): reference[s] for s in seeds}
    classes, rates = of_objects(paired, ranking)
    if not classes:
        raise InputError("expected objects of the run that it is compared with, got none of them")
    changes = [
        [{kind: a[kind] - b[kind] for kind in a} for a, b in zip(mine, theirs, strict=True)]
        for mine, theirs in zip(rates[: len(seeds)], rates[len(seeds) :], strict=True)
    ]
    interval = interval_over_seeds(classes, changes, resamples, seed)
    return Difference(len(classes), len(seeds), mean_over_seeds(classes, changes), interval)


def flat_settings(run: Run) -> Settings:
    """Every setting that matters as (dotted key, text), sorted; K and the seed are the run's own."""
    entries = OLDER | dict(flattened(run.settings, ""))
    kept = {
        key: value for key, value in entries.items() if key.split(".")[0] not in PROCESS and not key.startswith("cache")
    }
    own = {"K": str(run.K), "prototypes.num_clusters": str(run.K), SEED: str(run.seed)}
    return tuple(sorted((kept | own).items()))


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


def _size(group: Mapping[int, Sequence[Run]]) -> tuple[int, str]:
    """How many runs, and when the newest was started."""
    runs = [run for members in group.values() for run in members]
    return len(runs), max(run.stamp for run in runs)


def _nearest(swept: Sequence[Repeats], row: Repeats) -> Repeats | None:
    """The row of the sweep with this K, else the one with K = 20 or the nearest to it; never the row itself."""
    candidates = [other for other in swept if other is not row]
    same = [other for other in candidates if other.K == row.K]
    return min(same or candidates, key=lambda other: (abs(other.K - NOMINAL_K), other.K), default=None)


def _differences(row: Repeats, reference: Repeats) -> dict[str, tuple[str, str]]:
    mine, usual = dict(flat_settings(row.runs[0])), dict(flat_settings(reference.runs[0]))
    keys = [key for key in sorted(mine.keys() | usual.keys()) if key not in ("prototypes.num_clusters", SEED)]
    return {key: (mine.get(key, "-"), usual.get(key, "-")) for key in keys if mine.get(key) != usual.get(key)}


def _order(variant: Variant) -> tuple[tuple[str, ...], tuple[tuple[float, str], ...], int]:
    """By what varies, then by its value: numbers as numbers."""
    return tuple(variant.varies), tuple(_number(value) for value, _ in variant.varies.values()), variant.runs.K


def _number(value: str) -> tuple[float, str]:
    try:
        return float(value), ""
    except ValueError:
        return float("inf"), value
