"""Where SAPIEN and MuJoCo disagree about the same grasps, and which of them changes its mind at a finer step.

    python tests/benchmarks/engines.py [hand=panda] [objects=20] [candidates=60] [seed=0] [dt=0.001 ...]

Free candidates of objects of data/objects, `candidates` of each type drawn, executed in both engines as evaluate
engine=both does, and in both at a quarter of their step. What is asked more is a key of conf/mujoco/contacts.yaml.
"""

from __future__ import annotations

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import yaml
from scipy.stats import binomtest
from shared.clouds import objects

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import root
from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.second_engine.trial import MujocoSimulator
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.episode import Simulator
from spgf_torch.simulation.precheck import PreCheck
from spgf_torch.simulation.worker import Trials

Attempt = Callable[[np.ndarray], str]
ASKED = {"hand": "sdh2", "objects": "20", "candidates": "60", "seed": "0"}
PAIRS = (("sapien", "mujoco"), ("sapien fine", "mujoco fine"), ("sapien", "sapien fine"), ("mujoco", "mujoco fine"))


def outcomes(obj: GraspObject, hand: Hand, kind: str, T: np.ndarray, config: MujocoConfig) -> dict[str, list[str]]:
    """Of each free candidate, in each engine and step."""
    episode = settings(EpisodeConfig)

    def in_sapien(dt: float) -> Attempt:
        simulator = Simulator(obj, hand, replace(episode, dt=dt))
        return lambda pose: simulator.run(pose, kind)

    def in_mujoco(share: float) -> Attempt:
        finer = replace(config, dt=config.dt * share)
        return MujocoSimulator(obj, hand, kind, episode, finer).run

    ways = {
        "sapien": lambda: in_sapien(episode.dt),
        "sapien fine": lambda: in_sapien(episode.dt / 4),
        "mujoco": lambda: in_mujoco(1),
        "mujoco fine": lambda: in_mujoco(1 / 4),
    }
    found = {}
    for name, made in ways.items():
        start, run = time.process_time(), made()
        found[name] = [run(pose) for pose in T]
        SECONDS[name] += time.process_time() - start
    return found


SECONDS: Counter = Counter()


def share(hits: int, count: int) -> str:
    interval = binomtest(hits, count).proportion_ci(method="wilson")
    return f"{hits / count:.1%} of {count} ({100 * interval.low:.1f}-{100 * interval.high:.1f})"


def main(arguments: dict[str, str]) -> None:
    asked = {name: arguments.pop(name, default) for name, default in ASKED.items()}
    config = settings(MujocoConfig, **{name: float(value) for name, value in arguments.items()})
    description = yaml.safe_load((root() / f"conf/hand/{asked['hand']}.yaml").read_text())
    hand = load_hand(typed(HandConfig, {k: v for k, v in description.items() if k != "defaults"}))
    found: dict[str, list[str]] = {}
    names: list[str] = []
    samplers = Trials(hand, settings(EpisodeConfig)).samplers
    for obj in objects()[: int(asked["objects"])]:
        for kind, sampler in samplers.items():
            rng = np.random.default_rng([int(asked["seed"]), zlib.crc32(f"{obj.name}/{kind}".encode())])
            T = sample_candidates(obj, int(asked["candidates"]), settings(SamplerConfig), rng, sampler).numpy()
            check = PreCheck(obj, hand.preshapes[kind])
            free = T[[not check.collides(pose) for pose in T]]
            for way, words in outcomes(obj, hand, kind, free, config).items():
                found.setdefault(way, []).extend(words)
            names += [f"{obj.name} {kind}, {1000 * lever(obj, pose):.0f} mm" for pose in free]
    told(found, names)


def told(found: dict[str, list[str]], names: list[str]) -> None:
    held = {way: np.array(words) == "success" for way, words in found.items()}
    for way, its in held.items():
        print(f"{way}: {share(int(its.sum()), len(its))} held, {SECONDS[way]:.1f} s of processor")
    for a, b in PAIRS:
        print(f"{a} = {b}: {share(int((held[a] == held[b]).sum()), len(names))}")
    settled = (held["sapien"] == held["sapien fine"]) & (held["mujoco"] == held["mujoco fine"])
    agree = held["sapien"] == held["mujoco"]
    print(f"where neither changes its mind: {share(int(agree[settled].sum()), int(settled.sum()))}")
    pairs = Counter(zip(found["sapien"], found["mujoco"], strict=True))
    for (a, b), count in sorted(pairs.items(), key=lambda item: -item[1]):
        steady = sum(
            bool(s) for s, x, y in zip(settled, found["sapien"], found["mujoco"], strict=True) if (x, y) == (a, b)
        )
        print(f"  {a} in SAPIEN, {b} in MuJoCo: {count}, of which {steady} at finer steps too")
    print("  disagreements, with the distance of the centre of mass from the closing axis through the TCP:")
    for name, a, b, same in zip(names, found["sapien"], found["mujoco"], agree, strict=True):
        if not same:
            print(f"    {name}: {a} / {b}")


def lever(obj: GraspObject, T: np.ndarray) -> float:
    """m."""
    away = obj.com - T[:3, 3]
    return float(np.linalg.norm(away - T[:3, 0] * (away @ T[:3, 0])))


if __name__ == "__main__":
    main(dict(argument.split("=", 1) for argument in sys.argv[1:]))
