"""Runs of `train` as their folders tell them: typed records, and a line about every run that cannot be used."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError, one_line
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.files import FILES
from spgf_torch.evaluation.results import read_results
from spgf_torch.evaluation.success import ALL, Rates
from spgf_torch.files.checks import name as checked_name
from spgf_torch.files.checks import number
from spgf_torch.files.digests import digest_of
from spgf_torch.files.reading import existing, yaml_values
from spgf_torch.hands.config import HandConfig, grasp_types
from spgf_torch.objects.config import CLASSES
from spgf_torch.paths import find
from spgf_torch.progress import console
from spgf_torch.settings import typed

Block = dict[str, Rates]  # class (and "all") -> type -> rate
Bounds = dict[str, dict[str, tuple[float, float]]]  # class -> type -> (low, high)
Tell = Callable[[str], None]  # takes a line for the person who asked for the report

_STAMP = re.compile(r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d(\.\d+)?(_\d+)?")


@dataclass(frozen=True)
class Notes:
    """What could not be used, a line each: told at once, and kept for the page."""

    lines: list[str] = field(default_factory=list)

    def __call__(self, line: str) -> None:
        self.lines.append(one_line(line))  # names of folders and files may hold anything
        console.print(f"report: {self.lines[-1]}")


# What the report needs of a run's settings; the learned baseline's have no features.
_PICTURED = {"objects": str, "sensing": dict, "features": dict, "hand": dict}
FEW = 3  # runs of other data that are told by name
MOST = 2**53  # of counts and seeds: beyond it JSON's numbers are not exact


@dataclass(frozen=True)
class Run:
    """What one run left.

    Attributes:
        stamp: when it was started, as text that sorts by time.
        settings: its `config.yaml`.
        dataset: digest over its objects and trials; None of runs that are too old to say.
        digests: file name -> SHA-256 of files that have no room for one; empty of older runs.
        by_ranking, interval95: ranking -> rates as fractions, and their 95 % intervals.
        chosen: fold -> the ranking that nested cross-validation chose there; empty of older runs.
        calibration, calibration_free: grasp type -> Brier score and expected calibration error of each of
            `evaluation.reliability.PREDICTORS`, on all candidates and on those without a sensed collision; empty of
            older runs.
    """

    folder: Path
    stamp: str
    settings: dict[str, Any]
    K: int
    N: int
    seed: int
    dataset: str | None
    by_ranking: dict[str, Block]
    interval95: dict[str, Bounds]
    random: Block
    random_collision_free: Block
    ceiling: Block
    chosen: dict[int, str]
    calibration: dict[str, dict[str, float]]
    digests: dict[str, str] = field(default_factory=dict)
    calibration_free: dict[str, dict[str, float]] = field(default_factory=dict)

    @cached_property
    def grasp_types(self) -> tuple[str, ...]:
        """Those of the hand, sorted."""
        return tuple(sorted(self.random["all"]))

    @property
    def types(self) -> tuple[str, ...]:
        """What rates are of: each grasp type, and CG."""
        return (*self.grasp_types, ALL)

    @property
    def of_papers_hand(self) -> bool:
        """Whether the paper's rates may stand beside these: they are of its hand and of its grasp types."""
        hand = self.settings.get("hand")
        return isinstance(hand, dict) and hand.get("name") == paper.HAND and self.grasp_types == paper.TYPES

    @property
    def has_model(self) -> bool:
        return (self.folder / "model.safetensors").is_file()

    @property
    def keeps_folds(self) -> bool:
        """Whether it kept the models of its folds."""
        from spgf_torch.experiment.held_out import FOLDER, LIST  # brings torch, which a missing folder does without

        return (self.folder / FOLDER / LIST).is_file()


@dataclass(frozen=True)
class ObjectRow:
    """One object of `per_object.csv`: its class, fold, and ranking -> rates."""

    name: str
    category: str
    fold: int
    rates: dict[str, Rates]


def load_runs(runs: Any, tell: Tell, pictured: bool = False) -> list[Run]:
    """The runs in a run folder, a folder of runs, or a list of either; oldest first.

    Every run that is interrupted or damaged, or made from other data than the newest one, is told in a line and left
    out; with `pictured` also those whose settings lack what the report shows. Raises InputError where a folder does
    not exist or holds no run, or where nothing is left.
    """
    folders = {folder.resolve(): folder for given in _listed(runs) for folder in _run_folders(given)}.values()
    loaded = []
    for folder in folders:
        try:
            run = read_run(folder)
            if pictured:
                _check_pictured(run)
            loaded.append(run)
        except InputError as error:
            tell(f"left out: {error}")
    if not loaded:
        raise InputError(f"runs: expected at least one finished run of train, got none in {_words(runs)}")
    loaded.sort(key=lambda run: run.stamp)
    return _of_one_dataset(loaded, tell)


