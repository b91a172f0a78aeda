"""A command in this process, as the shell runs it: settings, the call, and what it must be when the input is bad.

Every case gives one line that names what is wrong and says what was expected and got, exit status 2, no file left
behind, within bounds of time and memory.
"""

from __future__ import annotations

import copy
import importlib
import json
import resource
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from composing import composed as hydras
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import FORMAT, SCHEMA
from spgf_torch.cli.command import fail
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.scene.config import PredictConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import plain, settings, typed
from spgf_torch.simulation.config import SimulateConfig

ROOT = Path(__file__).parents[2]
KINDS = {
    "predict": PredictConfig,
    "train": TrainConfig,
    "simulate": SimulateConfig,
    "evaluate": EvaluateConfig,
    "report": ReportConfig,
}
FREE = ("model", "objects", "trials", "mesh", "cache")  # text that no check looks at; given as it may be
SECONDS = 10.0  # for one case; the machine may be busy
MEGABYTES = 400  # that one case may add to the most that this process has held
RESERVED = 8 << 30  # bytes of address space beyond what is there: a bomb that goes off fails here, not the machine

Write = Callable[[Path], Any]


@dataclass(frozen=True)
class Case:
    """One bad input: what it is called, the settings that name it, its file, and words that must be said."""

    name: str
    changes: Mapping[str, Any]
    write: Write
    words: tuple[str, ...]


def table(cases: list[Case]) -> Any:
    """The cases as parameters with their names."""
    assert len({case.name for case in cases}) == len(cases)
    return pytest.mark.parametrize("case", cases, ids=[case.name for case in cases])


@cache
def defaults(command: str) -> dict[str, Any]:
    """The settings of a command, as Hydra composes them."""
    given = {"train": ["K=4"], "predict": ["input=none"], "evaluate": ["objects=none"]}.get(command, [])
    values: dict[str, Any] = hydras(command, *given)
    return values


def composed(command: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The same with changes, whose keys are dotted."""
    values = copy.deepcopy(defaults(command))
    for key, value in changes.items():
        *rooms, name = key.split(".")
        inner = values
        for room in rooms:
            inner = inner[room]
        inner[name] = value
    return values


@cache
def _usual(command: str) -> Any:
    return typed(KINDS[command], defaults(command))


def config_of(command: str, changes: Mapping[str, Any]) -> Any:
    """The typed settings; where only keys of any type change, the usual ones with these: hundreds of times faster."""
    anything = {entry.name for entry in fields(KINDS[command]) if entry.type == "Any" or entry.name in FREE}
    if set(changes) <= anything:
        return replace(_usual(command), **changes)
    return typed(KINDS[command], composed(command, changes))


def refused(command: str, changes: Mapping[str, Any], words: tuple[str, ...], capsys: pytest.CaptureFixture) -> str:
    """The command refuses; its line holds all the words. Returns the line."""
    if command == "predict":
        changes = {"model": "no-model", **changes}  # what is not refused must not find one
    folder = Path("outputs")
    folder.mkdir()
    run = importlib.import_module(f"spgf_torch.{command}").run
    return told(command, lambda: run(config_of(command, changes), folder), words, capsys)


def told(command: str, call: Callable[[], Any], words: tuple[str, ...], capsys: pytest.CaptureFixture) -> str:
    """What a command does with a call that refuses its input: the line."""
    before = tree()
    capsys.readouterr()
    with pytest.raises(SystemExit) as left, bounded():
        try:
            call()
        except (InputError, HydraException, OmegaConfBaseException, YAMLError) as error:
            fail(command, error)
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith(f"{command}: ")]
    assert left.value.code == 2 and tree() == before
    assert len(said) == 1 and len(said[0]) < 1100 and said[0].isprintable(), said
    assert "no-model" not in said[0], "not refused"
    assert all(word in said[0] for word in words), said[0]
    return said[0]


def tree() -> dict[str, int]:
    """Everything below the working folder, with sizes."""
    return {str(path): path.lstat().st_size if path.is_file() else -1 for path in sorted(Path().rglob("*"))}


@contextmanager
def bounded() -> Iterator[None]:
    """Fails where what is done takes more than `SECONDS` or lifts this process' memory by more than `MEGABYTES`."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = signal.signal(signal.SIGALRM, _late)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + RESERVED, hard))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    added = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) / 1024
    assert added < MEGABYTES, f"{added:.0f} MB"


def _late(*_: Any) -> None:
    raise TimeoutError(f"more than {SECONDS:g} s")


@cache
def model_document() -> dict[str, Any]:
    """`model.json` of a model with the usual settings."""
    rooms = (SensingConfig, FeatureConfig, PrototypeConfig, AffordanceConfig, HandConfig)
    known = dict(zip(("sensing", "features", "prototypes", "affordance", "hand"), rooms, strict=True))
    made = {name: plain(settings(kind)) for name, kind in known.items()}
    lattice = {key: made["affordance"][key] for key in ("reach", "voxel", "rotation_deg")}
    about = {"format": FORMAT, "schema": SCHEMA, "lattice": lattice, "settings": made}
    return about | {"grasp_types": ["NPG", "WPG"]}


# How a file comes about.


def raw(content: bytes | str) -> Write:
    return lambda path: path.write_bytes(content if isinstance(content, bytes) else content.encode())


def lines(*words: object) -> Write:
    return raw("\n".join(map(str, words)) + "\n")


def as_json(values: object) -> Write:
    return raw(json.dumps(values))


def nothing(path: Path) -> None:
    """No file."""
