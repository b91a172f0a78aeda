"""What more drawn objects buy: CG on objects that did not teach, over how many drawn ones teach, and what that costs.

    python tests/benchmarks/more_objects.py FOLDER [counts=50,200,1000] [scans=FOLDER] [write=true] [picture=FILE]

In FOLDER are the objects and trials that teach, and others of the same families to predict on:

    python -m spgf_torch.generate count=1000 seed=0 out=FOLDER/objects
    python -m spgf_torch.simulate objects=FOLDER/objects episode=fast budget=20 out=FOLDER/trials
    python -m spgf_torch.generate count=94 seed=1 out=FOLDER/novel
    python -m spgf_torch.simulate objects=FOLDER/novel episode=fast candidates=60 out=FOLDER/novel_trials

The first COUNT objects in the order of drawing teach: each smaller set is part of the larger ones. Predicted on are the
objects of FOLDER/novel, once by all of these and once without their own kind (`KINDS`), the 50 of data/objects with the
whole of data/trials, and scans, if asked for, with a thousand sampled candidates of each type, the best of which are
executed. Prototypes are learned on the fewest objects alone: shapes need few (docs/EXPERIMENTS.md), and what is asked
here is what trials on more objects teach. SDH-2, K = 20, seed 0, one thread. Seconds are of processor.
"""

import spgf_torch  # before torch: it sets how its threads wait
import spgf_torch.prototypes.lightning_module  # noqa: F401  # seconds that are not those of learning

# isort: split

import resource
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from learning_curve import RANKING, free_of, settings_of
from omegaconf import OmegaConf
from shared.harness import Report, threads
from shared.paired import interval, words
from torch import Tensor

from spgf_torch.cache import Cache
from spgf_torch.evaluation.success import ceiling, random_rate, top_n
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.experiment.describe import Describer, Grasps
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.execution import candidate_grasps, execute_best
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.experiment.learning import PrototypeFit
from spgf_torch.experiment.training_space import TrainingSpace
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.families import read_families, turns
from spgf_torch.objects.folders import read_objects
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_object, load_objects
from spgf_torch.paths import find, root
from spgf_torch.progress import ProgressReporter
from spgf_torch.settings import typed
from spgf_torch.simulation.config import samplers_of
from spgf_torch.simulation.table import TrialTable, read_table, table_path
from spgf_torch.simulation.worker import Trials

SEED, RANGES = 0, "conf/sizes/household.yaml"  # of the objects that teach
# What looks alike is held out together: a mug is no novelty to who knows cups. Our own grouping, by shape and use.
KINDS = {
    "with a handle": "mug mug_steel cup jug pan",
    "round vessels": "bowl bowl_closed vase flowerpot jar tumbler tub ramekin",
    "angular vessels": "bin basket dish pot_square canister",
    "boxes": "book carton_tall carton_milk carton_tea carton_flat carton_small brick sponge soap box_lunch tin "
    "detergent",
    "round packages": "can_drink can_food can_spray bottle bottle_oval bottle_waist tube_card candle bulb torch",
    "fruit and balls": "ball citrus potato apple pear egg banana",
}


@dataclass
class Set:
    """Objects of which trials are known, by object.

    Attributes:
        kinds: of drawn objects their kind, of others "".
        examples: as the learner sees them.
    """

    objects: list[GraspObject]
    tables: list[TrialTable]
    kinds: list[str]
    examples: list[DescribedObject]

    def first(self, count: int) -> "Set":
        """The first objects."""
        return Set(*(getattr(self, field.name)[:count] for field in fields(self)))

    def but(self, kind: str) -> list[DescribedObject]:
        """Of all but one kind."""
        return [each for each, its in zip(self.examples, self.kinds, strict=True) if its != kind]

    def rates(self, space: TrainingSpace, which: Sequence[int], n: int) -> np.ndarray:
        """CG of some of the objects."""
        found = space.score_grasps([self.examples[i] for i in which])
        pairs = zip(found, [self.tables[i] for i in which], strict=True)
        return np.array([_best(scores.by_ranking[RANKING].numpy(), table, n) for scores, table in pairs])

    def random(self) -> np.ndarray:
        """The random rate of each object."""
        rows = [(table.success.numpy(), table.grasp_type.numpy(), table.grasp_types) for table in self.tables]
        return np.array([random_rate(*row)["CG"] for row in rows])

    def ceiling(self, n: int) -> float:
        """The best CG that any ranking could have, %: objects with fewer than n successes have less than all."""
        rows = [(table.success.numpy(), table.grasp_type.numpy(), n, table.grasp_types) for table in self.tables]
        return 100 * float(np.mean([ceiling(*row)["CG"] for row in rows]))


