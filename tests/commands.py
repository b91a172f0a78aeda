"""Commands from the outside, each in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def python(*arguments: str, cwd: Path, **variables: str | None) -> subprocess.CompletedProcess:
    """Run Python in `cwd` with this package importable; a variable of the environment that is None is not set."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120", **variables}
    kept = {name: value for name, value in environment.items() if value is not None}
    return subprocess.run([sys.executable, *arguments], cwd=cwd, env=kept, capture_output=True, text=True, timeout=200)


def call(command: str, *overrides: str, cwd: Path, **variables: str | None) -> subprocess.CompletedProcess:
    """Run a command in `cwd`."""
    return python("-m", f"spgf_torch.{command}", *overrides, cwd=cwd, **variables)
