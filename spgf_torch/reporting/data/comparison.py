"""Descriptors and the learned baseline side by side: which runs belong together, their rates, differences and costs.

A row is a file of `conf/comparison`; a run belongs to the row whose settings it has. Rows of one comparison differ in
nothing else but in how many trials of each type an object teaches, and in the seed: those of several seeds are one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from spgf_torch.errors import InputError
from spgf_torch.evaluation.success import ALL, bootstrap_interval, class_means
from spgf_torch.files.reading import yaml_values
from spgf_torch.paths import find, root
from spgf_torch.reporting.config import CompareConfig
from spgf_torch.reporting.data.costs import Costs, costs_of
from spgf_torch.reporting.data.runs import Block, Bounds, Run, Tell, load_runs, read_per_object
from spgf_torch.reporting.data.seeds import Repeats, per_object, repeated
from spgf_torch.reporting.data.sweep import SEED, Difference, Settings, difference, flat_settings, flattened

BASELINE = "learned"  # the row of the runs of `spgf_torch.baseline`
TRIALS = "trials_per_object"
CLUSTERS = {"K", "prototypes.num_clusters"}


@dataclass(frozen=True)
class Entry:
    """A row at a number of trials.

    Attributes:
        trials: of each type, of each training object.
        rates, bounds: as fractions, with 95 % intervals over objects, and over seeds where there are several.
        change: minus the reference with as many trials, by the same objects and seeds; None of the reference itself.
        costs: of the run of the smallest seed.
    """

    name: str
    trials: int
    runs: Repeats
    rates: Block
    bounds: Bounds
    change: Difference | None
    costs: Costs


@dataclass(frozen=True)
class Comparison:
    """What is compared, by one ranking.

    Attributes:
        trials: the number that the table is about, the most of the reference if the settings do not say.
        entries: of the reference first, then by rate; of each row by trials.
        random, random_bounds: a candidate picked at random. ceiling: the best by outcome.
    """

    ranking: str
    reference: str
    trials: int
    entries: tuple[Entry, ...]
    random: Block
    random_bounds: Bounds
    ceiling: Block

    @property
    def types(self) -> tuple[str, ...]:
        """The grasp types, and CG."""
        return self.entries[0].runs.types

    @property
    def table(self) -> list[Entry]:
        """The entries with `trials` trials."""
        return [entry for entry in self.entries if entry.trials == self.trials]

    def curve(self, name: str) -> list[Entry]:
        """The entries of a row, by trials."""
        return [entry for entry in self.entries if entry.name == name]


def committed() -> dict[str, dict[str, str]]:
    """The files of `conf/comparison`: name -> (dotted key -> value as text)."""
    files = sorted((root() / "conf" / "comparison").glob("*.yaml"))
    return {path.stem: dict(flattened(yaml_values(path, "settings of a row"), "")) for path in files}


def find_rows(runs: Sequence[Run], config: CompareConfig, tell: Tell) -> dict[str, dict[int, Repeats]]:
    """Row -> trials -> runs, of the largest set of runs (oldest first) that differ in nothing else but the seed.

    Of equal sets it is the one of more runs, then the newest.

    Raises InputError where there is none of the reference.
    """
    configs = committed()
    if config.reference not in configs:
        raise InputError(f"reference: expected one of conf/comparison ({', '.join(configs)}), got {config.reference}")
    varied = {key for values in configs.values() for key in values} | {TRIALS, SEED} | CLUSTERS
    groups: dict[Settings, dict[str, dict[int, dict[int, Run]]]]
    groups = defaultdict(lambda: defaultdict(lambda: defaultdict(dict)))
    for run in runs:
        settings = dict(flat_settings(run))
        if (name := _row(run, settings, configs, config.K)) is not None:
            rest = tuple(entry for entry in settings.items() if entry[0] not in varied)
            groups[rest][name][run.settings[TRIALS]][run.seed] = run
    groups = {rest: rows for rest, rows in groups.items() if config.reference in rows}
    if not groups:
        raise InputError(
            f"runs: expected one of conf/comparison/{config.reference}.yaml with K = {config.K} "
            f"(python -m spgf_torch.train -m '+comparison=glob(*)'), got none among {len(runs)}"
        )
    rows = max(groups.values(), key=_size)
    if others := len(runs) - sum(len(of_seed) for of_row in rows.values() for of_seed in of_row.values()):
        tell(f"{others} of {len(runs)} runs are no rows of this comparison, or older ones of the same settings")
    lacking = [f"{name} ({n})" for name in configs for n in sorted(rows[config.reference]) if n not in rows[name]]
    if lacking:
        tell(f"not run, or not with as many trials as {config.reference}: {', '.join(lacking)}")
    draws = (config.bootstrap, config.seed, tell)
    return {
        name: {trials: repeated(list(of_seed.values()), *draws) for trials, of_seed in rows[name].items()}
        for name in configs
        if rows[name]
    }


def baseline_rows(config: CompareConfig, reference: Repeats, tell: Tell) -> dict[str, dict[int, Repeats]]:
    """Runs of the learned baseline on the objects, trials, folds and N of the reference; none where there are none."""
    first, seeds = reference.runs[0], {run.seed for run in reference.runs}
    if config.baseline is None or not find(str(config.baseline)).is_dir():
        tell(f"no row of the learned baseline: {config.baseline} is no folder (python -m spgf_torch.baseline)")
        return {}
    try:
        runs = load_runs(config.baseline, tell)
    except InputError as error:
        tell(f"no row of the learned baseline: {error}")
        return {}
    same = [run for run in runs if (run.dataset, run.N) == (first.dataset, first.N) and run.seed in seeds]
    if len(same) < len(runs):
        tell(f"{len(runs) - len(same)} runs of the learned baseline are of other objects, trials, N or seed: left out")
    found: dict[int, dict[int, Run]] = defaultdict(dict)
    for run in same:
        found[_count(run, first)][run.seed] = run
    draws = (config.bootstrap, config.seed, tell)
    rows = {trials: repeated(list(of_seed.values()), *draws) for trials, of_seed in found.items()}
    return {BASELINE: rows} if rows else {}


def compare(rows: Mapping[str, Mapping[int, Repeats]], config: CompareConfig, ranking: str, tell: Tell) -> Comparison:
    """Rates, differences and costs of every row by one ranking.

    Raises InputError where the reference has no run with the trials that the settings ask for, or no such ranking.
    """
    references = rows[config.reference]
    trials = config.trials_per_object or max(references)
    if trials not in references:
        known = ", ".join(map(str, sorted(references)))
        raise InputError(f"trials_per_object: expected one of {config.reference}'s runs ({known}), got {trials}")
    if ranking not in references[trials].by_ranking:
        known = ", ".join(references[trials].by_ranking)
        raise InputError(f"ranking: expected one of {known}; got {ranking}")
    entries = _entries(rows, config, ranking, tell)
    at_trials = {entry.name: entry.rates["all"][ALL] for entry in entries if entry.trials == trials}
    entries.sort(key=lambda e: (e.name != config.reference, -at_trials.get(e.name, 0.0), e.name, e.trials))
    chance, bounds = _chance(references[trials], config)
    return Comparison(ranking, config.reference, trials, tuple(entries), chance, bounds, references[trials].ceiling)


def _entries(rows: Mapping[str, Mapping[int, Repeats]], config: CompareConfig, ranking: str, tell: Tell) -> list[Entry]:
    """Every row with every number of trials; a run whose objects' rates cannot be read is told and left out."""
    spent = costs_of([run for of_row in rows.values() for runs in of_row.values() for run in runs.runs])
    entries = []
    for name, trials, runs in ((name, n, runs) for name, of_row in rows.items() for n, runs in of_row.items()):
        change, reference = None, rows[config.reference].get(trials)
        try:
            if ranking not in runs.by_ranking:
                raise InputError(f"expected rates by the ranking {ranking}, got {', '.join(runs.by_ranking)}")
            if reference is not None and reference is not runs:
                mine, theirs = per_object(runs, ranking), per_object(reference, ranking)
                change = difference(mine, theirs, ranking, config.bootstrap, config.seed)
        except InputError as error:
            tell(f"left out of the ranking {ranking}: {name}, {runs.runs[0].folder.name}: {error}")
            continue
        rates, bounds = runs.by_ranking[ranking], runs.interval95[ranking]
        entries.append(Entry(name, trials, runs, rates, bounds, change, spent[runs.runs[0].stamp]))
    return entries


