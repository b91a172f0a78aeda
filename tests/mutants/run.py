"""Mutation testing of the kernels, the learner, the experiment and the trials (`make mutants`, outside the suite).

Changes one place of the program at a time and runs the nearest tests, which should fail. Cosmic Ray makes the changes.
It is driven from here because its own runner has one test command for all modules and changes files in place, and
because mutmut leaves out decorated functions: all kernels. A mutant lives in a copy of the repository under
`outputs/mutants`. The copy keeps its compiled kernels, but for those that the changed module reaches.

    python tests/mutants/run.py --count 60 --seed 0          # all packages
    python tests/mutants/run.py --count 9 --packages ops        # one
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import os
import re
import resource
import shutil
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from queue import Queue

import numba
import pytest
from sampling import Mutant, draw
from scipy.stats import binomtest

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "outputs" / "mutants"

RINGS = ["ring_grid", "moving_average", "pairwise_relations", "alignment_runs", "alignment"]
FEATURES = [*(f"ops/test_ops_{name}.py" for name in RINGS), "features", "ops/test_ops.py"]
CLUSTERS = ["ops/test_ops.py", "prototypes"]
CELLS = ["affordance", "ops/test_ops.py"]
LEARNER = ["affordance", "experiment/test_leakage.py", "experiment/test_golden.py"]
SEARCH = ["deepest_free", "extents", "facing_gap", "leaves", "nearest_piece", "pad_numbers", "push_loops"]
QUICK = ["phases", "worker", "run_state", "table", "one_finger", "seeds"]

# The tests nearest to a module: those of the longest beginning of its name, the quick ones first.
NEAREST = {
    "features/": ["features"],
    "ops/": ["ops", "features", "prototypes", "affordance"],
    **dict.fromkeys(("ops/assignment", "ops/kmeans", "ops/lloyd", "ops/kmeans_partition"), CLUSTERS),
    **dict.fromkeys(
        ("ops/accumulate", "ops/cell_pairs", "ops/look_up_points", "ops/neighbourhood_", "ops/relative"), CELLS
    ),
    **dict.fromkeys(
        ("ops/alignment", "ops/describe", "ops/moving", "ops/pairwise_relations", "ops/ring_grid"), FEATURES
    ),
    "ops/neighbours": ["ops/test_ops_neighbours.py", "ops/test_ops.py", "features"],
    "ops/points_in_volume": ["affordance/test_sensed_collision.py", "ops/test_ops.py", "proposing"],
    "ops/farthest_first": ["proposing/test_proposing_sampling.py", "ops/test_ops.py"],
    **{f"ops/{name}": ["ops/test_ops.py", "proposing"] for name in SEARCH},
    "ops/depth_behind": ["sensing/test_sensing_unseen.py", "ops/test_ops.py", "proposing"],
    "prototypes/": ["prototypes"],
    "affordance/": LEARNER,
    "proposing/": ["proposing"],
    "experiment/": ["experiment/test_leakage.py", "experiment/test_cross_validation.py", "experiment"],
    "simulation/": [*(f"simulation/test_{name}.py" for name in QUICK), "simulation"],
}
PACKAGES = ("features", "ops", "prototypes", "affordance", "proposing", "experiment", "simulation")

# Seconds of processor time of the tests' process, and of a clock for those that wait for ever.
PROCESSOR_LIMIT, CLOCK_LIMIT = 120, 900

# Beside kept kernels: what they were compiled from.
STAMP = "sources"

# Each run of tests is a fork of a process that has imported what takes seconds, and nothing of ours.
WARM = get_context("forkserver")
HEAVY = "torch numba trimesh lightning.pytorch scipy.optimize sklearn.cluster pyarrow.parquet pytorch_kinematics fcl"
WARM.set_forkserver_preload(["__main__", *HEAVY.split()])

# What a copy of the repository does without.
NOT_COPIED = shutil.ignore_patterns(".git", ".venv*", "outputs", "__pycache__", ".*_cache", ".hypothesis")


@dataclass(frozen=True)
class Outcome:
    """How a mutant ended: "killed", "out of time" or "survived"; the first test that failed."""

    mutant: Mutant
    end: str
    test: str
    seconds: float

    def __str__(self) -> str:
        at = f"{self.mutant.path}:{self.mutant.line}"
        return (
            f"{self.end:11} {at:48} {self.mutant.operator.removeprefix('core/'):38} {self.seconds:4.0f} s  {self.test}"
        )


class Copy:
    """A copy of the repository with compiled kernels of its own; one mutant at a time."""

    def __init__(self, number: int) -> None:
        self.root, self.kernels = OUT / f"copy{number}", OUT / f"kernels{number}"
        self.warm = OUT / f"kernels{number}.warm"
        shutil.rmtree(self.root, ignore_errors=True)
        shutil.copytree(ROOT, self.root, ignore=NOT_COPIED)
        (self.root / "outputs").mkdir()
        self.checked: list[list[str]] = []
        for kernels in (self.kernels, *([] if self._fits() else [self.warm])):
            shutil.rmtree(kernels, ignore_errors=True)
        if self.warm.exists():
            shutil.copytree(self.warm, self.kernels)

    def _fits(self) -> bool:
        """Whether the kernels that an earlier call left are those of this program: numba looks at single files."""
        stamp = self.warm / STAMP
        return stamp.is_file() and stamp.read_text() == sources()

    def check(self, tests: list[str]) -> None:
        """Compile the kernels, and see that the tests pass: what fails without a mutant tells nothing."""
        if tests not in self.checked:
            end, test = self._end(tests)
            if end != "survived":
                raise SystemExit(f"mutants: expected {tests} to pass without a mutant, got {end}: {test}")
            shutil.rmtree(self.warm, ignore_errors=True)
            shutil.copytree(self.kernels, self.warm)
            (self.warm / STAMP).write_text(sources())
            self.checked.append(tests)

    def run(self, mutant: Mutant) -> Outcome:
        """The outcome of a mutant; the copy is as before afterwards."""
        path = self.root / mutant.path
        status = path.stat()
        for module in reached(mutant.path):
            for compiled in self.kernels.glob(f"*/{module.stem}.*"):
                compiled.unlink()
        path.write_text(mutant.after, encoding="utf-8")
        begin = time.monotonic()
        try:
            end, test = self._end(nearest(mutant.path))
        finally:
            path.write_text(mutant.before, encoding="utf-8")
            os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))  # numba looks at the time
            shutil.rmtree(self.kernels)
            shutil.copytree(self.warm, self.kernels)
        return Outcome(mutant, end, test, time.monotonic() - begin)

    def _end(self, tests: list[str]) -> tuple[str, str]:
        """How tests end, and which failed first."""
        log = self.kernels.with_suffix(".txt")
        running = WARM.Process(target=test, args=(self.root, self.kernels, tests, log))
        running.start()
        running.join(CLOCK_LIMIT)
        if running.is_alive() or running.exitcode == -signal.SIGXCPU:
            with suppress(ProcessLookupError):
                os.killpg(int(running.pid or 0), signal.SIGKILL)
            running.join()
            return "out of time", ""
        if running.exitcode and running.exitcode < 0:
            return "killed", signal.Signals(-running.exitcode).name
        said = log.read_text(encoding="utf-8", errors="replace")
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
        last = (said.strip().splitlines() or [""])[-1]
        return ("killed" if running.exitcode else "survived"), (failed[1] if failed else last)


def test(root: Path, kernels: Path, tests: list[str], log: Path) -> None:
    """In a process of its own: run tests of the copy `root` until one fails; what they say goes to `log`."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_LIMIT, PROCESSOR_LIMIT + 5))
    os.chdir(root)
    sys.path.insert(0, str(root))
    os.environ |= {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(kernels)}
    numba.config.CACHE_DIR = str(kernels)  # type: ignore[attr-defined]
    with log.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    known = ["-W", "ignore:Module already imported"]  # by lightning: hydra, which is a plugin of pytest, too
    sys.exit(pytest.main(["-n", "0", "-x", "-p", "no:cacheprovider", "--tb=no", *known, *tests]))


