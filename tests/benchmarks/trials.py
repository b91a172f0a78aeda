"""Trials against the same episode in MuJoCo, a naive SAPIEN loop, and a reference of fine steps.

    python tests/benchmarks/trials.py [candidates an object and type]

Candidates of all shipped objects, from data/trials' sampler. Ours: pre-check, then the episode, the default one and
episode=fast. Reference: the default one at dt 1/2000. Naive: what one writes first: a scene, the URDF and the object's
parts anew for each candidate, no pre-check. MuJoCo: the package's second engine, with the same hand, object, drives,
closing, loads and tests of the outcome, behind our pre-check; the model of an object is compiled once. All take turns,
an object a round, in one process, and seconds are the processor's; agreement is about success or not, over candidates
that the pre-check lets through, unless it says all, with its 95 % interval (Wilson). episode=fast was chosen on other
candidates.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from scipy.stats import binomtest
from shared.clouds import objects
from shared.harness import Report
from torch import Tensor

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import root
from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.episode import Simulator
from spgf_torch.simulation.execute import execute
from spgf_torch.simulation.precheck import PreCheck
from spgf_torch.simulation.worker import Trials

Requests = list[tuple[GraspObject, str, Tensor]]

CANDIDATES = 12
NAIVE = 1  # candidate of each object and type for the naive loop


def episode(name: str) -> EpisodeConfig:
    """As `episode=NAME` sets it."""
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        composed = compose("simulate", [f"episode={name}"])
    return typed(EpisodeConfig, OmegaConf.to_container(composed.episode))


EPISODE, FAST = settings(EpisodeConfig), episode("fast")
FINE = settings(EpisodeConfig, dt=1 / 2000)


@dataclass
class Tally:
    """What each way of trying found: success or not of all its trials in order, and the seconds of processor.

    One thread each, so that these are what a machine with nothing else to do would take.
    """

    held: dict[str, list[bool]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, attempt: Callable[[np.ndarray], str], candidates: np.ndarray) -> None:
        start = time.process_time()
        self.held.setdefault(name, []).extend(attempt(T) == "success" for T in candidates)
        self.seconds[name] = self.seconds.get(name, 0) + time.process_time() - start

    def per_second(self, name: str) -> float:
        return len(self.held[name]) / self.seconds[name]

    def agreement(self, name: str, reference: str) -> float:
        return float(np.mean(np.array(self.held[name]) == self.held[reference]))

    def agreed(self, name: str, whole: int) -> str:
        """With the reference: of the free candidates, and of the whole, where no collision ends otherwise."""
        free = len(self.held[name])
        same = round(free * self.agreement(name, "dt 1/2000"))
        return f"{_share(same, free)} / {_share(same + whole - free, whole)}"


def _share(hits: int, count: int) -> str:
    interval = binomtest(hits, count).proportion_ci(method="wilson")
    return f"{hits / count:.1%} of {count} ({100 * interval.low:.1f}-{100 * interval.high:.1f})"


def compare(tally: Tally, obj: GraspObject, hand: Hand, kind: str, T: np.ndarray, mujoco: ModuleType | None) -> None:
    """Try the candidates T (M, 4, 4) in every way."""
    start = time.process_time()
    check, simulator = PreCheck(obj, hand.preshapes[kind]), Simulator(obj, hand, EPISODE)
    free = np.array([not check.collides(pose) for pose in T])
    tally.seconds["pre-check"] = tally.seconds.get("pre-check", 0) + time.process_time() - start
    fast, fine = Simulator(obj, hand, FAST), Simulator(obj, hand, FINE)
    tally.add("ours", lambda pose: simulator.run(pose, kind), T[free])
    tally.add("ours, fast", lambda pose: fast.run(pose, kind), T[free])
    tally.add("dt 1/2000", lambda pose: fine.run(pose, kind), T[free])
    tally.add("naive", lambda pose: Simulator(obj, hand, EPISODE).run(pose, kind), T[:NAIVE])
    truth = np.zeros(len(T), dtype=bool)
    truth[free] = tally.held["dt 1/2000"][-free.sum() :] if free.any() else []
    tally.held.setdefault("truth of naive", []).extend(truth[:NAIVE].tolist())
    if mujoco:
        from spgf_torch.second_engine.trial import MujocoSimulator

        tally.add("mujoco", MujocoSimulator(obj, hand, kind, EPISODE, settings(MujocoConfig)).run, T[free])


def main(count: int) -> None:
    report = Report("trials", " ".join(__doc__.split("\n\n")[2].split()))
    report.skip("trials with device=cuda: PhysX on the CPU is what repeats bit for bit")
    mujoco, hand, tally = report.peer("mujoco"), load_hand(settings(HandConfig)), Tally()
    requests: Requests = []
    for number, obj in enumerate(objects()):
        for kind in hand.preshapes:
            T = sample_candidates(obj, count, settings(SamplerConfig), np.random.default_rng(number))
            requests.append((obj, kind, T))
            compare(tally, obj, hand, kind, T.numpy(), mujoco)
    for name in [name for name in tally.held if name != "truth of naive"]:
        agreement = tally.agreement(name, "truth of naive" if name == "naive" else "dt 1/2000")
        rate, success = tally.per_second(name), float(np.mean(tally.held[name]))
        report.row(method=name, trials=len(tally.held[name]), trials_per_s=rate, success=success, agreement=agreement)
    whole, rates = sum(len(T) for _, _, T in requests), {}
    for name, config in (("ours", EPISODE), ("ours, fast", FAST)):
        rates[name] = by_the_clock(requests, Trials(hand, config))
        report.row(method=f"{name}, two processes, once started", trials=whole, trials_per_s=rates[name])
    told(report, tally, whole, rates)
    report.write()


def by_the_clock(requests: Requests, trials: Trials) -> float:
    """Candidates/s of two processes, from when the first chunk has come back."""
    done: list[tuple[float, int]] = []
    for _ in execute(requests, trials, 2, lambda name, count: done.append((time.perf_counter(), count))):
        pass
    return sum(count for _, count in done[1:]) / (done[-1][0] - done[0][0])


def told(report: Report, tally: Tally, whole: int, rates: dict[str, float]) -> None:
    """The figures of so many candidates in the whole; `rates`: candidates/s of two processes, by the clock."""
    for name, label in (("ours", "default episode"), ("ours, fast", "episode=fast")):
        core = whole / (tally.seconds[name] + tally.seconds["pre-check"])
        report.figure(
            f"candidates/s of one core's time x 2 cores (of two busy ones, by the clock), {label}",
            ">= 200 on 2 cores",
            f"{2 * core:.0f} ({rates[name]:.0f})",
        )
        report.figure(
            f"outcomes as at dt 1/2000, of free candidates / of all, {label}", ">= 99 %", tally.agreed(name, whole)
        )
    right = tally.agreement("naive", "truth of naive")
    ours = whole / (tally.seconds["ours"] + tally.seconds["pre-check"])
    report.figure(
        "candidates/s over a naive SAPIEN loop",
        "",
        f"{ours / tally.per_second('naive'):.1f} (whose outcomes are right for {right:.1%} of what it tries)",
    )
    if "mujoco" in tally.held:
        ratio, agreement = tally.per_second("ours") / tally.per_second("mujoco"), tally.agreement("mujoco", "dt 1/2000")
        report.figure(
            "free trials/s over the same episode in MuJoCo", "", f"{ratio:.2f} (which agrees in {agreement:.1%})"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else CANDIDATES)