def _best(ranked: np.ndarray, table: TrialTable, n: int) -> float:
    return top_n(ranked, table.success.numpy(), table.grasp_type.numpy(), n, table.grasp_types)["CG"]


@dataclass
class Scans:
    """Scanned objects with sampled candidates, which nobody has tried yet."""

    config: EvaluateConfig
    objects: list[GraspObject]
    grasps: list[Grasps]
    examples: list[DescribedObject]
    random: np.ndarray | None = None

    def rates(self, space: TrainingSpace) -> tuple[np.ndarray, np.ndarray]:
        """CG of each object, and its random rate: executed, the random ones once."""
        scores = [scores.by_ranking[RANKING] for scores in space.score_grasps(self.examples)]
        trials, first = Trials(load_hand(self.config.hand), self.config.episode), self.random is None
        config = self.config if first else replace(self.config, random_trials=0)
        ran = execute_best(self.objects, self.grasps, scores, trials, config, ProgressReporter())["sapien"]
        if first:
            self.random = np.array([each.rate(torch.cat(list(each.random.values()))) for each in ran])
        return np.array([each.rate(each.best["CG"]) for each in ran]), self.random


class Bench:
    """All objects, described as they are needed, and what any of them teach."""

    def __init__(self, folder: Path, most: int) -> None:
        self.folder, self.config, self.cache = folder, settings_of("sdh2", 0), Cache(None)
        self.describer = describer_of(self.config)
        self.fit = PrototypeFit(
            replace(self.config.prototypes, num_clusters=self.config.K), self.config.seed, self.cache
        )
        families = list(read_families(find(RANGES)))
        drawn = list(turns(families, most, SEED))
        self.names = [f"{family}_{SEED}_{number:04d}" for family, number in drawn]
        self.teaching = Set([], [], [], [])
        self.centres: dict[str, Tensor] = {}

    def described(self, objects: list[GraspObject], tables: list[TrialTable], drawn: bool = True) -> Set:
        kinds = [kind_of(obj.name) if drawn else "" for obj in objects]
        examples = self.describer.describe(objects, tables, ProgressReporter())
        tried = [each.with_success(table.success) for each, table in zip(examples, tables, strict=True)]
        return Set(objects, tables, kinds, tried)

    def teach(self, count: int) -> Set:
        """The first `count` drawn objects; those that are there already are not described again."""
        names = self.names[len(self.teaching.objects) : count]
        objects = [load_object(self.folder / "objects" / f"{name}.yaml") for name in names]
        more = self.described(objects, [read_table(table_path(self.folder / "trials", name)) for name in names])
        for field in fields(Set):
            getattr(self.teaching, field.name).extend(getattr(more, field.name))
        return self.teaching.first(count)

    def tested(self, objects: Path, trials: Path, drawn: bool) -> Set:
        """Objects to predict on."""
        found = load_objects(objects)
        return self.described(found, [read_table(table_path(trials, obj.name)) for obj in found], drawn)

    def learned(self, taught: Set, but: str = "") -> TrainingSpace:
        """What these objects teach, but those of one kind."""
        examples = taught.but(but)
        if but not in self.centres:  # by the fewest objects, which come first
            self.centres[but] = self.fit(torch.cat([each.relations for each in examples]))
        return TrainingSpace(examples, self.centres[but], self.config.affordance)


def describer_of(config: TrainConfig | EvaluateConfig) -> Describer:
    """With nothing kept, so that what describing costs is measured."""
    own = settings_of("sdh2", 0)
    return Describer(config.sensing, own.features, own.affordance, open_hand(config.hand), config.seed)


def kind_of(name: str) -> str:
    family = name.rsplit("_", 2)[0]
    return next(kind for kind, families in KINDS.items() if family in families.split())


def scans_of(folder: str) -> Scans:
    asked = [f"objects={find(folder)}", "model=none", "candidates=sampled", "workers=1", "random_trials=20"]
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        config = typed(EvaluateConfig, OmegaConf.to_container(compose("evaluate", asked), resolve=True))
    found, samplers = read_objects(config, ProgressReporter()).objects, samplers_of(config.hand)
    grasps = [candidate_grasps(obj, config.samples, config.sampler, config.seed, samplers) for obj in found]
    return Scans(config, found, grasps, describer_of(config).describe(found, grasps, ProgressReporter()))


