"""Who proposes grasps that hold: a judge, its peers, a simple heuristic and chance, on the same clouds, all executed.

    python tests/benchmarks/peers.py objects=FOLDER judge=FOLDER [model=FOLDER] [cgn=PYTHON]
        [views=1,4] [place=table|alone] [seeds=0] [write=true]

Each object of the folder is sensed by one camera and by four, on a table (place=table) or alone, once with each seed;
each method ranks grasps for that cloud, and SAPIEN tries the ten best. Missing grasps count as failures.

- judge, antipodal: ours, and our baseline without learning, from the same hypotheses; random: these in random order.
- votes: `proposing.propose` with `model`, of the same hand.
- Contact-GraspNet: as it ranks, and, as "free", without what our collision filter knows to collide; where `cgn` is the
  Python that has it (`spgf_torch/clearing/contact_graspnet.py` says how) and the hand is the Panda.

The hand is the judge's. Seconds are of the processor for a cloud, on one thread, without sensing. Intervals are 95 %
bootstraps over objects, of each the mean over seeds; differences are paired.
"""

import spgf_torch  # noqa: F401  # before torch: it sets how its threads wait

# isort: split

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import torch
from shared.harness import Report
from shared.ranking import JUDGE, NETWORK, SCORES, Sensed, Timed, peers, rank
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig, grasp_types
from spgf_torch.hands.hand import load_hand
from spgf_torch.judging.clouds import seen_as
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.folders import read_objects
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.judge import load_judge
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.execute import Trials, execute
from spgf_torch.simulation.table import OUTCOMES

N, RESAMPLES, SEED = 10, 10_000, 0
SUCCESS, COLLISION = OUTCOMES.index("success"), OUTCOMES.index("collision")
NEEDED, OPTIONAL = ("objects", "judge"), ("model", "cgn", "views", "place", "seeds", "write")


@dataclass
class Ran:
    """One method on one cloud: outcome (<= N,) int64 and probability (<= N,) of its best, seconds of the processor."""

    outcome: Tensor
    probability: Tensor
    seconds: float

    @property
    def top(self) -> float:
        return float((self.outcome == SUCCESS).sum()) / N

    @property
    def first(self) -> float:
        return float((self.outcome[:1] == SUCCESS).sum())


def tried(found: dict[str, list[Timed]], sensed: Sequence[Sensed], hand: HandConfig) -> dict[str, list[Ran]]:
    """Method -> what became of its best in each cloud."""
    requests, where = [], []
    for name, its in found.items():
        for i, timed in enumerate(its):
            best = timed.ranked.poses.at(slice(N))
            for code, kind in enumerate(grasp_types(hand)):
                which = (best.grasp_type == code).nonzero()[:, 0]
                requests.append((sensed[i].obj, kind, best.T[which].float()))
                where.append((name, i, which))
    ran = {
        name: [
            Ran(torch.zeros(len(p), dtype=torch.int64), p, t.seconds) for t in its for p in [t.ranked.probability[:N]]
        ]
        for name, its in found.items()
    }
    trials = Trials(load_hand(hand), settings(EpisodeConfig))
    for (name, i, which), codes in zip(where, execute(requests, trials, 2), strict=True):
        ran[name][i].outcome[which] = codes
    return ran


def interval(values: Sequence[float], objects: int) -> tuple[float, float, float]:
    """Mean and 95 % interval over objects, in percent, of values (objects * seeds), those of an object side by side."""
    rates = 100 * np.array(values).reshape(objects, -1).mean(axis=1)
    means = np.random.default_rng(SEED).choice(rates, (RESAMPLES, objects)).mean(axis=1)
    return float(rates.mean()), *(float(q) for q in np.quantile(means, (0.025, 0.975)))


def words(values: Sequence[float], objects: int) -> str:
    return "{:.1f} ({:.0f} to {:.0f})".format(*interval(values, objects))


