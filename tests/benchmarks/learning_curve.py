"""CG of novel objects against seconds of simulation: uniform candidates, and those that a budget allots.

    python tests/benchmarks/learning_curve.py [trials=FOLDER] [hand=NAME] [seeds=0,1] [write=true] [picture=FILE]

A table is cut to the first candidates of each type on each object, as many for all objects (uniform) or as many as
`simulate budget=...` tries. That teaches; predicted on are the whole tables of objects that did not teach (five folds,
K = 20). Seconds are of processor: of a few trials of each kind, type and object, executed here, times their number.
"""

import spgf_torch  # noqa: F401  # before torch: it sets how its threads wait

# isort: split

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from shared.harness import Report, threads
from shared.paired import interval, words

from spgf_torch.cache import Cache
from spgf_torch.evaluation.folds import stratified_folds, stratified_order
from spgf_torch.evaluation.success import top_n
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.describe import Describer
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.experiment.learning import PrototypeFit
from spgf_torch.experiment.training_space import TrainingSpace
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import find, root
from spgf_torch.progress import ProgressReporter
from spgf_torch.settings import typed
from spgf_torch.simulation.allotment import allotted
from spgf_torch.simulation.table import OUTCOMES, TrialTable, read_table
from spgf_torch.simulation.worker import Trials, physics

UNIFORM, BUDGETS = (400, 250, 150, 100, 50), (150, 100, 50, 200)
SHOWN = (("uniform", 100), ("uniform", 250), ("budget", 50), ("budget", 150))  # as figures
TIMED = 4  # free trials of each type on each object
RANKING = "log_odds_free"  # the one that training folds choose most often
COLLISION = OUTCOMES.index("collision")
Rates = dict[str, np.ndarray]  # grasp type or CG -> (objects,)


@dataclass(frozen=True)
class Way:
    """How a table is cut: the first `count` candidates of each type, or as many as the budget `count` allots."""

    name: str
    count: int

    def candidates(self, table: TrialTable) -> int:
        """Of each type."""
        free = free_of(table)
        return min(self.count, free.shape[1]) if self.name == "uniform" else allotted(free, self.count)


def free_of(table: TrialTable) -> np.ndarray:
    """(types, candidates) bool."""
    return (table.outcome != COLLISION).numpy().reshape(len(table.grasp_types), -1)


@dataclass(frozen=True)
class Costs:
    """Seconds of processor on an object.

    Attributes:
        free, collision: (types,), of a trial that needs physics, and of one that does not; 0 where there is none.
        loading: of the object, for all types.
    """

    free: np.ndarray
    collision: np.ndarray
    loading: float

    @staticmethod
    def of(obj: GraspObject, table: TrialTable, trials: Trials) -> "Costs":
        """Measured on the first trials of both kinds, of each type."""
        start, free, T = time.process_time(), free_of(table), table.T_object_tcp.numpy()
        runs = [physics(obj, trials, name) for name in table.grasp_types]
        loading = time.process_time() - start

        def mean_seconds(code: int, its: np.ndarray) -> float:
            rows, start = np.flatnonzero(its)[:TIMED] + code * free.shape[1], time.process_time()
            for row in rows:
                runs[code](T[row])
            return (time.process_time() - start) / max(len(rows), 1)

        of_free, of_collision = (
            np.array([mean_seconds(code, its) for code, its in enumerate(which)]) for which in (free, ~free)
        )
        return Costs(of_free, of_collision, loading)

    def seconds(self, free: np.ndarray) -> float:
        """Of the trials `free` (types, candidates) and the others."""
        return float(free.sum(axis=1) @ self.free + (~free).sum(axis=1) @ self.collision + self.loading)


