"""The folder of a run: its own, new or empty; what was there before this call is never written to or removed.

`Check` looks before Hydra makes anything; `claimed` is the folder while the run lasts; `point_latest` follows it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from spgf_torch.errors import InputError, one_line
from spgf_torch.files.run_settings import SETTINGS
from spgf_torch.progress import console

# Keys of Hydra that move a run's folder from its usual place, where no other run writes.
MOVED = ("hydra.run.dir=", "hydra.sweep.dir=", "hydra.sweep.subdir=", "hydra.job.name=")
# What Hydra writes into its own folder in a run's (hydra.output_subdir).
HYDRAS = ("config.yaml", "hydra.yaml", "overrides.yaml")

# Folders on the way to the run's that this call has made, the innermost first: written by `Check`, read by `claimed`.
_made: list[Path] = []
# Folders of the runs of this call that have something to tell, in order: for `--json`.
finished: list[Path] = []


class Check(Callback):
    """Refuses a folder in which there is something, in one line and with status 2, before Hydra writes into it."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Look at `hydra.run.dir`."""
        _look(config, "hydra.run.dir")

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Look at `hydra.sweep.dir`, into which Hydra writes `multirun.yaml`, unless it is the usual one."""
        if any(given.lstrip("+").startswith("hydra.sweep.dir=") for given in config.hydra.overrides.hydra):
            _look(config, "hydra.sweep.dir")


def _look(config: DictConfig, key: str) -> None:
    folder = Path(str(OmegaConf.select(config, key)))
    try:
        got = "one that is not empty" if folder.is_dir() and any(folder.iterdir()) else ""
        got = "a file" if not got and not folder.is_dir() and os.path.lexists(folder) else got
        _made[:] = [path for path in (folder, *folder.parents) if not path.exists()]
    except OSError as error:
        got = f"{error.strerror}"
    if got:
        # Hydra turns an ordinary exception of a callback into a warning, and goes on.
        line = f"{folder}: expected a new or an empty folder for the run ({key}), got {got}"
        print(f"{config.hydra.job.name}: {one_line(line)}", file=sys.stderr)
        sys.exit(2)


@contextmanager
def claimed() -> Iterator[Path]:
    """The run's folder, with an empty `config.yaml` that says whose it is.

    What raises before anything else is written leaves no folder behind, as far as this call made it. Raises InputError
    for a folder in which there is something.
    """
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    ours = {SETTINGS, *([hydra.output_subdir] if hydra.output_subdir else [])}
    single = hydra.mode == RunMode.RUN
    # A job of a sweep is in a folder with the time in its name, unless set otherwise; Hydra made it just now.
    made = [path.absolute() for path in _made] if single else [] if moved("hydra.sweep.subdir=") else [folder]
    try:
        if {path.name for path in folder.iterdir()} - (ours - {SETTINGS}):
            raise InputError(f"{folder}: expected a new or an empty folder for the run, got one that is not empty")
        (folder / SETTINGS).touch(exist_ok=False)
    except FileExistsError:
        raise InputError(f"{folder}: expected a folder of its own for the run, got another run's") from None
    try:
        yield folder
    except BaseException:
        with suppress(OSError):
            if {path.name for path in folder.iterdir()} <= ours:  # nothing done yet that would be lost
                _leave(folder, hydra.output_subdir, made)
        raise


def _leave(folder: Path, subfolder: str | None, made: list[Path]) -> None:
    """Remove what this call wrote, and the folders that it made, as far as nothing else is in them."""
    (folder / SETTINGS).unlink(missing_ok=True)
    if subfolder:
        for name in HYDRAS:
            (folder / subfolder / name).unlink(missing_ok=True)
        (folder / subfolder).rmdir()
    for path in made:
        path.rmdir()


def moved(*keys: str) -> bool:
    """Whether the call set one of Hydra's `keys` (default: any that moves a run's folder)."""
    given = [str(override).lstrip("+") for override in HydraConfig.get().overrides.hydra]
    return any(override.startswith(keys or MOVED) for override in given)


def point_latest(folder: Path) -> None:
    """Point `latest` beside `folder` at it, in one step; a line where something else is in its place.

    A folder that the call put elsewhere has none.
    """
    latest, link = folder.parent / "latest", folder.parent / f".latest-{os.getpid()}"
    try:
        if latest.exists() and not latest.is_symlink():
            raise OSError(0, f"there is a {'folder' if latest.is_dir() else 'file'} of that name")
        link.unlink(missing_ok=True)
        link.symlink_to(folder.name)
        link.replace(latest)
    except OSError as error:
        with suppress(OSError):
            link.unlink(missing_ok=True)
        console.print(f"{latest}: not pointed at this run, {error.strerror or error}; the results are in {folder}")
