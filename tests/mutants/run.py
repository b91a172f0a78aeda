"""Mutation testing of the kernels, the learner, the experiment and the trials (`make mutants`, outside the suite).

Changes one place of the program at a time and runs the nearest tests, which should fail. Cosmic Ray makes the changes.
It is driven from here because its own runner has one test command for all modules and changes files in place, and
because mutmut leaves out decorated functions: all kernels. A mutant lives in a copy of the repository under
`outputs/mutants`. The copy keeps its compiled kernels, but for those that the changed module reaches.

    python tests/mutants/run.py --count 60 --seed 0          # all rooms
    python tests/mutants/run.py --count 9 --rooms ops        # one
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import Queue

from sampling import Mutant, draw
from scipy.stats import binomtest

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "outputs" / "mutants"

# The tests nearest to a room: its own folder, then those of the rooms that stand on it.
NEAREST = {
    "features": ["features", "ops"],
    "ops": ["ops", "features", "prototypes", "affordance"],
    "prototypes": ["prototypes", "ops/test_ops.py"],
    "affordance": ["affordance", "experiment/test_leakage.py", "experiment/test_golden.py"],
    "proposing": ["proposing"],
    "experiment": ["experiment"],
    "simulation": ["trials"],
}

# Seconds of processor time of the tests' process, and of a clock for those that wait for ever.
PROCESSOR_LIMIT, CLOCK_LIMIT = 120, 900

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
        self.checked: set[str] = set()

    def check(self, room: str) -> None:
        """Compile the kernels, and see that the tests pass: what fails without a mutant tells nothing."""
        if room not in self.checked:
            end, test = self._tests(room)
            if end != "survived":
                raise SystemExit(f"mutants: expected the tests of {room} to pass without a mutant, got {end}: {test}")
            shutil.rmtree(self.warm, ignore_errors=True)
            shutil.copytree(self.kernels, self.warm)
            self.checked.add(room)

    def run(self, mutant: Mutant) -> Outcome:
        """The outcome of a mutant; the copy is as before afterwards."""
        path, before = self.root / mutant.path, (ROOT / mutant.path).stat()
        source = mutant.source(ROOT)
        assert source is not None
        for module in reached(mutant.path):
            for compiled in self.kernels.glob(f"*/{module.stem}.*"):
                compiled.unlink()
        path.write_text(source, encoding="utf-8")
        begin = time.monotonic()
        try:
            end, test = self._tests(mutant.path.parts[1])
        finally:
            shutil.copyfile(ROOT / mutant.path, path)
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))  # numba looks at the time
            shutil.rmtree(self.kernels)
            shutil.copytree(self.warm, self.kernels)
        return Outcome(mutant, end, test, time.monotonic() - begin)

    def _tests(self, room: str) -> tuple[str, str]:
        """How the tests of a room end, and which failed first."""
        chosen = [f"tests/{tests}" for tests in NEAREST[room] if (self.root / "tests" / tests).exists()]
        command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-p", "no:cacheprovider", "--tb=no", *chosen]
        environment = {**os.environ, "PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1"}
        environment["NUMBA_CACHE_DIR"] = str(self.kernels)
        running = subprocess.Popen(
            command,
            cwd=self.root,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=_limited,
        )
        try:
            said, _ = running.communicate(timeout=CLOCK_LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL)
            running.wait()
            return "out of time", ""
        if running.returncode == -signal.SIGXCPU:
            return "out of time", ""
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
        last = (said.strip().splitlines() or [""])[-1]
        return ("killed" if running.returncode else "survived"), (failed[1] if failed else last)


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_LIMIT, PROCESSOR_LIMIT + 5))


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
    """What becomes of each mutant, shown when known; a room stays with one copy, which compiles its kernels once."""
    rooms = [[mutant for mutant in drawn if mutant.path.parts[1] == room] for room in NEAREST]
    copies: Queue[Copy] = Queue()
    for number in range(jobs):
        copies.put(Copy(number))

    def work(mutants: list[Mutant]) -> list[Outcome]:
        copy, found = copies.get(), []
        try:
            for mutant in mutants:
                copy.check(mutant.path.parts[1])
                found.append(copy.run(mutant))
                print(found[-1], flush=True)
        finally:
            copies.put(copy)
        return found

    with ThreadPoolExecutor(jobs) as pool:
        return [outcome for found in pool.map(work, rooms) for outcome in found]


def summary(found: list[Outcome]) -> str:
    """Killed mutants of each room and of all, with the 95 % interval of the share (Wilson 1927)."""
    killed = [outcome.end != "survived" for outcome in found]
    low, high = binomtest(sum(killed), len(killed)).proportion_ci(0.95, "wilson")
    rooms = {
        room: [k for k, o in zip(killed, found, strict=True) if o.mutant.path.parts[1] == room] for room in NEAREST
    }
    by_room = ", ".join(f"{room} {sum(hits)}/{len(hits)}" for room, hits in rooms.items() if hits)
    late = sum(outcome.end == "out of time" for outcome in found)
    share = f"{sum(killed) / len(killed):.0%} (95 % interval {low:.0%} to {high:.0%})"
    return f"{sum(killed)} of {len(killed)} killed, {share}; {late} of them by the limit of time\n{by_room}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", nargs="+", choices=NEAREST, default=list(NEAREST))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--show", action="store_true", help="the mutants drawn, none of them tried")
    asked = parser.parse_args()
    drawn = draw(ROOT, asked.rooms, asked.count, asked.seed)
    if asked.show:
        print("\n\n".join(mutant.diff(ROOT) for mutant in drawn))
        return
    OUT.mkdir(parents=True, exist_ok=True)
    found = outcomes(drawn, asked.jobs)
    for outcome in found:
        if outcome.end == "survived":
            print(f"\n{outcome.mutant.diff(ROOT)}")
    print(f"\n{summary(found)}")


if __name__ == "__main__":
    main()
