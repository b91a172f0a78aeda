"""Attempts in clutter on grasps that are known to hold: what squeezing on is worth, what steps and sleep change.

    python tests/benchmarks/clutter_trials.py [grasps an object and type] [hand]

Candidates of all shipped objects, from data/trials' sampler, that hold floating in episode=fast and whose way geometry
says is free of object and table. Each is tried on the object alone, upright on a table, as `Attempts` does; with
targets that are frozen after closing; with objects that are awake all the time; at dt 1/2000. Seconds are the
processor's, all ways in turn in one process. Before that, arrangements of the shipped objects below 20.5 cm, seeds 0 to
29: how many of five objects find room and stay, and how far any moves when all settle once more.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from unittest.mock import patch

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from robot import composed, episode
from shared.clouds import objects
from shared.harness import Report

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation import attempts as attempts_module
from spgf_torch.simulation.arrangements import Placed, arranged, rested
from spgf_torch.simulation.attempts import Attempt, Attempts
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.clutter_config import ArrangementConfig, AttemptConfig
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.episode import Simulator
from spgf_torch.simulation.fingers import Fingers
from spgf_torch.simulation.precheck import ApproachCheck
from spgf_torch.simulation.tabletop import Tabletop

GRASPS, DRAWN, SEED, SEEDS = 2, 40, 17, 30
UP, ABOVE = np.array([0.0, 0.0, 1.0]), 0.002


@contextmanager
def frozen() -> Iterator[None]:
    """Targets stay where they are once the hand has closed."""
    with patch.object(Fingers, "squeeze", Fingers.keep_linked):
        yield


@contextmanager
def awake() -> Iterator[None]:
    """Objects never sleep."""
    with patch.object(attempts_module, "Tabletop", lambda placed, physics, asleep: Tabletop(placed, physics)):
        yield


def holding(obj: GraspObject, hand: Hand, kind: str, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """T_object_tcp of up to `count` grasps that hold floating and can come above a table."""
    poses = sample_candidates(obj, DRAWN, settings(SamplerConfig), rng).numpy().astype(np.float64)
    check, simulator = ApproachCheck(obj, hand.preshapes[kind], 0.1), Simulator(obj, hand, episode("fast"))
    lowest = min(float(part[:, 2].min()) for part in obj.parts)
    free = (T for T in poses if check.met(T, UP, lowest + ABOVE) is None)
    good = (T for T in free if simulator.run(T, kind) == "success")
    return [T for _, T in zip(range(count), good, strict=False)]


def arrangements(report: Report, names: Sequence[str], count: int) -> None:
    """A row for each of conf/arrangement."""
    small = [obj for obj in objects() if max(obj.mesh.extents) < 0.205]
    for name in names:
        with initialize_config_dir(str(root() / "conf" / "arrangement"), version_base="1.3"):
            config = typed(ArrangementConfig, OmegaConf.to_container(compose(name)))
        scenes, seconds = [], []
        for seed in range(count):
            start = time.process_time()
            scenes.append(arranged(small, 5, seed, config))
            seconds.append(time.process_time() - start)
        pairs = [(a, b) for scene in scenes for a, b in zip(scene, rested(scene, config), strict=True)]
        moved = [float(np.linalg.norm(a.centre - b.centre)) for a, b in pairs]
        found = np.mean([len(scene) for scene in scenes])
        report.row(arrangement=name, objects=found, seconds=np.mean(seconds), moved_again_mm=1000 * max(moved))


def main(count: int, hand_name: str) -> None:
    report = Report(f"clutter_trials_{hand_name}", " ".join(__doc__.split("\n\n")[2].split()))
    hand = load_hand(typed(HandConfig, composed(f"hand={hand_name}")["hand"]))
    arrangement, fast = settings(ArrangementConfig), episode("fast")
    arrangements(report, ("packed", "packed_field", "pile"), SEEDS)
    normal = Attempts(hand, fast, settings(AttemptConfig), arrangement)
    fine = Attempts(hand, replace(fast, dt=1 / 2000, position_iterations=32), settings(AttemptConfig), arrangement)
    ways = {"as it is": (normal, nullcontext), "targets frozen": (normal, frozen), "awake": (normal, awake)}
    ways["dt 1/2000"] = (fine, nullcontext)
    ends: dict[str, list[Attempt]] = {name: [] for name in ways}
    for number, obj in enumerate(objects()):
        (alone,) = rested([Placed(obj, np.eye(4))], arrangement)
        if alone.T_world_object[2, 2] < 0.999:  # it rolls
            continue
        for kind in hand.preshapes:
            for T in holding(obj, hand, kind, count, np.random.default_rng([SEED, number])):
                for name, (attempts, way) in ways.items():
                    with way():
                        ends[name].append(attempts.run([alone], alone.T_world_object @ T, kind))
                    if name == "as it is" and ends[name][-1].outcome != "success":
                        print(f"  {obj.name} {kind} {ends[name][-1].cause} {ends[name][-1].touched}", flush=True)
    for name, them in ends.items():
        causes, seconds = Counter(end.cause for end in them), np.mean([end.seconds for end in them])
        same = np.mean([a.outcome == b.outcome for a, b in zip(them, ends["dt 1/2000"], strict=True)])
        report.row(way=name, attempts=len(them), causes=dict(causes), seconds=seconds, as_at_fine_steps=same)
    for name in ("as it is", "targets frozen"):
        lost = sum(end.cause == "dropped" for end in ends[name])
        report.figure(f"grasps known to hold, dropped on lifting, {name}", "0", f"{lost} of {len(ends[name])}")
    report.write()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else GRASPS, sys.argv[2] if len(sys.argv) > 2 else "sdh2")
