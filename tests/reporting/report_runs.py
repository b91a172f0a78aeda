"""Tiny runs of `train` for the tests of the report: three objects, twenty candidates of each type, known outcomes."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import torch
from composing import composed
from omegaconf import OmegaConf

from spgf_torch.affordance.calibration import NUMBERS, Calibration
from spgf_torch.affordance.config import RANKINGS
from spgf_torch.affordance.model import GraspModel, save_model
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.evaluation.files import FILES, RESULTS, write_per_object, write_results
from spgf_torch.evaluation.predictions import Predictions, write_predictions
from spgf_torch.evaluation.results import build_results
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.files.digests import KEY
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.hands.config import grasp_types
from spgf_torch.settings import plain, typed

ROOT = Path(__file__).parents[2]
OBJECTS = {"mug_coffee": "containers", "box_tea": "boxes", "egg": "curved"}
CANDIDATES = 20  # of each type


@cache
def defaults() -> dict:
    """The settings of a run with few pixels, as plain values."""
    fewer = ["K=3", "sensing.width=160", "sensing.height=120", "sensing.focal=144", "bootstrap=100", "folds=3", "N=4"]
    values = composed("train", *fewer)
    return {**values, "objects": str(ROOT / "data/objects")}


def train_config(K: int, **changes: object) -> TrainConfig:
    prototypes = {**defaults()["prototypes"], "num_clusters": K}
    return typed(TrainConfig, {**defaults(), "prototypes": prototypes, "K": K, **changes})


def predictions(skill: float, seed: int, grasp_types: tuple[str, ...] = ("NPG", "WPG")) -> list[Predictions]:
    """Predictions whose scores follow the outcome as closely as `skill` says."""
    rng, count = np.random.default_rng(seed), len(grasp_types) * CANDIDATES
    objects = []
    for fold, (name, category) in enumerate(OBJECTS.items()):
        success = np.random.default_rng(fold).random(count) < 0.4  # the same in every run: one dataset
        score = skill * success + rng.normal(0, 1, len(success))
        probability = 1 / (1 + np.exp(-score))
        pose = np.column_stack([rng.normal(0, 0.03, (len(success), 3)), rng.normal(0, 1, (len(success), 4))])
        objects.append(
            Predictions(
                name=name,
                category=category,
                fold=fold,
                chosen="log_odds",
                scores={**dict.fromkeys(RANKINGS, score), "nested": score},
                probability_before=probability**2,
                probability=probability,
                votes=np.full(len(success), 7),
                success=success,
                grasp_type=np.repeat(np.arange(len(grasp_types)), CANDIDATES),
                collides=np.zeros(len(success), dtype=bool),
                pose=pose,
                grasp_types=grasp_types,
            )
        )
    return objects


def tiny_model(K: int, config: TrainConfig) -> GraspModel:
    """A flat surface, a wall and then rims, each with nine points of each type."""
    rings = np.zeros((K, 2, 36, 2))
    rings[:, 1, :] = 90, 180
    rings[1:, 1, :] = 10, 175
    rings[2:, 0, :9] = 90, 90
    lattice = SE3Grid(0.1, 0.012, 22.5)
    types = len(grasp_types(config.hand))
    points = types * K * 9
    cells = (
        torch.randint(lattice.cells, (types * K, 9), generator=torch.Generator().manual_seed(0)).sort().values.flatten()
    )
    condensed = Condensed(
        torch.arange(types * K + 1) * 9,
        cells,
        torch.linspace(0, 1, points),
        torch.full((points,), 5.0),
        torch.tensor([0.1, 0.4, 0.3][:types]),
    )
    centres = torch.from_numpy(np.radians(rings).reshape(K, -1)).float()
    return GraspModel(centres, condensed, lattice, Calibration(torch.zeros(types, len(NUMBERS))), plain(config))


def write_run(
    folder: Path,
    K: int = 3,
    skill: float = 3.0,
    model: bool = True,
    dataset: str = "d1",
    seed: int = 0,
    **changes: object,
) -> Path:
    """A run folder with every file of the contract (`changes`: settings that differ from the defaults)."""
    folder.mkdir(parents=True)
    config = train_config(K, seed=seed, **changes)
    (folder / "config.yaml").write_text(OmegaConf.to_yaml(OmegaConf.create(plain(config))))
    objects = predictions(skill, seed + K, grasp_types(config.hand))
    write_per_object(folder / "per_object.csv", objects, config.N)
    write_predictions(folder / "predictions.parquet", objects)
    write_results(folder, {**build_results(objects, config, dataset), "seconds": {"total": 1.0}})
    if model:
        save_model(tiny_model(K, config), folder)
    return folder


def rewritten(folder: Path, change: Callable[[dict], object]) -> None:
    """A run's results changed, with the digests that belong to them."""
    content = json.loads((folder / RESULTS).read_text())
    content.pop(KEY), content.pop(FILES)
    change(content)
    write_results(folder, content)


def without_ranking(folder: Path, ranking: str) -> None:
    """Take a ranking out of a run's results, as in runs that are older than it."""
    rewritten(folder, lambda content: [content[key].pop(ranking) for key in ("by_ranking", "interval95_by_ranking")])
