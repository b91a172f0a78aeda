"""What the first minute costs: processor seconds of `spgf predict` from the wheel, the first time and later.

    python tests/benchmarks/first_minute.py [ENVIRONMENT]

Outside the suite: a wheel of this checkout goes into ENVIRONMENT, a virtual environment that has its dependencies and
hatchling; without one a new one is made, some 500 MB. A box of the user's is predicted in a folder of its own, with a
home and caches that are empty, then once more. The names of the loops that were compiled are those in the cache that
the first call left; `import torch` beside it is the scale of this machine while it measures.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import venv
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
BOX = "import trimesh; trimesh.creation.box((0.04, 0.06, 0.08)).export('mug.ply')"
ASKED = {"first": 10, "later": 3}  # processor seconds, on a quiet machine (issue 19)


def main(arguments: list[str]) -> None:
    with TemporaryDirectory() as name:
        home = Path(name)
        place = Path(arguments[0]).absolute() if arguments else home / "environment"
        python = _installed(place, home)
        empty = {"HOME": name, "NUMBA_CACHE_DIR": f"{name}/numba", "MPLCONFIGDIR": f"{name}/matplotlib"}
        kept = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")}
        known = {**kept, **empty}
        _seconds(known, home, python, "-c", BOX)
        print(f"import torch: {_seconds(known, home, python, '-c', 'import spgf_torch, torch'):.1f} s")
        for call, asked in ASKED.items():
            seconds = _seconds(known, home, python.with_name("spgf"), "predict", "mug.ply", "--hand", "panda")
            print(f"spgf predict, {call}: {seconds:.1f} s of processor (asked: at most {asked})")
        kernels = sorted((home / "numba").rglob("*.nbi"))
        print(f"{len(kernels)} loops compiled: {', '.join(path.name.split('-')[0] for path in kernels)}")


def _installed(place: Path, home: Path) -> Path:
    """Python of the environment, with the wheel of this checkout."""
    python = place / "bin/python"
    if bare := not python.exists():
        venv.create(place, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "hatchling"], check=True)
    subprocess.run([python, "-m", "hatchling", "build", "-t", "wheel", "-d", home / "dist"], cwd=ROOT, check=True)
    (wheel,) = (home / "dist").glob("*.whl")
    how = ["--quiet", f"{wheel}[report]"] if bare else ["--quiet", "--no-deps", "--force-reinstall", str(wheel)]
    subprocess.run([python, "-m", "pip", "install", *how], check=True)
    return python


def _seconds(environment: dict[str, str], folder: Path, *command: object) -> float:
    """User and system seconds of a process and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(list(map(str, command)), cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main(sys.argv[1:])
