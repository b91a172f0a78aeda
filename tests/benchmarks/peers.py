"""Who proposes grasps that hold: a judge, the antipodal baseline and the votes alone, on the same clouds, all executed.

    python tests/benchmarks/peers.py objects=FOLDER judge=FOLDER [model=FOLDER] [views=1,4] [place=table]

Each object of the folder is sensed by one camera and by four, on a table (place=table) or alone (place=alone); each
method ranks grasps for that cloud, and SAPIEN tries the ten best. Missing grasps count as failures. `model`, of the
same hand, adds the votes alone (`proposing.propose`). Seconds are of the processor for a cloud, on one thread, without
sensing. Intervals are bootstraps over objects; differences are paired. The hand is the judge's.
"""

import spgf_torch  # noqa: F401  # before torch: it sets how its threads wait

# isort: split

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import torch
from shared.harness import Report, threads
from torch import Tensor

from spgf_torch.affordance.model import load_model
from spgf_torch.config import (
    GRASP_TYPES,
    CollisionConfig,
    EpisodeConfig,
    HandConfig,
    ProposingConfig,
    SensingConfig,
    find,
    settings,
    typed,
)
from spgf_torch.experiment.tried import open_hand
from spgf_torch.judging.clouds import Cloud, seen_as
from spgf_torch.objects.folders import read_objects
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import Stages
from spgf_torch.proposing.antipodal import antipodal
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import load_judge
from spgf_torch.proposing.judged import Ranked, ranked
from spgf_torch.proposing.propose import Proposer
from spgf_torch.trials.hand import load_hand
from spgf_torch.trials.runner import Trials, execute
from spgf_torch.trials.table import OUTCOMES

N, RESAMPLES, SEED = 10, 10_000, 0
SUCCESS, COLLISION = OUTCOMES.index("success"), OUTCOMES.index("collision")
Method = Callable[[Cloud], Ranked]


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


def methods(given: dict[str, str]) -> tuple[HandConfig, dict[str, Method]]:
    """The hand, and how each method ranks."""
    judge = load_judge(find(given["judge"]))
    hand, config = typed(HandConfig, judge.settings["hand"]), settings(ProposingConfig)
    clearance = Clearance(open_hand(hand), config.plane_clearance, config.between, config.obstacle_clearance)
    search = Search.of(clearance, judge.hypotheses)
    found: dict[str, Method] = {
        "judge": lambda cloud: ranked(judge, search, config, cloud.seen, cloud.around),
        "antipodal": lambda cloud: antipodal(search, config, cloud.seen, cloud.around),
    }
    if "model" in given:
        model = load_model(find(given["model"]))
        judge.check_hand(model.settings.get("hand"), "the model's hand")
        proposer = Proposer.of(model, config, open_hand(hand))

        def votes(cloud: Cloud) -> Ranked:
            grasps = proposer.propose(cloud.seen.texlets, cloud.around)
            return Ranked(Hypotheses(grasps.T_object_tcp, grasps.grasp_type), grasps.probability)

        found["votes"] = votes
    return hand, found


def run(objects: Sequence[GraspObject], hand: HandConfig, how: dict[str, Method], views: int, table: bool) -> dict:
    """Method -> what became of each object's best, in their order."""
    clouds = [seen_as(obj, settings(SensingConfig, cameras=views), table, SEED) for obj in objects]
    with threads(1):
        for method in how.values():  # compiled, and what is kept of a hand
            method(clouds[0])
        best: dict[str, list[tuple[Ranked, float]]] = {}
        for name, method in how.items():
            for cloud in clouds:
                start = time.process_time()
                found = method(cloud)
                best.setdefault(name, []).append((found, time.process_time() - start))
    requests, where = [], []
    for name, ran in best.items():
        for i, (found, _) in enumerate(ran):
            for code, kind in enumerate(GRASP_TYPES):
                which = (found.poses.grasp_type[:N] == code).nonzero()[:, 0]
                requests.append((objects[i], kind, found.poses.T[which].float()))
                where.append((name, i, which))
    outcomes = {
        name: [torch.zeros(len(f.probability[:N]), dtype=torch.int64) for f, _ in ran] for name, ran in best.items()
    }
    trials = Trials(load_hand(hand), settings(EpisodeConfig))
    for (name, i, which), codes in zip(where, execute(requests, trials, 2), strict=True):
        outcomes[name][i][which] = codes
    return {
        name: [Ran(o, f.probability[:N], s) for o, (f, s) in zip(outcomes[name], ran, strict=True)]
        for name, ran in best.items()
    }


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean and 95 % interval over objects, in percent."""
    rates = 100 * np.array(values)
    means = np.random.default_rng(SEED).choice(rates, (RESAMPLES, len(rates))).mean(axis=1)
    return float(rates.mean()), *(float(q) for q in np.quantile(means, (0.025, 0.975)))


def words(values: Sequence[float]) -> str:
    return "{:.1f} ({:.0f} to {:.0f})".format(*interval(values))


def main() -> None:
    given = dict(argument.split("=", 1) for argument in sys.argv[1:])
    place = given.get("place", "table")
    hand, how = methods(given)
    config = SimpleNamespace(
        objects=given["objects"], unit="auto", category="manifest", skip_bad=False, workers=2, hand=hand,
        collision=settings(CollisionConfig),
    )  # fmt: skip
    objects = read_objects(config, Stages()).objects
    taught = set(load_judge(find(given["judge"])).taught.values())
    known = sum(obj.digest in taught for obj in objects)
    report = Report("peers", f"{hand.name}, {len(objects)} objects ({known} of them taught the judge), {place}.")
    for views in map(int, given.get("views", "1,4").split(",")):
        ran = run(objects, hand, how, views, place == "table")
        for name, its in ran.items():
            hits = [(r.outcome == SUCCESS) for r in its]
            report.row(
                views=views,
                method=name,
                top10=words([r.top for r in its]),
                top1=words([r.first for r in its]),
                collided=float(np.mean([float((r.outcome == COLLISION).sum()) / N for r in its])),
                predicted=float(torch.cat([r.probability for r in its]).mean()),
                held=float(torch.cat(hits).float().mean()),
                seconds=float(np.mean([r.seconds for r in its])),
            )
        for obj, row in zip(objects, zip(*ran.values(), strict=True), strict=True):
            report.row(views=views, object=obj.name, **{m: r.top for m, r in zip(ran, row, strict=True)})
        for other in list(ran)[1:]:
            top = words([a.top - b.top for a, b in zip(ran["judge"], ran[other], strict=True)])
            first = words([a.first - b.first for a, b in zip(ran["judge"], ran[other], strict=True)])
            figure = f"{hand.name}, {views} view{'s' * (views > 1)}, {place}: judge minus {other}, top 10; top 1"
            report.figure(figure, "> 0; >= 0", f"{top}; {first}")
    if given.get("write") == "true":
        report.write()


if __name__ == "__main__":
    main()
