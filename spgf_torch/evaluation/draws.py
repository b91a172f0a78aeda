"""The best grasps in several draws of what a robot does not know: how robust they are is the share that holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spgf_torch.evaluation.endings import failure_counts
from spgf_torch.evaluation.success import ALL, Rates, bootstrap_interval, class_means
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.execution import Executed
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.label import Label


def draw_results(
    objects: Sequence[GraspObject], by_draw: Sequence[Sequence[Executed]], config: EvaluateConfig
) -> dict[str, Any]:
    """What `results.json` holds more of several draws; rates are fractions, intervals over objects.

    Args:
        by_draw: of each draw what became of every object's grasps; the best ones are the same in all.
    """
    runs = list(zip(*by_draw, strict=True))
    classes, rates = [obj.category for obj in objects], [_rates(its) for its in runs]
    held = [np.stack([ran.success[ran.best[ALL]].numpy() for ran in its]) for its in runs]
    words = [ran.ended[index] for its in runs for ran in its for index in ran.best[ALL].tolist()]
    return {
        "draws": len(by_draw),
        "success_rate": class_means(classes, rates),
        "interval95": bootstrap_interval(classes, rates, config.bootstrap, config.seed),
        "top1": float(np.mean([ran[:, :1].mean() if ran.size else 0.0 for ran in held])),
        # Of fewer grasps than N those that are missing count as failures.
        "top_N": float(np.mean([ran.sum() / (len(by_draw) * config.N) for ran in held])),
        "all_draws": float(np.mean([_always(ran) for ran in held])),
        "by_draw": np.mean([ran.mean(axis=1) if ran.size else np.zeros(len(by_draw)) for ran in held], axis=0).tolist(),
        "failures": failure_counts([Label.of(word) for word in words]),
        "per_object": [
            {"object": obj.name, "class": obj.category, **its, "all_draws": _always(ran)}
            for obj, its, ran in zip(objects, rates, held, strict=True)
        ],
    }


def _rates(its: Sequence[Executed]) -> Rates:
    """Of each type and CG the share of the best grasps, in all draws together, that were held."""
    return {name: float(np.mean([ran.rate(chosen) for ran in its])) for name, chosen in its[0].best.items()}


def _always(held: np.ndarray) -> float:
    """Share of grasps that hold in each draw; held: (draws, <= N) bool."""
    return float(held.all(axis=0).mean()) if held.size else 0.0
