"""The cross-validation of `train` with a network in the place of descriptor and votes, kept fold by fold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration, fit_calibration, uncalibrated
from spgf_torch.affordance.config import NESTED
from spgf_torch.affordance.ranking import COLLIDING
from spgf_torch.baselines.checkpoints import read_tensors, write_tensors
from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.baselines.data import Data
from spgf_torch.baselines.fit import BEST, LAST, fit
from spgf_torch.baselines.lightning_module import GraspClassifier, Task
from spgf_torch.baselines.pointnet import PointNet, grasp_logits
from spgf_torch.baselines.samples import Samples
from spgf_torch.errors import InputError
from spgf_torch.evaluation.folds import stratified_order
from spgf_torch.evaluation.predictions import Predictions, pose_columns
from spgf_torch.evaluation.success import top_n
from spgf_torch.progress import ProgressReporter, console

MODEL, JUDGED = "model.safetensors", "judged.safetensors"


@dataclass(frozen=True)
class FoldLogits:
    """What the network of a fold says.

    Attributes:
        novel, inner: object -> logits (G,) f32: of all grasps of novel objects, of those that may teach of inner ones.
        base_rate: (types,) of the training objects. seconds: of its epochs.
    """

    novel: dict[int, Tensor]
    inner: dict[int, Tensor]
    base_rate: Tensor
    seconds: float


def inner_split(
    classes: Sequence[str], fold: np.ndarray, test: int, share: float, seed: int
) -> tuple[list[int], list[int]]:
    """Training objects of the fold `test` that teach, and those that stop and calibrate: about `share`, by class.

    Raises InputError where there are not two of them.
    """
    train = np.flatnonzero(fold != test).tolist()
    if len(train) < 2:
        raise InputError(f"objects: expected two at least to learn from in every fold, got {len(train)}")
    order = [train[at] for at in stratified_order([classes[i] for i in train], seed).tolist()]
    count = min(max(1, round(share * len(order))), len(order) - 1)
    return sorted(order[count:]), sorted(order[:count])


def run_folds(
    data: Data, config: BaselineConfig, work: Path, provenance: str, stages: ProgressReporter
) -> dict[int, FoldLogits]:
    """Fold -> what its network says. What is finished is kept in `work`, and taken from there."""
    tests = np.unique(data.fold).tolist()
    with stages.stage("learning", len(tests) * config.learning.epochs, "epochs") as advance:
        found = {}
        for test in tests:
            told = 0

            def tell() -> None:
                nonlocal told
                told += 1
                advance(1)

            found[test] = run_fold(data, config, test, work / f"fold{test}", f"{provenance} {test}", tell)
            advance(config.learning.epochs - told)
    return found


def run_fold(
    data: Data, config: BaselineConfig, test: int, folder: Path, provenance: str, tell: Callable[[], None]
) -> FoldLogits:
    """Train a network without the objects of the fold `test`, and let it score grasps on them and the inner ones."""
    classes = [obj.category for obj in data.objects]
    teach, inner = inner_split(classes, data.fold, test, config.learning.inner_share, config.seed)
    novel = np.flatnonzero(data.fold == test).tolist()
    taught = torch.cat([data.taught[i] for i in teach])
    if not (folder / JUDGED).is_file():
        folder.mkdir(parents=True, exist_ok=True)
        watched = _sampled([data.taught[i] for i in inner], config.learning.inner_grasps, config.seed)
        task = Task(data.samples, taught, watched, data.symmetric, config.augment, config.learning, config.seed + test)

        def make() -> GraspClassifier:
            generator = torch.Generator().manual_seed(config.seed + test)
            network = PointNet(config.network, len(data.grasp_types), data.samples.radius, generator)
            return GraspClassifier(network, task, provenance, tell)

        module = fit(make, folder)
        _keep(
            module, data.samples, [*(data.samples.rows([i]) for i in novel), *(data.taught[i] for i in inner)], folder
        )
        console.print(f"fold {test}: learned from {len(teach)} objects in {module.seconds:.0f} s")
    kept = read_tensors(folder / JUDGED, "logit", "seconds")
    sizes = [*(len(data.tables[i]) for i in novel), *(len(data.taught[i]) for i in inner)]
    logits = dict(zip([*novel, *inner], kept["logit"].split(sizes), strict=True))
    grasp_type, success = data.samples.grasp_type.cpu()[taught], data.samples.success.cpu()[taught].float()
    rates = torch.stack([success[grasp_type == code].mean() for code in range(len(data.grasp_types))]).nan_to_num()
    return FoldLogits({i: logits[i] for i in novel}, {i: logits[i] for i in inner}, rates, float(kept["seconds"]))


def _sampled(rows: Sequence[Tensor], count: int, seed: int) -> Tensor:
    """At most `count` of each object's rows, drawn at random."""
    generator = torch.Generator().manual_seed(seed)
    return torch.cat([own[torch.randperm(len(own), generator=generator)[:count]] for own in rows])