def read_run(folder: Path) -> Run:
    """One run. Raises InputError where it was interrupted or a file of it is damaged."""
    if not (folder / "results.json").is_file():
        raise InputError(f"{folder}: expected results.json, got an interrupted run")
    results = read_results(folder / "results.json")
    try:
        digests = {str(name): str(digest) for name, digest in results.get(FILES, {}).items()}
        settings = _settings(_as_written(folder / "config.yaml", digests))
        _check_rates(results)
        _check_spent(results)
        return Run(
            folder=folder,
            stamp=_stamp(folder),
            settings=settings,
            K=_count(results, "K"),
            N=_count(results, "N"),
            seed=_count(results, "seed"),
            dataset=results.get("dataset"),
            by_ranking={name: _block(block) for name, block in results["by_ranking"].items()},
            interval95={name: _bounds(block) for name, block in results["interval95_by_ranking"].items()},
            random=_random(results["random"]),
            random_collision_free=_block(results["random_collision_free"]),
            ceiling=_block(results["ceiling"]),
            chosen={int(fold): checked_name(of, "chosen") for fold, of in results.get("chosen", {}).items()},
            calibration=_of_types(results, "calibration"),
            calibration_free=_of_types(results, "calibration_free"),
            digests=digests,
        )
    except InputError as error:
        told = str(error)
        raise InputError(told if told.startswith(str(folder)) else f"{folder / 'results.json'}: {told}") from None
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{folder / 'results.json'}: expected the results of train, got {_told(error)}") from None


def read_per_object(run: Run) -> list[ObjectRow]:
    """The objects of a run. Raises InputError where `per_object.csv` is missing or damaged."""
    path = run.folder / "per_object.csv"
    if not path.is_file():
        raise InputError(f"{path}: expected the rates of each object, got no such file")
    _as_written(path, run.digests)
    try:
        with path.open(newline="") as file:
            rows = [_object_row(row, run) for row in csv.DictReader(file)]
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: expected the rates of each object, got {_told(error)}") from None
    if not rows:
        raise InputError(f"{path}: expected the rates of each object, got no row")
    return rows


def _listed(runs: Any) -> list[Path]:
    """`runs` as folders that exist."""
    given = [runs] if isinstance(runs, str) else list(runs) if isinstance(runs, Sequence) else []
    if not given or not all(isinstance(entry, str) for entry in given):
        raise InputError(f"runs: expected a folder or a list of folders, got {runs}")
    for entry in given:
        if not find(entry).is_dir():
            raise InputError(f"runs: expected a folder of runs (train leaves them in outputs/train), got {entry}")
    return [find(entry) for entry in given]


def _run_folders(folder: Path) -> Iterator[Path]:
    """The folder itself if it is a run's, else those in it; the link `latest` is no run of its own."""
    if _is_run(folder):
        yield folder.resolve() if folder.is_symlink() else folder  # `latest` has no date in its name
        return
    found = [entry for entry in sorted(folder.iterdir()) if _is_run(entry) and not entry.is_symlink()]
    if not found:
        raise InputError(f"runs: expected a run of train or a folder of runs, got none in {folder}")
    yield from found


def _is_run(folder: Path) -> bool:
    return any((folder / name).is_file() for name in ("results.json", "config.yaml"))


def _of_one_dataset(runs: list[Run], tell: Tell) -> list[Run]:
    """The runs with the data and the N of the newest: rates over other objects or trials are not comparable."""
    newest = runs[-1]
    same = newest.dataset, newest.N, newest.grasp_types
    kept = [run for run in runs if (run.dataset, run.N, run.grasp_types) == same]
    if others := [run.folder.name for run in runs if run not in kept]:
        which = ", ".join(others) if len(others) <= FEW else f"{len(others)} runs"
        tell(
            f"left out: {which}: other objects, trials or N than the newest run, {newest.folder.name}; "
            "runs=FOLDER or runs=[FOLDER,...] chooses"
        )
    return kept


def _settings(path: Path) -> dict[str, Any]:
    content = yaml_values(path, "the settings of a run")
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected the settings of a run, got something else")
    return content


def _check_pictured(run: Run) -> None:
    """Raises InputError where the settings lack what pictures are made from."""
    path = run.folder / "config.yaml"
    for key, kind in _PICTURED.items():
        if not isinstance(run.settings.get(key), kind):
            words = "text" if kind is str else "settings"
            raise InputError(f"{path}: {key}: expected {words}, got {str(run.settings.get(key, 'none'))[:60]}")
    try:
        known = grasp_types(typed(HandConfig, run.settings["hand"]))
    except InputError as error:
        raise InputError(f"{path}: hand: expected the settings of a hand, got others ({error})") from None
    if known != run.grasp_types:
        raise InputError(
            f"{path}: hand: expected {', '.join(run.grasp_types)}, as the rates have; got {', '.join(known) or 'none'}"
        )