def nearest(path: Path) -> list[str]:
    """The tests that should see a change of the module `path`."""
    module = "/".join(path.parts[1:])
    return [f"tests/{tests}" for tests in NEAREST[max(filter(module.startswith, NEAREST), key=len)]]


def reached(path: Path) -> set[Path]:
    """The modules whose compiled kernels may hold code of the module `path`: those that import it, directly or not."""
    found, todo = {path}, [path]
    while todo:
        asked = ".".join(todo.pop().with_suffix("").parts)
        new = {module for module, names in imported().items() if asked in names} - found
        found |= new
        todo += new
    return found


@cache
def sources() -> str:
    """SHA-256 of the package."""
    paths = sorted((ROOT / "spgf_torch").rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()


@cache
def imported() -> dict[Path, set[str]]:
    """What every module of the package imports: module, or module and name."""
    found = {}
    for path in sorted((ROOT / "spgf_torch").rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        names = [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
        parts = [f"{n.module}.{a.name}" for n in nodes if isinstance(n, ast.ImportFrom) and n.module for a in n.names]
        found[path.relative_to(ROOT)] = {*names, *parts}
    return found


def outcomes(drawn: list[Mutant], jobs: int) -> list[Outcome]:
    """What becomes of each mutant, shown when known; a package stays with one copy, which compiles its kernels once."""
    packages = [[mutant for mutant in drawn if mutant.path.parts[1] == package] for package in PACKAGES]
    copies: Queue[Copy] = Queue()
    for number in range(jobs):
        copies.put(Copy(number))

    def work(mutants: list[Mutant]) -> list[Outcome]:
        copy, found = copies.get(), []
        try:
            for mutant in mutants:
                copy.check(nearest(mutant.path))
                found.append(copy.run(mutant))
                print(found[-1], flush=True)
        finally:
            copies.put(copy)
        return found

    with ThreadPoolExecutor(jobs) as pool:
        return [outcome for found in pool.map(work, packages) for outcome in found]


def summary(found: list[Outcome]) -> str:
    """Killed mutants of each package and of all, with the 95 % interval of the share (Wilson 1927)."""
    killed = [outcome.end != "survived" for outcome in found]
    low, high = binomtest(sum(killed), len(killed)).proportion_ci(0.95, "wilson")
    packages = {
        package: [k for k, o in zip(killed, found, strict=True) if o.mutant.path.parts[1] == package]
        for package in PACKAGES
    }
    by_package = ", ".join(f"{package} {sum(hits)}/{len(hits)}" for package, hits in packages.items() if hits)
    late = sum(outcome.end == "out of time" for outcome in found)
    share = f"{sum(killed) / len(killed):.0%} (95 % interval {low:.0%} to {high:.0%})"
    return f"{sum(killed)} of {len(killed)} killed, {share}; {late} of them by the limit of time\n{by_package}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--packages", nargs="+", choices=PACKAGES, default=list(PACKAGES))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--show", action="store_true", help="the mutants drawn, none of them tried")
    asked = parser.parse_args()
    drawn = draw(ROOT, asked.packages, asked.count, asked.seed)
    if asked.show:
        print("\n\n".join(mutant.diff() for mutant in drawn))
        return
    OUT.mkdir(parents=True, exist_ok=True)
    found = outcomes(drawn, asked.jobs)
    for outcome in found:
        if outcome.end == "survived":
            print(f"\n{outcome.mutant.diff()}")
    print(f"\n{summary(found)}")


if __name__ == "__main__":
    main()
