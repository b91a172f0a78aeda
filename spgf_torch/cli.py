"""What all doors share: Hydra composition, run folders, progress, and one line with status 2 for bad input."""

from __future__ import annotations

import errno
import os
import re
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from hydra import main as hydra_main
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from spgf_torch.config import IncompleteError, InputError, one_line, plain, root, typed
from spgf_torch.multirun import Multirun
from spgf_torch.progress import console
from spgf_torch.reading import reason

T = TypeVar("T")

FULL = (errno.ENOSPC, errno.EDQUOT)


def door(command: str, kind: type[T], run: Callable[[T, Path], None]) -> None:
    """Compose `conf/<command>.yaml` with the command line, check it against `kind`, and call `run(config, folder)`.

    `folder` is a fresh `outputs/<command>/<date-time>_<what varies>/`; `outputs/<command>/latest` points at it once
    `run` has returned. With -m there is one folder a job, and a summary at the end; what a job is refused does not
    stop the others. Exit status: 0 done, 1 not done to the end (one line, what is finished is kept), 2 unusable input
    (one line, no folder left), 130 interrupted.
    """
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # let errors reach us: Hydra's own report spans many lines
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    sys.argv[1:] = sorted(map(with_paths_quoted, sys.argv[1:]), key=_is_override)  # argparse wants all together
    refused: list[InputError | IncompleteError] = []
    multirun = Multirun.of(command)

    started = []

    def task(composed: DictConfig) -> None:
        started.append(command)
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            multirun.job(lambda: _in_run_folder(composed, kind, run))
            return
        try:
            _in_run_folder(composed, kind, run)
        except (InputError, IncompleteError) as error:
            refused.append(error)  # told below, without Hydra's extra line

    try:
        try:
            hydra_main(version_base="1.3", config_path=str(root() / "conf"), config_name=command)(task)()
        finally:
            status = multirun.summary()
        for error in refused:
            raise error
    except (InputError, HydraException, OmegaConfBaseException, YAMLError) as error:
        fail(command, error)
    except IncompleteError as error:
        print(f"{command}: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:  # `... | head` has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except (ValueError, RecursionError) as error:  # what Hydra's parser lets through: `=3`, hundreds of brackets
        if started:
            raise
        fail(command, InputError(f"{' '.join(sys.argv[1:])[:80]}: expected key=value, got {reason(error)}"))
    except OSError as error:
        if not started and error.filename:  # Hydra makes the run's folder
            fail(command, InputError(f"{error.filename}: expected a folder for the run, got {error.strerror}"))
        if error.errno not in FULL:
            raise
        print(f"{command}: {error.filename or Path('outputs').absolute()}: {error.strerror}", file=sys.stderr)
        sys.exit(1)
    except RuntimeError as error:
        if "srun" not in str(error):
            raise
        fail(command, error)  # submitit's own words where there is no Slurm
    except KeyboardInterrupt:
        console.print(f"{command}: interrupted")
        sys.exit(130)
    if status:
        sys.exit(status)


def fail(command: str, error: Exception) -> None:
    """Say what is wrong with the input in one line and leave with status 2."""
    lines = [line.strip() for line in str(error).splitlines()]
    told = re.search(r"Could not override '([^']+)'", str(error))
    if told:
        lines = [f"{told[1]}: expected a setting of {command} (see --help), got an unknown key"]
    if "hydra/launcher/" in str(error):
        lines.append("(joblib, slurm and submitit_local: pip install 'spgf-torch[sweep]')")
    words = [line for line in lines if line and not line.startswith(("full_key:", "object_type=", "reference_type"))]
    print(f"{command}: {one_line(' '.join(words))}", file=sys.stderr)
    sys.exit(2)


def slug(overrides: str) -> str:
    """What varies in a run as part of a folder's name: `K=20,seed=1` stays, slashes and blanks become `-`."""
    kept = "".join(c if c.isalnum() or c in "=.,+-_" else "-" for c in overrides)
    return ("_" + kept.lstrip("+-.")[:80]) if kept else ""


def with_paths_quoted(argument: str) -> str:
    """`model=outputs/train/..._K=20` with quotes around the path, if it is one: Hydra reads only one `=`."""
    key, _, value = argument.partition("=")
    try:
        return f"{key}='{value}'" if "=" in value and Path(value).exists() else argument
    except OSError:  # longer than a path may be
        return argument


def _is_override(argument: str) -> bool:
    return "=" in argument and not argument.startswith("-")


def _in_run_folder(composed: DictConfig, kind: type[T], run: Callable[[T, Path], None]) -> Path:
    folder = Path(HydraConfig.get().runtime.output_dir)
    try:
        config = typed(kind, _own_keys_first(_without_missing_k(composed)))
        (folder / "config.yaml").write_text(OmegaConf.to_yaml(OmegaConf.create(plain(config))))
        run(config, folder)
    except IncompleteError:
        with suppress(OSError):  # the disk may be full
            point_latest(folder)
        raise
    except BaseException as error:
        if {path.name for path in folder.iterdir()} <= {"config.yaml"}:  # nothing done yet that would be lost
            shutil.rmtree(folder)
        if isinstance(error, OSError) and error.errno in FULL:
            raise IncompleteError(f"{error.filename or folder}: {error.strerror}") from error
        raise
    point_latest(folder)
    return folder


def _without_missing_k(composed: DictConfig) -> dict[str, Any]:
    """The composed values; `K`, where the user named none, is the prototype room's default."""
    values: dict[str, Any] = OmegaConf.to_container(composed, resolve=True)  # type: ignore[assignment]
    if values.get("K") == "???":
        values["K"] = values["prototypes"]["num_clusters"]
    return values


def _own_keys_first(values: dict[str, Any]) -> dict[str, Any]:
    """The same with the door's own keys before its rooms', which take some of them: an error names what was given."""
    return dict(sorted(values.items(), key=lambda entry: isinstance(entry[1], dict)))


def point_latest(folder: Path) -> None:
    """Point `latest` beside `folder` at it, in one step."""
    link = folder.parent / f".latest-{os.getpid()}"
    link.unlink(missing_ok=True)
    link.symlink_to(folder.name)
    link.replace(folder.parent / "latest")
