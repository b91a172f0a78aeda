"""Where SPGF helps a judge of grasp hypotheses: what lies behind, shapes at the pads, more hypotheses, few trials.

    python tests/benchmarks/where_spgf_helps.py judge=RUN cache=FOLDER [objects=data/objects] [trials=data/trials]
        [execute=true] [write=true]

RUN is a folder that `python -m spgf_torch.judge` left, FOLDER its cache of trials (outputs/cache): what is in it is not
tried again. Everything is cross-validated over objects with the folds of the judge; prototypes, profiles and votes are
learned from the same training objects as the judge that gets them. Intervals are bootstraps over objects, differences
are paired. `docs/WHERE_SPGF_HELPS.md` says what the names mean and what was found.
"""

import spgf_torch  # noqa: F401  # before torch: it sets how its threads wait

# isort: split

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from shared.executed import VOTES, chosen_in, executed, offers, table, with_votes
from shared.harness import Report
from shared.paired import scores, words
from shared.spgf_numbers import Described, Shapes, describe, of_rows, prototypes
from shared.tried_rows import Tried, few, tried_with
from shared.votes_beside import examples, votes
from torch import Tensor

from spgf_torch.evaluation.folds import stratified_order
from spgf_torch.judging.learning import fit, weights
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.tree_ensembles import Form

# Name -> what a judge gets beside its own numbers, and what it is compared with: the judge, and controls without SPGF.
SETS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "judge": ((), ()),
    "depth": (("depth",), ("judge",)),
    "frame": (("frame",), ("judge", "depth")),
    "behind": (("behind",), ("judge", "depth", "frame")),
    "true": (("true",), ("judge",)),
    "curvature": (("curvature",), ("judge",)),
    "shares": (("shares",), ("judge", "curvature")),
    "bent_pairs": (("bent_pairs",), ("judge",)),
    "pairs": (("pairs",), ("judge", "bent_pairs", "curvature")),
    "votes": (("votes",), ("judge",)),
}
# Learning curves: share of each object's trials, training objects (None: all), and the sets that are compared there.
FEW = ((0.1, None), (1.0, 5), (0.2, None), (1.0, 10), (0.5, None), (1.0, 20))
WITH_FEW = ("judge", "behind", "curvature", "shares", "pairs", "votes")
# Sets whose best hypotheses are executed; "true" knows the mesh: the most that (a) could give.
EXECUTED = ("judge", "depth", "behind", "true", "curvature", "shares", "bent_pairs", "pairs")
BEST = 10


@dataclass(frozen=True)
class Fold:
    """What the training objects of one fold taught: shapes, numbers of all rows, set -> P(free), P(holds | free)."""

    shapes: Shapes
    numbers: Mapping[str, Tensor]
    factors: Mapping[str, tuple[Form, Form]]

    def probability(self, name: str, numbers: Tensor, added: Mapping[str, Tensor]) -> Tensor:
        """(H, 2) f64 P(free), P(holds | free) by a set, of hypotheses with a judge's numbers (H, 31) and the others."""
        x = torch.cat([numbers, *(added[key] for key in SETS[name][0])], dim=1)
        return torch.stack([form.log_odds(x).sigmoid() for form in self.factors[name]], dim=1)


def learn(made: Tried, clouds: Sequence[Described], taught: Tensor, names: Sequence[str], share: float = 1.0) -> Fold:
    """From the objects of the mask (objects,) and a share of the trials."""
    enough = few(made, share)
    shapes = Shapes(made, clouds, prototypes(made, clouds, taught), taught, enough)
    numbers = of_rows(clouds, [shapes.numbers(cloud) for cloud in clouds])
    if "votes" in names:
        numbers["votes"] = votes(made, clouds, shapes.centres, taught, examples(made, clouds, share))
    at = enough & taught[made.rows.obj]
    rows = made.rows.at(at)
    weight, every = weights(rows), torch.ones_like(rows.free)
    factors = {}
    for name in names:
        x = torch.cat([rows.numbers, *(numbers[key][at] for key in SETS[name][0])], dim=1)
        targets = ((every, rows.free), (rows.free, rows.success))
        free, holds = (fit(x[among], label[among], weight[among], made.config) for among, label in targets)
        factors[name] = (free, holds)
    return Fold(shapes, numbers, factors)


def judged(made: Tried, folds: Mapping[int, Fold], names: Sequence[str]) -> dict[str, Tensor]:
    """Set -> (R, 2) what judges say of rows whose object they have not seen."""
    found = {name: torch.zeros(len(made.rows), 2, dtype=torch.float64) for name in names}
    for held_out, fold in folds.items():
        at = made.folds == held_out
        for name in names:
            added = {key: fold.numbers[key][at] for key in SETS[name][0]}
            found[name][at] = fold.probability(name, made.rows.numbers[at], added)
    return found


