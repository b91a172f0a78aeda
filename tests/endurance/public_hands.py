"""Ten public hands, their URDFs as they come, on four objects: what their random candidates do.

    python tests/endurance/public_hands.py [candidates=100] [tried=25] [DESCRIPTION.yaml ...]

Each line: of the candidates those that do not collide, and of `tried` of these on each object, executed in SAPIEN,
those that held (%); processor time of a trial; how far a joint went beyond its limits. Needs ../shared/hands, where the
URDFs lie. Fails where a type of a hand never holds, or all its candidates collide, or a joint leaves its limits.
"""

import spgf_torch  # noqa: F401  # before torch: it sets how its threads wait

# isort: split

import sys
import time
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
import yaml

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.episode import Simulator, Trial
from spgf_torch.simulation.precheck import PreCheck

DESCRIPTIONS = Path(__file__).parent.parent / "hands/descriptions"
OBJECTS = ("ball_toy", "box_tea", "can_soda", "mug_coffee")
ASTRAY = 0.01  # rad or m beyond a limit: twice what a drive at its effort bends a joint's stop


def described(path: Path) -> Hand:
    """The hand of a description, whose paths are seen from the repository."""
    told = yaml.safe_load(path.read_text())
    told["packages"] = {name: str(root() / folder) for name, folder in told.get("packages", {}).items()}
    return load_hand(typed(HandConfig, {**told, "urdf": str(root() / told["urdf"])}))


def tried(obj: GraspObject, hand: Hand, grasp_type: str, candidates: int, most: int) -> tuple[Counter[str], float]:
    """What became of random candidates, of those that do not collide at most so many; how far joints went astray."""
    check, simulator = PreCheck(obj, hand.preshapes[grasp_type]), Simulator(obj, hand, settings(EpisodeConfig))
    rng = np.random.default_rng([0, zlib.crc32(f"{obj.name}/{grasp_type}".encode())])
    poses = sample_candidates(obj, candidates, settings(SamplerConfig), rng).numpy()
    free = [T for T in poses if not check.collides(T)]
    found, astray = Counter(candidates=candidates, free=len(free)), 0.0
    for T in free[:most]:
        trial = Trial(simulator, np.asarray(T, dtype=np.float64), grasp_type)
        found[trial.run()] += 1
        found["run"] += 1
        for name, place in trial.fingers.places.items():
            joint, value = hand.robot.joint(name), float(trial.fingers.qpos[place])
            beyond = max(joint.lower - value, value - joint.upper, 0.0)
            astray = max(astray, beyond if np.isfinite(value) else np.inf)
    return found, astray


def main() -> None:
    given = dict(argument.split("=", 1) for argument in sys.argv[1:] if "=" in argument)
    paths = [Path(argument) for argument in sys.argv[1:] if "=" not in argument] or sorted(DESCRIPTIONS.glob("*.yaml"))
    objects = [obj for obj in load_objects(root() / "data/objects") if obj.name in OBJECTS]
    wrong = []
    print("| hand | type | free | of these held | ms of processor a trial | beyond limits |\n|---|---|---|---|---|---|")
    for path in paths:
        hand = described(path)
        for grasp_type in hand.preshapes:
            total, astray, start = Counter[str](), 0.0, time.process_time()
            for obj in objects:
                found, beyond = tried(
                    obj, hand, grasp_type, int(given.get("candidates", 100)), int(given.get("tried", 25))
                )
                total, astray = total + found, max(astray, beyond)
            spent = 1000 * (time.process_time() - start) / max(total["run"], 1)
            free, held = 100 * total["free"] / total["candidates"], 100 * total["success"] / max(total["run"], 1)
            print(
                f"| {hand.config.name} | {grasp_type} | {free:.0f} | {held:.0f} | {spent:.0f} | {astray:.3f} |",
                flush=True,
            )
            if not total["success"] or astray > ASTRAY:
                wrong.append(f"{hand.config.name} {grasp_type}")
    if wrong:
        sys.exit(f"not sane: {', '.join(wrong)}")


if __name__ == "__main__":
    main()