class Folds:
    """The objects described for one seed, and cross-validation with any part of their trials."""

    def __init__(self, config: TrainConfig, objects: Sequence[GraspObject], tables: Sequence[TrialTable]) -> None:
        self.config, self.tables = config, tables
        classes = [obj.category for obj in objects]
        fold, order = (of(classes, *more) for of, more in (
            (stratified_folds, (config.folds, config.seed)), (stratified_order, (config.seed,)),
        ))  # fmt: skip
        self.design = Design(fold, order, config.training_objects)
        cache = Cache.open(config.cache, config.cache_gb)
        rooms = (config.sensing, config.features, config.affordance, open_hand(config.hand))
        describer = Describer(*rooms, config.seed, config.device, cache, config.constellations)
        described = describer.describe(objects, tables, ProgressReporter())
        self.examples = [each.with_success(table.success) for each, table in zip(described, tables, strict=True)]
        fit = PrototypeFit(replace(config.prototypes, num_clusters=config.K), config.seed, cache)
        self.centres = {
            test: fit(torch.cat([self.examples[i].relations for i in self.design.training(test)]))
            for test in self.design.tests
        }

    def rates(self, way: Way) -> Rates:
        """Of each object, taught by the others' trials that `way` keeps."""
        teach = [self._kept(way, *pair) for pair in zip(self.examples, self.tables, strict=True)]
        found: dict[int, Mapping[str, float]] = {}
        for test, centres in self.centres.items():
            novel = self.design.novel(test)
            space = TrainingSpace([teach[i] for i in self.design.training(test)], centres, self.config.affordance)
            for i, scores in zip(novel, space.score_grasps([self.examples[i] for i in novel]), strict=True):
                of_table = self.tables[i].success.numpy(), self.tables[i].grasp_type.numpy()
                ranked = scores.by_ranking[RANKING].numpy()
                found[i] = top_n(ranked, *of_table, self.config.N, self.tables[i].grasp_types)
        return {name: np.array([found[i][name] for i in range(len(teach))]) for name in found[0]}

    @staticmethod
    def _kept(way: Way, example: DescribedObject, table: TrialTable) -> DescribedObject:
        each = len(table) // len(table.grasp_types)
        return example.of_grasps((torch.arange(len(table)) % each < way.candidates(table)).nonzero()[:, 0])


def settings_of(hand: str, seed: int) -> TrainConfig:
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        composed = compose("train", ["+K=20", f"hand={hand}", f"seed={seed}"])
    return typed(TrainConfig, OmegaConf.to_container(composed, resolve=True))


def draw(rows: Sequence[Mapping[str, float]], hand: str, file: Path) -> None:
    """CG over seconds, a line with intervals a way."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    for name in ("uniform", "budget"):
        its = sorted((row for row in rows if row["way"] == name), key=lambda row: row["seconds"])
        mean, low, high = (np.array([row[key] for row in its]) for key in ("CG", "low", "high"))
        seconds = [row["seconds"] for row in its]
        axes.errorbar(seconds, mean, [mean - low, high - mean], marker="o", capsize=3, label=name)
    axes.set(xlabel="seconds of processor", ylabel="CG of novel objects, %", title=hand)
    axes.legend()
    figure.savefig(file, dpi=120)


def main() -> None:
    given = dict(argument.split("=", 1) for argument in sys.argv[1:])
    hand, seeds = given.get("hand", "sdh2"), [int(seed) for seed in given.get("seeds", "0").split(",")]
    folder = find(given.get("trials", "data/trials"))
    objects = load_objects(root() / "data" / "objects")
    tables = [read_table(folder / f"{obj.name}.parquet") for obj in objects]
    most = tables[0].provenance.candidates
    report = Report("learning_curve", f"{hand}, {len(objects)} objects, {most} candidates a type, seeds {seeds}.")
    with threads(1):
        first = settings_of(hand, seeds[0])
        trials = Trials(load_hand(first.hand), first.episode)
        costs = [Costs.of(obj, table, trials) for obj, table in zip(objects, tables, strict=True)]
        folds = [Folds(settings_of(hand, seed), objects, tables) for seed in seeds]
        whole = None
        uniform = (most, *(n for n in UNIFORM if n < most))
        for way in [*(Way("uniform", n) for n in uniform), *(Way("budget", n) for n in BUDGETS)]:
            free = [free_of(table)[:, : way.candidates(table)] for table in tables]
            seconds = sum(cost.seconds(its) for cost, its in zip(costs, free, strict=True))
            rates = over_seeds(folds, way)
            whole = whole or rates
            mean, low, high = (100 * value for value in interval(rates["CG"]))
            types = {name: 100 * float(of.mean()) for name, of in rates.items() if name != "CG"}
            numbers = {"way": way.name, "count": way.count, "seconds": seconds, "physics": int(sum(map(np.sum, free)))}
            report.row(**numbers, CG=mean, low=low, high=high, **types)
            lost = words(rates["CG"] - whole["CG"], 100, 1)
            print(f"    minus the whole table's: {lost}")
            if (way.name, way.count) in SHOWN:
                what = "candidates of each type" if way.name == "uniform" else "trials an object by budget"
                report.figure(f"{hand}, {way.count} {what}: CG minus the whole table's", "", f"{lost}, {seconds:.0f} s")
    if "picture" in given:
        draw(report.rows, hand, Path(given["picture"]))
    if given.get("write") == "true":
        report.write()


def over_seeds(folds: Sequence[Folds], way: Way) -> Rates:
    """The mean over seeds of each object."""
    rates = [each.rates(way) for each in folds]
    return {name: np.mean([of[name] for of in rates], axis=0) for name in rates[0]}


if __name__ == "__main__":
    main()