def compare(made: Tried, said: Mapping[str, Tensor], report: Report, **about: object) -> None:
    """A row for each set and kind of cloud: its scores on tried hypotheses, and differences to what it adds to."""
    rows = made.rows
    views = torch.tensor([[c.views for c in b.clouds] for b in made.benches])[rows.obj, rows.cloud.clamp(min=0)]
    for kind in sorted(set(views.tolist())):
        at = made.own & (views == kind)
        where = (rows.obj[at].numpy(), rows.cloud[at].numpy())
        by_set = {
            name: scores(p[at].prod(1).numpy(), rows.success[at].numpy(), *where, BEST) for name, p in said.items()
        }
        free = {name: scores(p[at, 0].numpy(), rows.free[at].numpy(), *where, BEST) for name, p in said.items()}
        by_set = {name: {**its, "free": free[name]["log_loss"]} for name, its in by_set.items()}
        for name, its in by_set.items():
            row = {"hand": made.config.hand.name, **about, "views": kind, "set": name}
            report.row(**row, **{score: float(np.nanmean(value)) for score, value in its.items()})
            for other in (other for other in SETS[name][1] if other in by_set):
                more = {score: words(value - by_set[other][score]) for score, value in its.items()}
                report.row(**row, against=other, **more)


def behind_alone(made: Tried, clouds: Sequence[Described], folds: Mapping[int, Fold], report: Report) -> None:
    """How well unseen points of held-out objects are told solid: by depth, SPGF frame, prototype and frame."""
    said: dict[tuple[int, str], list[tuple[Tensor, Tensor, int]]] = {}
    for cloud in clouds:
        shapes = folds[int(made.fold[cloud.obj])].shapes
        ids, views = cloud.prototype(shapes.centres), made.benches[cloud.obj].clouds[cloud.number].views
        same = torch.zeros_like(ids)
        its = {"depth": shapes.one.solid(cloud, same), "frame": shapes.frame.solid(cloud, same)}
        for name, p in {**its, "behind": shapes.local.solid(cloud, ids)}.items():
            said.setdefault((views, name), []).append((p, cloud.hidden.solid, cloud.obj))
    for views in sorted({views for views, _ in said}):
        by_set = {}
        for name in ("depth", "frame", "behind"):
            parts = [part for part in said[views, name] if len(part[0])]
            p, solid = (torch.cat([part[i] for part in parts]).numpy() for i in (0, 1))
            obj = np.repeat([part[2] for part in parts], [len(part[0]) for part in parts])
            by_set[name] = scores(p, solid, obj, np.zeros_like(obj), BEST)
            row = {"hand": made.config.hand.name, "views": views, "solid": name}
            report.row(**row, **{score: float(np.nanmean(by_set[name][score])) for score in ("log_loss", "auc")})
            for other in list(by_set)[:-1]:
                more = {score: words(by_set[name][score] - by_set[other][score]) for score in ("log_loss", "auc")}
                report.row(**row, against=other, **more)


def with_few(made: Tried, clouds: Sequence[Described], report: Report, stages: ProgressReporter) -> None:
    """Learning curves: a share of the trials of each object, or few training objects."""
    order = torch.from_numpy(stratified_order([b.obj.category for b in made.benches], made.config.seed).copy())
    fold = torch.from_numpy(made.fold)
    with stages.stage("few", len(FEW) * made.config.folds, "folds") as advance:
        for share, most in FEW:
            folds = {}
            for held_out in range(made.config.folds):
                teachers = order[fold[order] != held_out][:most]
                taught = torch.zeros(len(fold), dtype=torch.bool).index_fill_(0, teachers, True)
                folds[held_out] = learn(made, clouds, taught, WITH_FEW, share)
                advance(1)
            few_trials = round(share * made.config.candidates)
            compare(made, judged(made, folds, WITH_FEW), report, trials=few_trials, objects=most or int(taught.sum()))


def try_best(made: Tried, clouds: Sequence[Described], folds: Mapping[int, Fold], report: Report) -> None:
    """Executes the best of each cloud by each set, and with the votes' hypotheses."""
    more, offered = with_votes(made, clouds, folds)
    chosen = chosen_in(made, clouds, folds, EXECUTED) + more
    against = {name: others for name, (_, others) in SETS.items()} | {VOTES: ("judge",)}
    for row in table(made, chosen, executed(made, chosen), against):
        report.row(hand=made.config.hand.name, **row)
        if row["objects"] == "all" and "more_than_judge" in row:
            figure = f"{made.config.hand.name}, views {row['views']}, ten best executed: {row['way']} minus judge"
            report.figure(figure, "> 0", row["more_than_judge"])
    for row in offers(made, offered):
        report.row(hand=made.config.hand.name, **row)


def main() -> None:
    given = dict(argument.split("=", 1) for argument in sys.argv[1:])
    places = [given.get(key, f"data/{key}") for key in ("objects", "trials")]
    made = tried_with(find(given["judge"]), Path(given["cache"]), *places)
    hand, stages = made.config.hand.name, ProgressReporter()
    report = Report("where_spgf_helps", f"{hand}: a judge with and without what SPGF tells, on held-out objects.")
    with stages.stage("shapes", len(made.benches), "objects") as advance:
        clouds = describe(made, advance)
    fold, names = torch.from_numpy(made.fold), tuple(SETS)
    with stages.stage("learning", made.config.folds, "folds") as advance:
        folds = {}
        for held_out in range(made.config.folds):
            folds[held_out] = learn(made, clouds, fold != held_out, names)
            advance(1)
    behind_alone(made, clouds, folds, report)
    compare(made, judged(made, folds, names), report)
    if given.get("execute") == "true":
        try_best(made, clouds, folds, report)
    if given.get("few", "true") == "true":
        with_few(made, clouds, report, stages)
    if given.get("write") == "true":
        report.write()


if __name__ == "__main__":
    main()