class Curve:
    """CG by what is predicted on and by how many teach."""

    def __init__(self, report: Report) -> None:
        self.report, self.CG = report, dict[str, dict[int, np.ndarray]]()

    def point(self, on: str, count: int, teach: int, rates: np.ndarray, random: np.ndarray) -> None:
        """A row, and the difference to the fewest that teach."""
        mean, low, high = (100 * value for value in interval(rates))
        its = self.CG.setdefault(on, {})
        its[count] = rates
        numbers = {"on": on, "objects": len(rates), "count": count, "teach": teach}
        self.report.row(**numbers, CG=mean, low=low, high=high, random=100 * float(random.mean()))
        if (fewest := min(its)) != count:
            difference = words(rates - its[fewest], 100, 1)
            self.report.figure(f"CG on {on}: {count} objects teach, minus {fewest}", "", difference)

    def kinds(self, bench: Bench, taught: Set, novel: Set) -> None:
        """Each kind by the others."""
        count, rates, random = len(taught.objects), np.zeros(len(novel.objects)), novel.random()
        teach = []
        for kind in KINDS:
            its = [i for i, own in enumerate(novel.kinds) if own == kind]
            rates[its] = novel.rates(bench.learned(taught, but=kind), its, bench.config.N)
            teach.append(len(taught.but(kind)))
            mean, by_chance = 100 * rates[its].mean(), 100 * random[its].mean()
            print(f"    {kind}: {mean:.1f} by {teach[-1]} others, random {by_chance:.1f}", flush=True)
        self.point("drawn, kind held out", count, round(float(np.mean(teach))), rates, random)

    def draw(self, file: Path) -> None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.5, 4), layout="constrained")
        axes, rows = figure.add_subplot(), [row for row in self.report.rows if "on" in row]
        for number, on in enumerate(dict.fromkeys(row["on"] for row in rows)):
            its = [row for row in rows if row["on"] == on]
            mean, low, high = (np.array([row[key] for row in its]) for key in ("CG", "low", "high"))
            x, colour = [row["count"] * 1.03**number for row in its], f"C{number}"
            axes.errorbar(x, mean, [mean - low, high - mean], marker="o", capsize=3, color=colour, label=on)
            axes.plot(x, [row["random"] for row in its], ":", color=colour)
        axes.set(xscale="log", xlabel="drawn objects", ylabel="CG, % (dotted: random candidates)")
        axes.set_xticks(counts := sorted({row["count"] for row in rows}), map(str, counts))
        axes.minorticks_off()
        axes.legend(loc="center", bbox_to_anchor=(0.5, 0.4))
        figure.savefig(file, dpi=120)


def costs(bench: Bench, taught: Set, space: TrainingSpace, describing: float, learning: float) -> Mapping[str, float]:
    """What teaching took: trials, bytes of tables and of the model, seconds of processor, memory so far."""
    files = [table_path(bench.folder / "trials", obj.name).stat().st_size for obj in taught.objects]
    condensed = vars(space.model().condensed).values()
    return {
        "trials": sum(map(len, taught.tables)),
        "physics": sum(int(free_of(table).sum()) for table in taught.tables),
        "tables_MB": sum(files) / 1e6,
        "describing_s": describing,
        "learning_s": learning,
        "model_MB": sum(column.nbytes for column in condensed) / 1e6,
        "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }


def main() -> None:
    if len(sys.argv) < 2:
        print("more_objects.py: not measured: expected a folder of drawn objects and their trials, got none")
        return
    folder, given = Path(sys.argv[1]), dict(argument.split("=", 1) for argument in sys.argv[2:])
    counts = sorted(int(count) for count in given.get("counts", "50,200,1000").split(","))
    with threads(1):
        bench = Bench(folder, max(counts))
        report = Report(
            "more_objects", f"SDH-2, K = {bench.config.K}, seed 0; drawn objects teach, the first {counts}."
        )
        curve, describing = Curve(report), 0.0
        novel = bench.tested(folder / "novel", folder / "novel_trials", drawn=True)
        ours = bench.tested(root() / "data/objects", root() / "data/trials", drawn=False)
        for on, its in (("drawn", novel), ("data/objects", ours)):
            report.figure(f"CG on {on}, best possible", "", f"{its.ceiling(bench.config.N):.1f}")
        scans = scans_of(given["scans"]) if "scans" in given else None
        for count in counts:
            start = time.process_time()
            taught = bench.teach(count)
            describing += (described := time.process_time()) - start
            space = bench.learned(taught)
            learning = time.process_time() - described
            for on, its in (("drawn, families known", novel), ("data/objects", ours)):
                rates = its.rates(space, range(len(its.objects)), bench.config.N)
                curve.point(on, count, count, rates, its.random())
            if scans is not None:
                curve.point("scans", count, count, *scans.rates(space))
            report.row(count=count, **costs(bench, taught, space, describing, learning))
            del space
            curve.kinds(bench, taught, novel)
    if "picture" in given:
        curve.draw(Path(given["picture"]))
    if given.get("write") == "true":
        report.write()


if __name__ == "__main__":
    main()
