"""What the jobs of one call with `-m` share, in this process or in others: a label, threads, and how each ended."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from spgf_torch.cli.run_folder import finished
from spgf_torch.errors import IncompleteError, InputError
from spgf_torch.progress import console, show, take_turns


@dataclass(frozen=True)
class Multirun:
    """Travels to the jobs, wherever a launcher runs them; each leaves a note of how it ended.

    Attributes:
        command: its name.
        process: the one that was called.
        notes: folder of one JSON file a job, gone after `summary`; on a cluster all nodes see it.
    """

    command: str
    process: int
    notes: Path

    @staticmethod
    def of(command: str) -> Multirun:
        """For a call of `command` by this process in this working folder."""
        return Multirun(command, os.getpid(), Path.cwd() / "outputs" / command / f".multirun-{uuid4().hex}")

    def job(self, run: Callable[[], Path]) -> None:
        """Run one job, `run() -> its folder`. Unusable input gives one line; the other jobs go on."""
        hydra = HydraConfig.get()
        number, overrides = int(hydra.job.num), list(hydra.overrides.task)
        if os.getpid() != self.process:
            take_turns(f"{number}: ")
            _keep_to_own_cores(hydra.launcher)
        console.print(f"job {number}: {' '.join(overrides)}")
        note: dict[str, Any] = {"job": number, "overrides": overrides}
        try:
            note["folder"] = str(run())
        except InputError as error:
            note["refused"] = str(error)
            print(f"{self.command}: job {number}: {error}", file=sys.stderr)
        except IncompleteError as error:
            note["incomplete"] = str(error)
            print(f"{self.command}: job {number}: {error}", file=sys.stderr)
        self.notes.mkdir(parents=True, exist_ok=True)
        (self.notes / f"{number}.json").write_text(json.dumps(note))

    def summary(self) -> int:
        """Show a line a job: what sets it apart, its rate, its folder. The exit status that they come to."""
        notes = [json.loads(path.read_text()) for path in self.notes.glob("*.json")]
        shutil.rmtree(self.notes, ignore_errors=True)
        notes.sort(key=lambda note: note["job"])
        elsewhere = [Path(note["folder"]) for note in notes if "folder" in note]
        finished.extend(folder for folder in elsewhere if folder not in finished)
        for line in lines(notes):
            show(line)
        return 2 if any("refused" in note for note in notes) else int(any("incomplete" in note for note in notes))


def lines(notes: list[dict[str, Any]]) -> list[str]:
    """The summary of jobs with these notes; what all of them have in common is left out."""
    common = set.intersection(*(set(note["overrides"]) for note in notes)) if len(notes) > 1 else set()
    names = [" ".join(o for o in note["overrides"] if o not in common) or f"job {note['job']}" for note in notes]
    width = max(map(len, names), default=0)
    return [f"{name:{width}}  {_outcome(note)}" for name, note in zip(names, notes, strict=True)]


def _outcome(note: dict[str, Any]) -> str:
    if "refused" in note:
        return f"not run: {note['refused']}"
    if "incomplete" in note:
        return f"not done: {note['incomplete']}"
    results = Path(note["folder"]) / "results.json"
    content = json.loads(results.read_text()) if results.is_file() else {}
    rate = content.get("success_rate", {}).get("all", {}).get("CG")
    figure = "" if rate is None else f"all CG {100 * rate:5.1f} % ({content['ranking']})  "
    return figure + os.path.relpath(note["folder"])


def _keep_to_own_cores(launcher: DictConfig) -> None:
    """As many threads as the launcher gives the job cores.

    Joblib's processes share the machine's cores by themselves (OMP_NUM_THREADS, which wins where it is set).
    """
    cores = launcher.get("cpus_per_task")
    if cores and "OMP_NUM_THREADS" not in os.environ:
        import torch

        torch.set_num_threads(cores)


class Announce(Callback):
    """Says where to look while jobs run out of sight."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        folder = config.hydra.launcher.get("submitit_folder")
        if folder:
            console.print(f"jobs run elsewhere; what they say is in {folder} (%j: number of the job)")