def tell(report: Report, ran: dict[str, list[Ran]], objects: Sequence[GraspObject], about: str, views: int) -> None:
    """Rows of each method and each object; figures of the judge against each other method."""
    count = len(objects)
    for name, its in ran.items():
        predicted = {} if name in SCORES else {"predicted": float(torch.cat([r.probability for r in its]).mean())}
        report.row(
            views=views,
            method=name,
            top10=words([r.top for r in its], count),
            top1=words([r.first for r in its], count),
            collided=float(np.mean([float((r.outcome == COLLISION).sum()) / N for r in its])),
            **predicted,
            held=float((torch.cat([r.outcome for r in its]) == SUCCESS).float().mean()),
            seconds=float(np.mean([r.seconds for r in its])),
        )
    tops = {name: np.array([r.top for r in its]).reshape(count, -1).mean(axis=1) for name, its in ran.items()}
    for i, obj in enumerate(objects):
        report.row(views=views, object=obj.name, **{name: float(top[i]) for name, top in tops.items()})
    ours = ran[JUDGE]
    for other, theirs in list(ran.items())[1:]:
        top = words([a.top - b.top for a, b in zip(ours, theirs, strict=True)], count)
        first = words([a.first - b.first for a, b in zip(ours, theirs, strict=True)], count)
        report.figure(f"{about}: judge minus {other}, top 10; top 1", "> 0; >= 0", f"{top}; {first}")
    if NETWORK in ran:
        cost, its = (float(np.mean([r.seconds for r in ran[name]])) for name in (JUDGE, NETWORK))
        measured = f"{cost / its:.2f}x ({cost:.2f} of {its:.2f} s)"
        report.figure(f"{about}: processor of the judge over {NETWORK}'s", "<= 0.2x", measured)


def arguments(line: Sequence[str]) -> dict[str, str]:
    """key=value each; raises InputError for others."""
    for word in line:
        if word.split("=", 1)[0] not in NEEDED + OPTIONAL or "=" not in word:
            raise InputError(f"{word}: expected key=value with one of {', '.join(NEEDED + OPTIONAL)}")
    given = dict(word.split("=", 1) for word in line)
    for key in NEEDED:
        if key not in given:
            raise InputError(f"{key}: expected {key}=FOLDER, got nothing")
    for key, value in (("views", "1,4"), ("seeds", "0")):
        given.setdefault(key, value)
        if not all(number.isdecimal() for number in given[key].split(",")):
            raise InputError(f"{key}={given[key]}: expected whole numbers such as {key}={value}")
    if given.setdefault("place", "table") not in ("table", "alone"):
        raise InputError(f"place={given['place']}: expected table or alone")
    return given


def compare(given: dict[str, str]) -> None:
    report = Report("peers", "")
    judge = load_judge(find(given["judge"]))
    who = peers(judge, given, report)
    config = SimpleNamespace(
        objects=given["objects"], unit="auto", category="manifest", skip_bad=False, workers=2, hand=who.hand,
        collision=settings(CollisionConfig),
    )  # fmt: skip
    objects = read_objects(config, ProgressReporter()).objects
    known = sum(obj.digest in set(judge.taught.values()) for obj in objects)
    hand, place, seeds = who.hand.name, given["place"], list(map(int, given["seeds"].split(",")))
    report.about = (
        f"{hand}, {len(objects)} objects ({known} of them taught the judge), {place}, sensing seeds {given['seeds']}."
    )
    print(report.about)
    for views in map(int, given["views"].split(",")):
        sensing = settings(SensingConfig, cameras=views)
        on_table = place == "table"
        sensed = [Sensed(obj, sensing, s, seen_as(obj, sensing, on_table, s)) for obj in objects for s in seeds]
        ran = tried(rank(who, sensed), sensed, who.hand)
        tell(report, ran, objects, f"{hand}, {views} view{'s' * (views > 1)}, {place}", views)
    if given.get("write") == "true":
        report.write()


def main() -> None:
    if len(sys.argv) == 1:  # as `make bench` does
        print("peers: skipped: objects=FOLDER and judge=FOLDER are needed")
        return
    try:
        compare(arguments(sys.argv[1:]))
    except InputError as error:
        print(f"peers: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
