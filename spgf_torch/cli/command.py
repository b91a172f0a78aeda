"""What all commands share: Hydra composition, run folders, progress, and one line with status 2 for bad input."""

from __future__ import annotations

import errno
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from hydra import main as hydra_main
from hydra._internal.hydra import Hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from spgf_torch import __version__
from spgf_torch.cli.command_line import ALIASES, PATHS, translated
from spgf_torch.cli.help_text import help_text
from spgf_torch.cli.json_report import json_on_stdout
from spgf_torch.cli.multirun import Multirun
from spgf_torch.cli.options import as_overrides
from spgf_torch.cli.run_folder import claimed, finished, moved, point_latest
from spgf_torch.errors import IncompleteError, InputError, one_line
from spgf_torch.extras import install
from spgf_torch.files.reading import reason
from spgf_torch.files.run_settings import write_settings
from spgf_torch.paths import root
from spgf_torch.progress import show
from spgf_torch.settings import typed
from spgf_torch.terminal import Ended, UnheardError, ended_by_signals, patient

T = TypeVar("T")

_typed: list[str] = []  # the words of the command that runs

NO_MEMORY = "expected more memory than this machine or the process' limit (ulimit -v) allows"
# How torch, the loader of shared libraries and the system say so.
OUT_OF_MEMORY = ("can't allocate memory", "Cannot allocate memory", "failed to map segment")
FULL = (errno.ENOSPC, errno.EDQUOT)


def run_command(command: str, kind: type[T], run: Callable[[T, Path], None]) -> None:
    """Compose `conf/<command>.yaml` with the command line, check it against `kind`, and call `run(config, folder)`.

    `folder` is a fresh `outputs/<command>/<date-time>_<what varies>/`; `outputs/<command>/latest` points at it once
    `run` has returned. With -m there is one folder a job, and a summary at the end; what a job is refused does not
    stop the others. Exit status: 0 done, also where stdout is not read to the end (`| head`); 1 not done to the end,
    or stdout has no room (one line, what is finished is kept); 2 unusable input (one line, no folder left); 128 and
    the signal's number if interrupted: 130, 143 or 129.
    """
    with json_on_stdout(command):
        try:
            with patient(), ended_by_signals():
                _enter(command, kind, run)
        except UnheardError as error:
            print(f"{command}: stdout: expected room to write, got {error}; results are kept", file=sys.stderr)
            sys.exit(1)


def _enter(command: str, kind: type[T], run: Callable[[T, Path], None]) -> None:
    """Translate the arguments, let Hydra compose, do the work, and leave with the status of how it ended."""
    started: list[str] = []
    try:
        status = _work(command, kind, run, started)
    except (InputError, HydraException, OmegaConfBaseException, YAMLError) as error:
        fail(command, error)
    except IncompleteError as error:
        status = _print_status(f"{command}: {error}", 1)
    except (ValueError, RecursionError) as error:  # what Hydra's parser lets through
        if started:
            raise
        fail(command, InputError(f"{' '.join(sys.argv[1:])[:80]}: expected key=value, got {reason(error)}"))
    except (MemoryError, ImportError, RuntimeError, OSError) as error:
        status = _of_the_machine(command, error, bool(started))
    except Ended as error:
        status = _print_status(_with_notes(f"{command}: ended by {error}", error), 128 + error.number)
    except KeyboardInterrupt as error:
        status = _print_status(_with_notes(f"{command}: interrupted", error), 130)
    if status:
        sys.exit(status)


def _of_the_machine(command: str, error: Exception, started: bool) -> int:
    """The status of what the machine lacks: memory, a folder, room on the disk, Slurm; anything else is raised."""
    if _no_memory(error):
        return _print_status(f"{command}: {NO_MEMORY}", 1)
    if isinstance(error, RuntimeError) and "srun" in str(error):
        fail(command, error)  # submitit's own words where there is no Slurm
    if not isinstance(error, OSError):
        raise error
    if not started:  # Hydra makes the run's folder
        place = error.filename or "working folder"
        fail(command, InputError(f"{place}: expected a folder for the run, got {error.strerror}"))
    if error.filename is None and error.errno not in FULL:
        raise error
    return _print_status(f"{command}: {error.filename or Path('outputs').absolute()}: {error.strerror}", 1)


def _no_memory(error: Exception) -> bool:
    return isinstance(error, MemoryError) or any(words in str(error) for words in OUT_OF_MEMORY)


def _with_notes(line: str, error: BaseException) -> str:
    """A line and what was noted of an exception on its way: where the work that is done lies."""
    return "; ".join([line, *getattr(error, "__notes__", ())])


def _print_status(line: str, status: int) -> int:
    print(one_line(line), file=sys.stderr)
    return status