def _chance(runs: Repeats, config: CompareConfig) -> tuple[Block, Bounds]:
    """Rates of a candidate picked at random, with intervals over objects: the same whatever the seed."""
    run = runs.runs[0]
    objects = read_per_object(replace(run, by_ranking={"random": run.random}))
    classes, rates = [row.category for row in objects], [row.rates["random"] for row in objects]
    interval = bootstrap_interval(classes, rates, config.bootstrap, config.seed)
    bounds = {category: {name: (low, high) for name, (low, high) in row.items()} for category, row in interval.items()}
    return class_means(classes, rates), bounds


def _row(run: Run, settings: Mapping[str, str], configs: Mapping[str, Mapping[str, str]], K: int) -> str | None:
    """The row whose settings the run has, the one that says most; rows that do not say K have `K`."""
    if not isinstance(run.settings.get(TRIALS), int):
        return None
    fitting = [
        name
        for name, values in configs.items()
        if all(settings.get(key) == value for key, value in {"K": str(K), **values}.items())
    ]
    return max(fitting, key=lambda name: len(configs[name]), default=None)


def _size(rows: Mapping[str, Mapping[int, Mapping[int, Run]]]) -> tuple[int, int, str]:
    runs = [run for of_row in rows.values() for of_seed in of_row.values() for run in of_seed.values()]
    return sum(map(len, rows.values())), len(runs), max(run.stamp for run in runs)


def _count(run: Run, reference: Run) -> int:
    """Trials of each type that an object teaches; a run that does not say has those of the reference."""
    count = run.settings.get(TRIALS)
    return count if isinstance(count, int) else reference.settings[TRIALS]
