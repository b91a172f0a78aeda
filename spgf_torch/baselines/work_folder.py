"""Where folds in training stand until a run is done: a folder for each kind of run, named by all that it depends on."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spgf_torch.errors import InputError
from spgf_torch.progress import console


@contextmanager
def claimed(checkpoints: Path, provenance: str) -> Iterator[Path]:
    """The folder of the run `provenance`, which no other run uses meanwhile; the system unlocks it however a run ends.

    Raises InputError where it cannot be made, or another run of the same settings is at work in it.
    """
    folder = checkpoints / provenance[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise InputError(f"checkpoints: expected a folder that can be made, got {folder} ({error.strerror})") from None
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"checkpoints: expected no other run of these settings, got one in {folder}") from None
        if any(folder.iterdir()):
            console.print(f"baseline: going on with what a run that was cut off left in {folder}")
        yield folder
    finally:
        os.close(lock)


def hand_over(work: Path, folder: Path) -> None:
    """Move the finished folds into the run's folder."""
    for path in sorted(work.iterdir()):
        shutil.move(path, folder / path.name)
    shutil.rmtree(work)
