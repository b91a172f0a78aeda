"""`--json`: what a call came to, as one JSON object, alone on stdout; all that is said goes to stderr."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from spgf_torch import __version__
from spgf_torch.cli.batch import named
from spgf_torch.cli.run_folder import SETTINGS, finished

FLAG = "--json"
# Files of a run that hold its results.
RESULTS = ("grasps.json", "results.json")


@contextmanager
def json_on_stdout(command: str) -> Iterator[None]:
    """With `--json` among the arguments, which is removed, print the report of what ran within; else do nothing.

    The descriptor of stdout is that of stderr meanwhile, also for libraries and other processes.
    """
    if FLAG not in sys.argv[1:]:
        yield
        return
    sys.argv.remove(FLAG)
    with suppress(OSError, ValueError, AttributeError):  # closed by the caller
        sys.stdout.flush()
    stdout = os.dup(1)
    os.dup2(2, 1)
    status: Any = 1  # of what nobody expected
    try:
        yield
        status = 0
    except SystemExit as left:
        status = left.code or 0
        raise
    finally:
        with suppress(OSError, ValueError, AttributeError):
            sys.stdout.flush()
        os.dup2(stdout, 1)
        report = {"schema": 1, "command": command, "version": __version__, "status": status, "runs": _runs()}
        with suppress(BrokenPipeError), os.fdopen(stdout, "w", encoding="utf-8") as out:
            out.write(json.dumps(report, ensure_ascii=True) + "\n")


def _runs() -> list[dict[str, Any]]:
    """A folder with what it was made of and its results each; of a batch, a folder an input that was done."""
    found = []
    for folder in finished:
        known = yaml.safe_load((folder / SETTINGS).read_text(encoding="utf-8")) or {}
        given = known.get("input")
        parts = {folder: given}
        if known.get("batch"):
            files = given if isinstance(given, list) else [given]
            parts = {folder / name: file for name, file in zip(named(files), files, strict=True)}
            parts = {part: file for part, file in parts.items() if (part / RESULTS[0]).is_file()}
        found += [{"folder": str(part), "input": file, "results": _results(part)} for part, file in parts.items()]
    return found


def _results(folder: Path) -> Any:
    """What the results' file of a run holds; None of a run that leaves none."""
    path = next((folder / name for name in RESULTS if (folder / name).is_file()), None)
    return None if path is None else json.loads(path.read_text(encoding="utf-8"))
