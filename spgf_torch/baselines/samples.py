"""The training samples of an export, in memory, checked against the objects and trials that they should be of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.errors import InputError
from spgf_torch.files.checks import entry, number, whole
from spgf_torch.formats.card import CARD, check_files, read_card
from spgf_torch.formats.samples import Sample, read_samples, shard_name
from spgf_torch.formats.tar import check_whole
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.settings import plain
from spgf_torch.simulation.table import TrialTable

SAMPLES = Path("webdataset", "samples")
HOW = "python -m spgf_torch.export format=webdataset"


@dataclass(frozen=True)
class Samples:
    """All trials, object by object in the order of the objects, each in the order of its table.

    Attributes:
        cloud: (S, P, 3) f16, m: sensed points in the frame of the TCP. Half precision is 0.03 mm at 10 cm.
        grasp_type: (S,) int64, index into the tables' `grasp_types`. success: (S,) bool.
        start: (objects + 1,) where each object's rows begin, and the end.
        radius: m about the TCP from which the points are.
    """

    cloud: Tensor
    grasp_type: Tensor
    success: Tensor
    start: Sequence[int]
    radius: float

    def rows(self, objects: Sequence[int]) -> Tensor:
        """(R,) int64: the rows of these objects."""
        return torch.cat([torch.arange(self.start[i], self.start[i + 1]) for i in objects])

    def to(self, device: str) -> Samples:
        """The same on a device."""
        moved = {name: getattr(self, name).to(device) for name in ("cloud", "grasp_type", "success")}
        return replace(self, **moved)


def open_export(config: BaselineConfig, objects: Sequence[GraspObject], fold: np.ndarray) -> tuple[Path, float]:
    """The folder of the samples, and the radius of their clouds (m).

    Raises InputError in one line unless the settings' export is of these objects, in these folds (objects,), sensed
    as the settings say.
    """
    folder = find(config.export)
    path = folder / CARD
    if not path.is_file():
        raise InputError(f"export: expected the folder of a data set ({HOW}), got {folder} without {CARD}")
    card = read_card(folder)
    formats = entry(card, "formats", str(path))
    if not isinstance(formats, list) or "webdataset" not in formats:
        raise InputError(f"{path}: expected the format webdataset ({HOW}), got {formats!r:.80}")
    settings = entry(card, "settings", str(path))
    wanted = {"folds": config.folds, "seed": config.seed, "sensing": plain(config.sensing)}
    for key, value in wanted.items():
        if (got := entry(settings, key, f"{path}: settings")) != value:
            raise InputError(f"{path}: expected {_difference(key, value, got)}: export again, or set {key} to its own")
    _check_objects(entry(card, "objects", str(path)), objects, fold, path)
    known = entry(settings, "samples", f"{path}: settings")
    return folder / SAMPLES, number(entry(known, "radius", f"{path}: settings.samples"), f"{path}: radius", 1e-3, 10.0)


def shards_of(folder: Path, folds: int) -> list[Path]:
    """The shards of all folds, in order, numbered without gaps. InputError where one is missing, cut off or
    damaged.
    """
    paths = []
    for fold in range(folds):
        found = sorted(folder.glob(f"fold{fold}-*.tar"))
        for at, path in enumerate(found or [folder / shard_name(fold, 0)]):
            if path.name != shard_name(fold, at) or not path.is_file():
                raise InputError(f"{folder / shard_name(fold, at)}: expected a shard of fold {fold}, got no such file")
            check_whole(path)
        paths += found
    check_files(folder.parent.parent, paths)
    return paths


def load_samples(
    shards: Sequence[Path],
    radius: float,
    objects: Sequence[GraspObject],
    tables: Sequence[TrialTable],
    fold: np.ndarray,
    advance: Callable[[int], None],
) -> Samples:
    """Read the shards once; `advance` is called with 1 a shard.

    Raises InputError in one line for a shard that is missing or cut off, for a sample of another object, fold or
    outcome than the trials say, and unless every trial is there once.
    """
    start = np.concatenate([[0], np.cumsum([len(table) for table in tables])]).tolist()
    grasp_type, success = torch.cat([t.grasp_type for t in tables]), torch.cat([t.success for t in tables])
    place = {obj.name: i for i, obj in enumerate(objects)}
    seen, cloud = np.zeros(start[-1], bool), np.empty((0, 0, 3), np.float16)
    for path in shards:
        for sample in read_samples(path):
            where = f"{path}: {sample.key}"
            i = place.get(sample.object, -1)
            here = path.name.startswith(f"fold{sample.fold}-")
            if i < 0 or not here or sample.fold != fold[i] or sample.category != objects[i].category:
                got = f"{sample.object} ({sample.category}) of fold {sample.fold}"
                raise InputError(f"{where}: expected an object of the trials in its class and fold, got {got:.80}")
            if (index := whole(sample.index, f"{where}: index")) >= start[i + 1] - start[i]:
                raise InputError(f"{where}: expected one of {start[i + 1] - start[i]} trials, got index {index}")
            row = start[i] + index
            _check_trial(sample, tables[i].grasp_types[int(grasp_type[row])], bool(success[row]), where)
            if not len(cloud):
                cloud = np.empty((start[-1], len(sample.cloud), 3), np.float16)
            if seen[row] or len(sample.cloud) != cloud.shape[1]:
                got = "a second sample of a trial" if seen[row] else f"{len(sample.cloud)}"
                raise InputError(f"{where}: expected each trial once, with {cloud.shape[1]} points; got {got}")
            cloud[row], seen[row] = sample.cloud, True
        advance(1)
    if not seen.all():
        raise InputError(f"{shards[0].parent}: expected samples of all {len(seen)} trials, got {int(seen.sum())}")
    return Samples(torch.from_numpy(cloud), grasp_type, success, start, radius)


def _check_objects(listed: Any, objects: Sequence[GraspObject], fold: np.ndarray, path: Path) -> None:
    if not isinstance(listed, list):
        raise InputError(f"{path}: objects: expected a list, got {listed!r:.40}")
    where = f"{path}: objects"
    found = {str(entry(each, "name", where)): each for each in listed}
    for obj, number_ in zip(objects, fold.tolist(), strict=True):
        each = found.pop(obj.name, None)
        if each is None or entry(each, "digest", where) != obj.digest or entry(each, "class", where) != obj.category:
            got = "none of this name" if each is None else "another of this name, or of another class"
            raise InputError(f"{path}: expected the object {obj.name} of objects=, got {got}")
        if (got := entry(each, "fold", where)) != number_:
            raise InputError(f"{path}: expected {obj.name} in fold {number_}, got {got!r:.40}")
    if found:
        raise InputError(f"{path}: expected the objects of objects=, got {min(found):.80} beside them")


def _check_trial(sample: Sample, grasp_type: str, success: bool, where: str) -> None:
    trial = grasp_type, success
    if (sample.type, bool(sample.label)) != trial:
        expected, got = (
            f"{name} that {'held' if success else 'failed'}" for name, success in (trial, (sample.type, sample.label))
        )
        raise InputError(f"{where}: expected {expected}, as trials= has it; got {got}")


def _difference(key: str, wanted: Any, got: Any) -> str:
    """The first value that differs, in words."""
    if isinstance(wanted, dict) and isinstance(got, dict):
        name = next(name for name in sorted({*wanted, *got}) if wanted.get(name) != got.get(name))
        return _difference(f"{key}.{name}", wanted.get(name), got.get(name))
    return f"{key}={wanted}, got {got!r:.40}"
