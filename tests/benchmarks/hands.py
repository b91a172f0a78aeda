"""Hands from their descriptions to trained models: CG by cross-validation, random candidates beside, and what it costs.

    python tests/benchmarks/hands.py rates [HAND=CANDIDATES ...] [workers=1]
    python tests/benchmarks/hands.py wide                         # objects that no pinch of the SDH-2 can hold
    python tests/benchmarks/hands.py learn [HAND=CANDIDATES ...]  # time from description to model, judge included

HAND is one of conf/hand, or the path of a description; CANDIDATES are of each type, on each object.
Each step is a command of the package, run as a user runs it; what it left in outputs/hands is kept and goes on. The
tables that it prints are those of docs/hands.md. `rates` takes the trials on the 50 objects, 20 prototypes, seed 0.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

BENCHMARKS = Path(__file__).parent
FOLDER = Path("outputs/hands")
DESCRIPTIONS = BENCHMARKS.parent / "hands/descriptions"
WIDE = BENCHMARKS / "wide_objects"
ALL_FINGERS, PINCHES = "sdh2_fingers", "sdh2"
# Candidates of each type on each object: fewer where most hold, so that minutes suffice, more where few are free.
JAWS = dict.fromkeys(("panda", "robotiq_2f", "so101"), 100)
RATES = {PINCHES: 40, ALL_FINGERS: 40, **JAWS, "robotiq_3f": 25}
PUBLIC = {"robotiq_3f": 25, "barrett": 25, "allegro": 25, "sdh_ipa": 25}
WORKERS = [argument for argument in sys.argv[1:] if argument.startswith("workers=")]
LEARN = {"panda": 50, "robotiq_2f": 50, "so101": 50, "robotiq_3f": 25, ALL_FINGERS: 10}


def run(command: str, *keys: str) -> None:
    """A command of the package, its output shown where it fails."""
    call = [sys.executable, "-m", f"spgf_torch.{command}", *keys, *WORKERS]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(call[1:])}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def label(hand: str) -> str:
    return Path(hand).stem if hand.endswith(".yaml") else hand


def trained(hand: str, candidates: int) -> Path:
    """The folder of a model of the hand, made where it is not there."""
    folder = FOLDER / ("public_" * hand.endswith(".yaml") + label(hand))
    if not (folder / "model/results.json").is_file():
        run("simulate", f"hand={hand}", f"candidates={candidates}", f"out={folder}/trials")
        run("train", f"hand={hand}", f"trials={folder}/trials", "+K=20", f"hydra.run.dir={folder}/model")
    return folder / "model"


def percent(value: float, interval: list[float]) -> str:
    return f"{100 * value:.1f} ({100 * interval[0]:.0f}-{100 * interval[1]:.0f})"


def rates(hands: dict[str, int]) -> None:
    """A line a hand: CG of the ten best as the paper ranks, and by the ranking chosen inside the training folds."""
    print("| hand | types | candidates | CG, paper's ranking | CG, our ranking | random, each type | best possible |")
    print("|---|---|---|---|---|---|---|")
    for hand, candidates in hands.items():
        results = json.loads((trained(hand, candidates) / "results.json").read_text())
        columns = [
            percent(results["by_ranking"][ranking]["all"]["CG"], results["interval95_by_ranking"][ranking]["all"]["CG"])
            for ranking in ("paper", "nested")
        ]
        random = ", ".join(f"{100 * results['random']['all'][name]:.1f}" for name in results["grasp_types"])
        words = [label(hand), ", ".join(results["grasp_types"]), str(candidates), *columns, random]
        print(f"| {' | '.join(words)} | {100 * results['ceiling']['all']['CG']:.1f} |", flush=True)


def wide() -> None:
    """What models of the 50 objects propose for objects wider than 95 mm on every side, executed."""
    print("| object | pinches | all fingers |\n|---|---|---|")
    found: dict[str, list[float]] = {}
    for hand in (PINCHES, ALL_FINGERS):
        model, out = trained(hand, RATES[hand]), FOLDER / f"wide_{hand}"
        if not (out / "results.json").is_file():
            run("evaluate", f"hand={hand}", f"objects={WIDE}", f"model={model}", f"hydra.run.dir={out}")
        results = json.loads((out / "results.json").read_text())
        for each in results["per_object"]:
            found.setdefault(each["object"], []).append(100 * each["CG"])
    for name, columns in found.items():
        print(f"| {name} | {' | '.join(f'{rate:.0f}' for rate in columns)} |")
    means = [sum(column) / len(column) for column in zip(*found.values(), strict=True)]
    print(f"| mean | {' | '.join(f'{mean:.1f}' for mean in means)} |", flush=True)


def learn(hands: dict[str, int]) -> None:
    """Seconds by the clock and of the processor of `train judge=learn`, nothing cached but compiled loops."""
    print("| hand | random candidates of a type on an object | clock, s | processor, s |\n|---|---|---|---|")
    for hand, candidates in hands.items():
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        keys = (f"+judging.candidates={candidates}", "cache=off", f"hydra.run.dir={FOLDER}/learn_{label(hand)}")
        run("train", f"hand={hand}", "judge=learn", "+K=20", *keys)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        print(f"| {label(hand)} | {candidates} | {time.perf_counter() - start:.0f} | {spent:.0f} |", flush=True)


def main() -> None:
    part, *given = sys.argv[1:] or ["rates"]
    asked = {hand: int(count) for hand, count in (each.split("=") for each in given if each not in WORKERS)}
    if part == "wide":
        wide()
    elif part == "learn":
        learn(asked or LEARN)
    else:
        public = {str(path): PUBLIC.get(path.stem, 100) for path in sorted(DESCRIPTIONS.glob("*.yaml"))}
        rates(asked or {**RATES, **public})


if __name__ == "__main__":
    main()