def _stamp(folder: Path) -> str:
    """The date and time in the folder's name (its own, or of the file where the folder was renamed)."""
    found = _STAMP.match(folder.name)
    written = (folder / "results.json").stat().st_mtime
    return found[0] if found else datetime.fromtimestamp(written).strftime("%Y-%m-%d_%H-%M-%S.%f")


def _as_written(path: Path, digests: Mapping[str, str]) -> Path:
    """`path`. Raises InputError where it is not the file of which the results hold the digest."""
    if path.name in digests and digest_of(existing(path)) != digests[path.name]:
        raise InputError(f"{path}: expected the file that results.json was written with, got a damaged or edited one")
    return path


def _count(results: Mapping[str, Any], key: str) -> int:
    value = results[key]
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST:
        raise InputError(f"{key}: expected a whole number from 0 to {MOST}, got {str(value)[:40]}")
    return value


def _block(content: Mapping[str, Mapping[str, float]]) -> Block:
    block = {name: _rates(content[name], name) for name in (*CLASSES, "all") if name in content}
    if "all" not in block:
        raise ValueError('rates without "all"')
    return block


def _random(content: Mapping[str, Mapping[str, float]]) -> Block:
    """Rates of random candidates, which are of each grasp type alone: what types there are, they say."""
    block = _block(content)
    for name in block["all"]:
        checked_name(name, "random.all")
    if not block["all"] or ALL in block["all"]:
        raise ValueError(f"rates of random candidates of {', '.join(block['all']) or 'no type'}")
    return block


def _check_rates(results: Mapping[str, Any]) -> None:
    """Raises ValueError where a ranking lacks a rate or an interval of a class that occurs."""
    rates, intervals = results["by_ranking"], results["interval95_by_ranking"]
    single = sorted(_random(results["random"])["all"])
    every = [*single, ALL]
    for key, kinds in (("random", single), ("random_collision_free", single), ("ceiling", every)):
        if missing := [name for block in rates.values() for name in block if {*kinds} - {*results[key].get(name, ())}]:
            raise ValueError(f"no {key} of {str(missing[0])[:40]}")
    for ranking, block in rates.items():
        checked_name(ranking, "by_ranking")
        if others := sorted({kind for row in block.values() for kind in row} - {*every}):
            raise ValueError(f"no random of {str(others[0])[:40]}")
        for name, grasp_type in ((name, grasp_type) for name in block for grasp_type in every):
            if grasp_type not in block[name] or len(intervals.get(ranking, {}).get(name, {}).get(grasp_type, ())) != 2:
                raise ValueError(f"no {grasp_type} of {name} by the ranking {ranking}")


def _bounds(content: Mapping[str, Mapping[str, Sequence[float]]]) -> Bounds:
    return {
        name: {grasp_type: (_rate(low, name), _rate(high, name)) for grasp_type, (low, high) in content[name].items()}
        for name in (*CLASSES, "all")
        if name in content
    }


def _check_spent(results: Mapping[str, Any]) -> None:
    """InputError unless what a run took is told in finite numbers from 0, where it is told."""
    for key in ("seconds", "costs", "from_cache"):
        for name, value in results.get(key, {}).items():
            number(value, f"{key}.{name}", 0.0)


def _of_types(results: Mapping[str, Any], key: str) -> dict[str, dict[str, float]]:
    return {grasp_type: _numbers(values) for grasp_type, values in results.get(key, {}).items()}


def _numbers(content: Mapping[str, float]) -> dict[str, float]:
    return {key: number(value, str(key)) for key, value in content.items()}


def _rates(content: Mapping[str, float], where: str) -> dict[str, float]:
    return {key: _rate(value, f"{where}.{key}") for key, value in content.items()}


def _rate(value: Any, where: str) -> float:
    return number(value, where, 0.0, 1.0)


def _object_row(row: Mapping[str, str], run: Run) -> ObjectRow:
    rates = {name: {each: float(row[f"{name}_{each}"]) for each in run.types} for name in run.by_ranking}
    if odd := [f"{rate:g}" for of in rates.values() for rate in of.values() if not 0 <= rate <= 1]:
        raise ValueError(f"a rate of {odd[0]}")
    if row["class"] not in CLASSES:
        raise ValueError(f"class {row['class']}")
    return ObjectRow(checked_name(row["object"], "object"), row["class"], int(row["fold"]), rates)


def _told(error: Exception) -> str:
    return f"a missing {error}" if isinstance(error, KeyError) else str(error).splitlines()[0][:120]


def _words(runs: Any) -> str:
    return runs if isinstance(runs, str) else ", ".join(runs)
