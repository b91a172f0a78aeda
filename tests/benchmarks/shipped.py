"""What making a model small costs: rates of candidates by cross-validation, its bytes, and how long it takes to load.

    python tests/benchmarks/shipped.py [RUN...]     RUN: a folder of train fold_models=true; without one it is made

Each fold's model ranks the tried grasps on objects that it has not seen, whole and made small (conf/small). Small ones
go through a file, so that what is measured is what is shipped. Rates: success among the N best of all types, percent.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from shared.harness import Report, processor

from spgf_torch.affordance.model import GraspModel, load_model, save_model
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.cache import Cache
from spgf_torch.evaluation.success import ALL, bootstrap_interval, class_means, top_n
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.held_out import FOLDER, novel_by_fold
from spgf_torch.experiment.labelled_grasps import tables_of
from spgf_torch.experiment.loaded_model import LoadedModel
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.folders import read_objects
from spgf_torch.progress import ProgressReporter
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.worker import Trials
from spgf_torch.training.run import _describer

RANKINGS = ("paper", "log_odds_free")
WHOLE = 10_430_000  # points of the SDH-2's model of all objects: of a fold's the same share stays as of it


def made_small(model: GraspModel) -> tuple[GraspModel, int, float]:
    """What is read again of a model that was written small, its bytes, and processor seconds of reading."""
    usual = settings(SmallConfig)
    how = replace(usual, points=round(len(model.condensed.cell) * usual.points / WHOLE))
    with TemporaryDirectory() as name:
        size = save_model(model, Path(name), how)
        found: list[GraspModel] = []
        seconds = processor(lambda: found.append(load_model(Path(name))))
    return found[0], size, seconds


def rates(loaded: LoadedModel, obj: DescribedObject, n: int) -> dict[str, float]:
    """Success-rate of the n best of all types, by each ranking."""
    scores = loaded.scores(obj)
    grasp_type, success = obj.grasp_type.numpy(), obj.outcomes.numpy()
    return {name: top_n(scores[name].numpy(), success, grasp_type, n, obj.grasp_types)[ALL] for name in RANKINGS}


def measure(run: Path, report: Report) -> None:
    config: Any = typed(TrainConfig, yaml.safe_load((run / "config.yaml").read_text()))
    stages, cache = ProgressReporter(), Cache.open(config.cache, config.cache_gb)
    objects = read_objects(config, stages, cache).objects
    trials = Trials(load_hand(config.hand), config.episode)
    tables = tables_of(objects, config.trials, trials, config.sampler)
    describer = _describer(config, cache)
    described, novel = describer.describe(objects, tables, stages), novel_by_fold(run)
    examples = [obj.with_success(table.success) for obj, table in zip(described, tables, strict=True)]
    found: dict[str, dict[str, dict[str, float]]] = {"whole": {}, "small": {}}
    for fold in sorted({fold for fold, _ in novel.values()}):
        whole = load_model(run / FOLDER / str(fold))
        small, size, seconds = made_small(whole)
        points = [len(model.condensed.cell) for model in (whole, small)]
        report.row(fold=fold, points_whole=points[0], points_small=points[1], bytes=size, load_s=seconds)
        for name, model in (("whole", whole), ("small", small)):
            loaded = LoadedModel(model, describer)
            for obj, example in zip(objects, examples, strict=True):
                if novel[obj.name][0] == fold:
                    found[name][obj.name] = rates(loaded, example, config.N)
    classes = [obj.category for obj in objects]
    rows = {name: [its[obj.name] for obj in objects] for name, its in found.items()}
    gain = [
        {r: small[r] - whole[r] for r in RANKINGS} for whole, small in zip(rows["whole"], rows["small"], strict=True)
    ]
    interval = bootstrap_interval(classes, gain, 10_000, 0)["all"]
    for ranking in RANKINGS:
        whole, small = (100 * np.mean([row[ranking] for row in rows[name]]) for name in ("whole", "small"))
        low, high = (100 * end for end in interval[ranking])
        mean = 100 * class_means(classes, gain)["all"][ranking]
        words = f"{whole:.1f} whole, {small:.1f} small, {mean:+.1f} ({low:+.1f} to {high:+.1f})"
        report.figure(f"candidates, {ranking}, seed {config.seed}, {config.N} best", "within 0.5", words)


def made(folder: Path, whole: bool = False) -> Path:
    """A run of the paper's experiment that keeps the model of each fold; `whole`: that of all objects, too."""
    command = [sys.executable, "-m", "spgf_torch.train", "+K=20", "fold_models=true", f"hydra.run.dir={folder}"]
    subprocess.run([*command, f"final_model={str(whole).lower()}"], cwd=Path(__file__).parents[2], check=True)
    return folder


if __name__ == "__main__":
    report = Report("shipped", "Models made small beside whole ones: candidates ranked by cross-validation.")
    with TemporaryDirectory() as place:
        for run in map(Path, sys.argv[1:]) if sys.argv[1:] else (made(Path(place) / "run"),):
            measure(run, report)
    report.write()