def _work(command: str, kind: type[T], run: Callable[[T, Path], None], started: list[str]) -> int:
    """One run, or the jobs of a sweep: the exit status. The first that begins adds to `started`."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # let errors reach us: Hydra's own report spans many lines
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    if "--version" in sys.argv[1:]:
        print(f"spgf_torch {__version__}")
        return 0
    if {"--help", "-h"} & set(sys.argv[1:]):
        show(help_text(command, kind))
        return 0
    _typed[:] = "spgf", command, *sys.argv[1:]
    sys.argv[1:] = translated(command, kind, as_overrides(command, kind, sys.argv[1:]))
    refused: list[InputError | IncompleteError] = []
    multirun = Multirun.of(command)

    def task(composed: DictConfig) -> None:
        started.append(command)
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            multirun.job(lambda: _in_run_folder(composed, kind, run))
            return
        try:
            _in_run_folder(composed, kind, run)
        except (InputError, IncompleteError) as error:
            refused.append(error)  # printed later, without Hydra's extra line
        except (MemoryError, ImportError, RuntimeError, OSError) as error:
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise error.__cause__ from None  # of the import of a compiled module: it makes an ImportError of them
            if not _no_memory(error):
                raise
            refused.append(IncompleteError(NO_MEMORY))

    try:
        with _composed_once():
            hydra_main(version_base="1.3", config_path=str(root() / "conf"), config_name=command)(task)()
    finally:
        status = multirun.summary()
    for error in refused:
        raise error
    return status


@contextmanager
def _composed_once() -> Iterator[None]:
    """Keep Hydra from composing all settings a time more, 0.3 s, to see `hydra.mode`: only arguments set it."""
    its: Any = Hydra.get_mode
    if not any("hydra.mode" in word for word in sys.argv[1:]):
        Hydra.get_mode = lambda *_, **__: None  # type: ignore[method-assign]
    try:
        yield
    finally:
        Hydra.get_mode = its  # type: ignore[method-assign]


def command_line() -> str:
    """What was typed, as it can be typed again; empty where no command runs."""
    return shlex.join(_typed)


def fail(command: str, error: Exception) -> NoReturn:
    """Say what is wrong with the input in one line and leave with status 2."""
    lines = [line.strip() for line in str(error).splitlines()]
    if "hydra/launcher/" in str(error):
        lines.append(f"(joblib, slurm and submitit_local: {install('sweep')})")
    words = [line for line in lines if line and not line.startswith(("full_key:", "object_type=", "reference_type"))]
    line = _no_option(" ".join(words)) or one_line(" ".join(words))
    for alias, name in ALIASES.items():  # as it was given
        line = re.sub(rf"^{name}(?=: )", alias, line)
    print(f"{command}: {line}", file=sys.stderr)
    sys.exit(2)


def _no_option(words: str) -> str:
    """Hydra's words for an option that a group of conf/ has not, in ours; empty for any others."""
    found = re.search(
        r"Could not find '([^']+)/([^/']*)' Available options in '[^']*': (.*?) ?Config search path", words
    )
    if not found or "/" in found[1]:
        return ""
    group, got, options = found[1], found[2], found[3].split()
    near = get_close_matches(got, options, 1)
    file = ", or a description (FILE.yaml)" if group == "hand" else ""
    hint = f"; did you mean {near[0]}?" if near else ""
    return f"{group}: expected one of {', '.join(options)}{file}; got {got or 'none'}{hint}"


def slug(overrides: str) -> str:
    """What varies in a run as part of a folder's name: `K=20,seed=1` stays, slashes and blanks become `-`."""
    kept = "".join(c if c.isalnum() or c in "=.,+-_" else "-" for c in overrides)
    return ("_" + kept.lstrip("+-.")[:80]) if kept else ""


def _in_run_folder(composed: DictConfig, kind: type[T], run: Callable[[T, Path], None]) -> Path:
    with claimed() as folder:
        config: Any = _config(kind, composed)
        try:
            write_settings(folder, config)
            run(config, folder)
        except IncompleteError:
            _point(folder)
            raise
        except OSError as error:
            if error.errno in FULL:
                raise IncompleteError(f"{error.filename or folder}: {error.strerror}") from error
            raise
    _point(folder)
    return folder


def _point(folder: Path) -> None:
    finished.append(folder)
    if not moved():
        point_latest(folder)


def _config(kind: type[T], composed: DictConfig) -> T:
    """The settings, checked. A path may have `${` in its name, which nothing else may."""
    values = _own_keys_first(_without_missing_k(composed))
    literal = {key: values[key] for key in PATHS & values.keys() if "${" in str(values[key])}
    config = typed(kind, {**values, **dict.fromkeys(literal, "literal")})
    for key, value in literal.items():
        setattr(config, key, value)
    return config


def _without_missing_k(composed: DictConfig) -> dict[str, Any]:
    """The composed values; `K`, where the user named none, is the default of `conf/prototypes`."""
    values: dict[str, Any] = OmegaConf.to_container(composed, resolve=True)  # type: ignore[assignment]
    if values.get("K") == "???":
        values["K"] = values["prototypes"]["num_clusters"]
    return values


def _own_keys_first(values: dict[str, Any]) -> dict[str, Any]:
    """Move the command's own keys before its groups', which copy some of them: an error names the given one."""
    return dict(sorted(values.items(), key=lambda entry: isinstance(entry[1], dict)))
