"""python tests/endurance/kill_learning.py [FOLDER]: learning killed again and again, and with other workers; minutes.

Learns a small judge by `train judge=learn` on four objects in one go; then in a new folder with calls that SIGKILL ends
with all their processes after a few seconds, until one comes through, on two processes instead of one; then from the
tables of trials that the first left. All must have left the same bytes.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
OBJECTS = ("soap_bar", "egg", "box_tea", "tumbler")
SMALL = ["K=3", "folds=2", "bootstrap=100", "sensing.width=160", "sensing.height=120", "sensing.focal=144"]
SMALL += ["affordance.features_per_object=40", "prototypes.restarts=1", "prototypes.subsample=1000", "inner_grasps=20"]
TINY = {"candidates": 20, "rounds": 2, "best": 3, "random": 2, "one_view": 1, "hypotheses.seeds": 6}
TINY |= {"hypotheses.hypotheses": 60, "learning.trees": 8, "learning.least": 3}
SAME = ("judge.json", "judge.safetensors", "model.safetensors", "own_trials", "trials")


def call(place: Path, *overrides: str) -> subprocess.Popen:
    """`train judge=learn` in `place`, in a process group of its own."""
    words = ["hand=panda", "judge=learn", "objects=objects", *SMALL, *(f"+judging.{k}={v}" for k, v in TINY.items())]
    return subprocess.Popen(
        [sys.executable, "-m", "spgf_torch.train", *words, *overrides],
        cwd=place,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=(place / "log").open("a"),
        start_new_session=True,
    )


def kept(place: Path) -> dict[str, bytes]:
    """The bytes of what must be the same, by name."""
    run = place / "outputs/train/latest"
    files = [path for name in SAME for path in ([run / name] if (run / name).is_file() else (run / name).glob("*"))]
    return {str(path.relative_to(run)): path.read_bytes() for path in sorted(files)}


def killed(place: Path, rng: random.Random) -> int:
    """Call until one comes through; how many were killed before."""
    kills, patience = 0, 6.0
    while True:
        process = call(place, "workers=2")
        try:
            if process.wait(rng.uniform(0.5, 1) * patience):
                raise SystemExit((place / "log").read_text())
            return kills
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            kills, patience = kills + 1, patience * 1.3


def main() -> None:
    given = sys.argv[1:]
    folder = Path(given[0] if given else tempfile.mkdtemp())
    for name in ("whole", "killed", "tables"):
        (folder / name / "objects").mkdir(parents=True)
        for obj in OBJECTS:
            shutil.copy(ROOT / f"data/objects/{obj}.yaml", folder / name / "objects")
    if call(folder / "whole", "workers=1").wait():
        raise SystemExit((folder / "whole/log").read_text())
    run = folder / "whole/outputs/train/latest"
    kills = killed(folder / "killed", random.Random(0))
    tables = [f"trials={run / 'trials'}", f"own_trials={run / 'own_trials'}"]
    if call(folder / "tables", *tables, "cache=off").wait():
        raise SystemExit((folder / "tables/log").read_text())
    whole = kept(folder / "whole")
    different = [name for name, content in kept(folder / "killed").items() if whole.get(name) != content]
    again = [name for name, content in kept(folder / "tables").items() if whole.get(name) != content]
    print(f"{len(whole)} files; {kills} calls killed; different: {different or 'none'}; from tables: {again or 'none'}")
    if different or again or len(whole) != len(kept(folder / "killed")):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
