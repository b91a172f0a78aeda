"""What a judge costs: seconds of the processor, on one thread, from what is seen to ranked grasps, and of each stage.

    python tests/benchmarks/judging.py judge=FOLDER [every=5] [place=table] [write=true]

Every so many of the objects in data/objects (five neighbours in name are of different classes), seen by one camera and
by four. The hand is the judge's. The peer is the program before: with PYTHONPATH set to a checkout of another commit
the same file measures that one.
"""

import spgf_torch  # noqa: F401  # before torch: it sets how its threads wait

# isort: split

import sys
import time
from collections import defaultdict
from itertools import pairwise
from types import SimpleNamespace

import torch
from shared.harness import Report, threads

from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.hands.config import HandConfig
from spgf_torch.judging.clouds import Cloud, seen_as
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.folders import read_objects
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.hypotheses import Search
from spgf_torch.proposing.judge import Judge, load_judge
from spgf_torch.proposing.judge_features import in_images, judge_features
from spgf_torch.proposing.judge_proposer import best_of, ranked
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings, typed

ASKED = "<= 0.25 s"


def stages(judge: Judge, search: Search, config: ProposingConfig, cloud: Cloud) -> dict[str, float]:
    """Seconds of each step of `ranked`."""
    clock = [time.process_time()]
    seen = cloud.seen
    hypotheses = search.hypotheses(seen.texlets, cloud.around)
    clock.append(time.process_time())
    hypotheses = hypotheses.at(in_images(seen, hypotheses, search))
    clock.append(time.process_time())
    numbers = judge_features(seen, hypotheses, search)
    clock.append(time.process_time())
    factors = torch.stack(judge.both(numbers, images=bool(seen.views)), dim=1)
    clock.append(time.process_time())
    best_of(cloud.seen, hypotheses, factors.prod(1).float(), search, config)
    clock.append(time.process_time())
    names = ("hypotheses", "in_images", "numbers", "judge", "best_of")
    return {name: end - start for name, (start, end) in zip(names, pairwise(clock), strict=True)}


def main() -> None:
    given = dict(argument.split("=", 1) for argument in sys.argv[1:])
    judge, config = load_judge(find(given["judge"])), settings(ProposingConfig)
    hand = typed(HandConfig, judge.settings["hand"])
    clearance = Clearance(open_hand(hand), config.plane_clearance, config.between, config.obstacle_clearance)
    search = Search.of(clearance, judge.hypotheses)
    folder = SimpleNamespace(
        objects="data/objects", unit="auto", category="manifest", skip_bad=False, workers=1, hand=hand,
        collision=settings(CollisionConfig),
    )  # fmt: skip
    objects = read_objects(folder, ProgressReporter()).objects[:: int(given.get("every", "5"))]
    on_table = given.get("place", "table") == "table"
    report = Report("judging", f"{hand.name}, {len(objects)} objects, {'on a table' if on_table else 'alone'}.")
    for views in (1, 4):
        clouds = [seen_as(obj, settings(SensingConfig, cameras=views), on_table, 0) for obj in objects]
        seconds: dict[str, float] = defaultdict(float)
        with threads(1):
            ranked(judge, search, config, clouds[0].seen, clouds[0].around)  # compiled, and what is kept of a hand
            for cloud in clouds:
                start = time.process_time()
                ranked(judge, search, config, cloud.seen, cloud.around)
                seconds["all"] += (time.process_time() - start) / len(clouds)
                for name, spent in stages(judge, search, config, cloud).items():
                    seconds[name] += spent / len(clouds)
        texlets = sum(len(cloud.seen.texlets) for cloud in clouds) / len(clouds)
        report.row(views=views, texlets=texlets, **seconds)
        report.figure(f"{hand.name}, cloud to grasps, views {views}", ASKED, f"{seconds['all']:.3f} s")
    if given.get("write") == "true":
        report.write()


if __name__ == "__main__":
    main()
