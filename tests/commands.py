"""Commands from the outside, each in a process of its own, or several in one that does nothing else."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Status, output, messages, and which of some modules have been loaded until then, of each command line.
IN_TURN = """
import contextlib, io, json, runpy, sys
lines, modules = json.loads(sys.argv[1])
for program, *arguments in lines:
    sys.argv, out, said, status = [program, *arguments], io.StringIO(), io.StringIO(), 0
    start = runpy.run_path if program.endswith(".py") else runpy.run_module
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
            start(program, run_name="__main__")
    except SystemExit as left:
        status = left.code or 0
    print(json.dumps([status, out.getvalue(), said.getvalue(), [m for m in modules if m in sys.modules]]))
"""


def python(*arguments: str, cwd: Path, **variables: str | None) -> subprocess.CompletedProcess:
    """Run Python in `cwd` with this package importable; a variable of the environment that is None is not set."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120", **variables}
    kept = {name: value for name, value in environment.items() if value is not None}
    return subprocess.run([sys.executable, *arguments], cwd=cwd, env=kept, capture_output=True, text=True, timeout=200)


def call(command: str, *overrides: str, cwd: Path, **variables: str | None) -> subprocess.CompletedProcess:
    """Run a command in `cwd`."""
    return python("-m", f"spgf_torch.{command}", *overrides, cwd=cwd, **variables)


@dataclass(frozen=True)
class Ended:
    """How a command line ended; `loaded`: those of the modules asked for that it or one before it has loaded."""

    returncode: int
    stdout: str
    stderr: str
    loaded: list[str]


def in_turn(*lines: Sequence[str], cwd: Path, modules: Sequence[str] = ()) -> list[Ended]:
    """Run command lines one after the other in one process: where starting Python is not the point, that costs half.

    A line begins with a file, or with a module's name.
    """
    done = python("-c", IN_TURN, json.dumps([lines, modules]), cwd=cwd)
    assert done.returncode == 0, done.stderr
    ended = [Ended(*json.loads(line)) for line in done.stdout.splitlines()]
    assert len(ended) == len(lines)
    return ended
