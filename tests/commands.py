"""Commands from the outside: each in a process of its own, several in one that does nothing else, or in ours."""

import json
import os
import runpy
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from hydra.core.singleton import Singleton

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


def here(command: str, *overrides: str, cwd: Path) -> subprocess.CompletedProcess:
    """Run a command, or a file that is one, in `cwd` in this process: one of its own costs seconds of imports."""
    out, said, status = StringIO(), StringIO(), 0
    module = f"spgf_torch.{command}"
    with chdir(cwd), process_kept(), not_imported(module), redirect_stdout(out), redirect_stderr(said):
        sys.argv = [command, *overrides]
        os.environ.setdefault("SPGF_OPS", "compiled")  # what follows in this process has more to do than one prediction
        try:
            if command.endswith(".py"):
                runpy.run_path(command, run_name="__main__")
            else:
                runpy.run_module(module, run_name="__main__", alter_sys=True)
        except SystemExit as left:
            status = left.code if isinstance(left.code, int) else 0
    return subprocess.CompletedProcess([command, *overrides], status, out.getvalue(), said.getvalue())


@contextmanager
def process_kept() -> Iterator[None]:
    """Arguments, environment and Hydra's state are put back."""
    words, variables = sys.argv, dict(os.environ)
    known = Singleton.get_state()["instances"].copy()
    try:
        yield
    finally:
        sys.argv = words
        os.environ.clear()
        os.environ.update(variables)
        Singleton.get_state()["instances"].clear()
        Singleton.get_state()["instances"].update(known)


@contextmanager
def not_imported(module: str) -> Iterator[None]:
    """As in a new process, which runs the module without another having imported it; `runpy` warns otherwise."""
    known = sys.modules.pop(module, None)
    try:
        yield
    finally:
        if known is not None:
            sys.modules[module] = known
