"""The robot's episode against a reference of fine steps and against the paper's; what squeezing on is worth.

    python tests/benchmarks/robot.py [candidates an object and type] [hand] [seed] [more ways of trying]

Candidates of all shipped objects, from data/trials' sampler. On each, an object and type a turn, in one process: the
paper's episode, episode=robot and episode=robot_fast, and as reference robot at dt 1/2000; all of the robot's in the
same draws of table, mass, friction and pose. Seconds are the processor's, of all candidates, with what is made for an
object and type and with collisions that geometry finds. Agreement is about success or not, with 95 % intervals
(Wilson), free: candidates that geometry lets through. Squeezing: grasps that hold while floating, nothing else drawn,
again from a table; how many fail as they are lifted, with targets that run ahead and with frozen ones.

More ways are an episode and settings of it, as "robot,position_iterations=64" or "robot,dt=0.0004"; their agreement is
shown, too. Settings are chosen so, with another seed than the benchmark's.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from scipy.stats import binomtest
from shared.clouds import objects
from shared.harness import Report

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.draws import StablePoses
from spgf_torch.simulation.fingers import Fingers
from spgf_torch.simulation.label import Label
from spgf_torch.simulation.robot import RobotTrials
from spgf_torch.simulation.worker import Trials, physics

CANDIDATES = 40
SEED = 17  # other candidates than those that settings were chosen on
FINE = "robot, dt 1/2000"
AIMS = {"robot": ">= 1.0", "robot_fast": ">= 1.6"}
NOTHING_DRAWN = {"mass_spread": 0.0, "friction_spread": 0.0, "pose_error": 0.0, "pose_error_deg": 0.0}


def composed(*overrides: str) -> dict[str, Any]:
    """The settings of `simulate` with these overrides."""
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        values = OmegaConf.to_container(compose("simulate", list(overrides)))
    assert isinstance(values, dict)
    return values


def episode(way: str) -> EpisodeConfig:
    """As `episode=NAME` sets it, of "NAME" or "NAME,key=value,..."."""
    name, *changes = way.split(",")
    return typed(EpisodeConfig, composed(f"episode={name}", *(f"episode.{change}" for change in changes))["episode"])


@dataclass
class Tally:
    """How each way of trying ended, of all candidates in order, and the seconds of processor."""

    words: dict[str, list[str]] = field(default_factory=dict)
    seconds: Counter[str] = field(default_factory=Counter)

    def add(self, name: str, make: Callable[[], Callable[[np.ndarray], str]], T: np.ndarray) -> None:
        start = time.process_time()
        attempt = make()
        self.words.setdefault(name, []).extend(map(attempt, T))
        self.seconds[name] += time.process_time() - start

    def per_second(self, name: str) -> float:
        return len(self.words[name]) / self.seconds[name]

    def agreed(self, name: str, reference: str = FINE) -> str:
        """Of free candidates / of all."""
        pairs = [
            (Label.of(a).outcome, Label.of(b).outcome)
            for a, b in zip(self.words[name], self.words[reference], strict=True)
        ]
        same = [(a == "success") == (b == "success") for a, b in pairs]
        free = [ok for ok, (_, b) in zip(same, pairs, strict=True) if b != "collision"]
        return f"{share(sum(free), len(free))} / {share(sum(same), len(same))}"


def share(hits: int, count: int) -> str:
    interval = binomtest(hits, count).proportion_ci(method="wilson")
    return f"{hits / count:.1%} of {count} ({100 * interval.low:.1f}-{100 * interval.high:.1f})"


def timed(make: Callable[[], Any]) -> float:
    """Seconds of processor."""
    start = time.process_time()
    make()
    return time.process_time() - start


class Squeezing:
    """Grasps that hold while floating, again from a table."""

    def __init__(self, robot: EpisodeConfig) -> None:
        quiet = replace(robot.robot, **NOTHING_DRAWN)
        self.floating = replace(robot, robot=replace(quiet, floating=1.0))
        self.resting = replace(robot, robot=replace(quiet, floating=0.0))
        self.ends: dict[str, list[Label]] = {"running ahead": [], "frozen": []}

    def add(self, obj: GraspObject, hand: Hand, kind: str, T: np.ndarray) -> None:
        floating, resting = (RobotTrials(obj, hand, config, kind) for config in (self.floating, self.resting))
        tried = [(pose, label) for pose in T if (label := resting.run(pose)).outcome != "collision"]
        ends = [(pose, label) for pose, label in tried if floating.run(pose).outcome == "success"]
        self.ends["running ahead"] += [label for _, label in ends]
        squeeze, Fingers.squeeze = Fingers.squeeze, lambda fingers: fingers.keep_linked()
        try:
            self.ends["frozen"] += [resting.run(pose) for pose, _ in ends]
        finally:
            Fingers.squeeze = squeeze

    def told(self, name: str) -> str:
        """How many were lost as they were lifted, and how."""
        ends = self.ends[name]
        lost = Counter(end.told for end in ends if end.phase == "lift")
        words = ", ".join(f"{count} {told}" for told, count in lost.most_common())
        return f"{sum(lost.values())} of {len(ends)}" + (f": {words}" if lost else "")


def main(count: int, hand_name: str, seed: int = SEED, more: Sequence[str] = ()) -> None:
    report = Report(f"robot_{hand_name}", " ".join(__doc__.split("\n\n")[2].split()))
    hand = load_hand(typed(HandConfig, composed(f"hand={hand_name}")["hand"]))
    robot = episode("robot")
    ways = {"the paper's": episode("pinch"), "robot": robot, "robot_fast": episode("robot_fast")}
    ways |= {FINE: replace(robot, dt=1 / 2000), **{way: episode(way) for way in more}}
    tally, squeezing = Tally(), Squeezing(robot)
    for number, obj in enumerate(objects()):
        toppled = timed(partial(StablePoses.of, obj))  # kept from then on: every way with a table pays
        tally.seconds.update({name: toppled for name, config in ways.items() if config.robot is not None})
        for kind in hand.preshapes:
            T = sample_candidates(obj, count, settings(SamplerConfig), np.random.default_rng([seed, number])).numpy()
            for name, config in ways.items():
                tally.add(name, partial(physics, obj, Trials(hand, config), kind), T)
            squeezing.add(obj, hand, kind, T)
    for name, words in tally.words.items():
        ends = Counter(Label.of(word).told for word in words)
        rate, success = tally.per_second(name), ends["success"] / len(words)
        report.row(episode=name, candidates=len(words), candidates_per_s=rate, success=success, ends=dict(ends))
    for name, aim in AIMS.items():
        ratio = tally.per_second(name) / tally.per_second("the paper's")
        report.figure(f"candidates/s, episode={name} over the paper's", aim, f"{ratio:.2f}")
    for name in (*AIMS, *more):
        agreed = tally.agreed(name)
        report.figure(f"outcomes as at dt 1/2000, free / all, episode={name}", ">= 97.5 / 99 %", agreed)
    for name in squeezing.ends:
        report.figure(
            f"grasps that hold floating, lost on lifting from a table, targets {name}", "0", squeezing.told(name)
        )
    report.write()


if __name__ == "__main__":
    words = dict(enumerate(sys.argv))
    count, hand_name = int(words.get(1, CANDIDATES)), words.get(2, "sdh2")
    main(count, hand_name, int(words.get(3, SEED)), sys.argv[4:])
