"""The predictions of a run (`predictions.parquet`), and the curves that follow from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spgf_torch.affordance.config import NESTED
from spgf_torch.errors import InputError
from spgf_torch.evaluation.predictions import Predictions, read_predictions
from spgf_torch.evaluation.success import ALL
from spgf_torch.objects.config import CLASSES
from spgf_torch.reporting.data.runs import Run


def predictions_of(run: Run, ranking: str) -> list[Predictions]:
    """The predictions of a run on each object, to be ranked by `ranking`.

    Raises InputError where the file is missing, damaged, not ours or without the scores of the ranking.
    """
    path = run.folder / "predictions.parquet"
    objects = read_predictions(path, run.chosen)
    for predictions in objects:
        if ranking not in predictions.scores:
            wanted = run.chosen.get(predictions.fold, NESTED) if ranking == NESTED else ranking
            got = ", ".join(name for name in predictions.scores if name != NESTED)
            raise InputError(f"{path}: expected the scores of the ranking {wanted}, got {got}")
    return objects


def precision_at(objects: Sequence[Predictions], ranking: str, types: Sequence[str], most: int) -> np.ndarray:
    """(objects, types, most) float: the share of successes among the N highest-ranked grasps, N = 1 .. most.

    `types` are the grasp types and CG. Of fewer than N grasps the share is that of all of them.
    """
    rates = np.zeros((len(objects), len(types), most))
    for i, predictions in enumerate(objects):
        for j, name in enumerate(types):
            success = predictions.success[predictions.ranked(ranking, name, most)]
            running = np.cumsum(success) / np.arange(1, len(success) + 1)
            rates[i, j, : len(success)] = running
            rates[i, j, len(success) :] = running[-1] if len(success) else 0.0
    return rates


def ceilings_at(objects: Sequence[Predictions], types: Sequence[str], most: int) -> np.ndarray:
    """(objects, types, most) float: what the best N by outcome would give; `types` are the grasp types and CG."""
    successes = [
        [o.success[(o.grasp_type == code) | (name == ALL)].sum() for code, name in enumerate(types)] for o in objects
    ]
    n = np.arange(1, most + 1)
    return np.minimum(np.asarray(successes)[..., None], n) / n


def class_curves(
    categories: Sequence[str], values: np.ndarray, resamples: int, seed: int
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Class (and "all") -> mean, lower and upper bound of `values` (objects, ...) over the class's objects.

    The bounds are 95 % percentiles over objects drawn with replacement within their class, as in the table.
    """
    rng, flat = np.random.default_rng(seed), values.reshape(len(values), -1)
    counts = np.zeros((resamples, len(flat)))  # how often each object was drawn
    for name in dict.fromkeys(categories):
        members = _members(categories, name)
        counts[:, members] = rng.multinomial(len(members), np.full(len(members), 1 / len(members)), size=resamples)
    means, curves = mean_curves(categories, values), {}
    for name, mean in means.items():
        members = _members(categories, name)
        low, high = np.quantile(counts[:, members] @ flat[members] / len(members), (0.025, 0.975), axis=0)
        curves[name] = (mean, low.reshape(mean.shape), high.reshape(mean.shape))
    return curves


def mean_curves(categories: Sequence[str], values: np.ndarray) -> dict[str, np.ndarray]:
    """Class (and "all") -> mean of `values` (objects, ...) over the class's objects."""
    names = [*(name for name in CLASSES if name in categories), "all"]
    return {name: values[_members(categories, name)].mean(axis=0) for name in names}


def _members(categories: Sequence[str], name: str) -> np.ndarray:
    return np.flatnonzero([name in ("all", category) for category in categories])