def _keep(module: GraspClassifier, samples: Samples, rows: Sequence[Tensor], folder: Path) -> None:
    """Write the network, then what it says of some rows; checkpoints are no longer needed."""
    device = samples.cloud.device
    chosen = torch.cat(list(rows)).to(device)
    logit = grasp_logits(module.network, samples.cloud[chosen], samples.grasp_type[chosen]).cpu()
    if not logit.isfinite().all():
        raise InputError(
            f"learning.rate: expected one at which the network stays finite, got {module.task.learning.rate:g}"
        )
    state = {name: tensor.cpu().contiguous() for name, tensor in module.network.state_dict().items()}
    write_tensors(folder / MODEL, state)
    write_tensors(folder / JUDGED, {"logit": logit, "seconds": torch.tensor(module.seconds, dtype=torch.float64)})
    for name in (LAST, BEST):
        (folder / name).unlink(missing_ok=True)


def scores(logit: Tensor, grasp_type: Tensor, collides: Tensor, calibration: Calibration) -> dict[str, Tensor]:
    """Every ranking's score (G,) of an object's grasps, higher is better: name of `config.RANKINGS` -> (G,) f32.

    Those of `affordance.ranking` that a network has: `log_odds`, its logit, is on top of the base rate of the type;
    in `log_odds_free` sensed collisions come last; `calibrated` is the probability of success.
    """
    return {
        "calibrated": calibration.probability(logit, grasp_type, collides),
        "log_odds": logit,
        "log_odds_free": logit + COLLIDING * collides,
    }


def calibrated(data: Data, logits: FoldLogits, n: int) -> tuple[Calibration, str]:
    """Calibration and choice of the ranking, both on the inner objects of a fold; the first ranking of equals.

    Of the inner objects' grasps the same share counts as n is of all.
    """
    known = {i: data.of(i, data.taught[i]) for i in logits.inner}
    grasp_type, collides, success = (torch.cat([part[at] for part in known.values()]) for at in range(3))
    logit, types = torch.cat(list(logits.inner.values())), data.grasp_types
    calibration = fit_calibration(logit, grasp_type, collides, success, len(types))
    rates: dict[str, float] = {}
    for i, (grasp_type, collides, success) in known.items():
        best = max(1, round(n * len(success) / len(data.tables[i])))
        for name, score in scores(logits.inner[i], grasp_type, collides, calibration).items():
            rate = top_n(score.numpy(), success.numpy(), grasp_type.numpy(), best, types)["CG"]
            rates[name] = rates.get(name, 0.0) + rate
    return calibration, max(rates, key=lambda name: rates[name])


def predictions_of(data: Data, logits: dict[int, FoldLogits], n: int) -> list[Predictions]:
    """What was said of each object by a network that had not seen it, beside what became of its grasps."""
    found: dict[int, Predictions] = {}
    for fold, of_fold in logits.items():
        calibration, chosen = calibrated(data, of_fold, n)
        before = uncalibrated(of_fold.base_rate)
        for i, logit in of_fold.novel.items():
            grasp_type, collides, success = data.of(i, data.samples.rows([i]))
            ranked = scores(logit, grasp_type, collides, calibration)
            found[i] = Predictions(
                name=data.objects[i].name,
                category=data.objects[i].category,
                fold=fold,
                chosen=chosen,
                scores={name: score.numpy() for name, score in {**ranked, NESTED: ranked[chosen]}.items()},
                probability_before=before.probability(logit, grasp_type, collides).numpy(),
                probability=ranked["calibrated"].numpy(),
                votes=np.ones(len(logit), dtype=np.int64),
                success=success.numpy(),
                grasp_type=grasp_type.numpy(),
                collides=collides.numpy(),
                pose=pose_columns(data.tables[i].T_object_tcp),
                grasp_types=data.grasp_types,
            )
    return [found[i] for i in range(len(data.objects))]
