"""Results of executed grasps: `results.json` of `evaluate` (schema 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spgf_torch.evaluation.reliability import reliability
from spgf_torch.evaluation.success import ALL, Rates, bootstrap_interval, class_means
from spgf_torch.experiment.config import EvaluateConfig

SCHEMA = 1


@dataclass(frozen=True)
class ObjectOutcome:
    """One object: what its best grasps and a random sample of its candidates came to.

    Attributes:
        best: of each type and CG the share of the highest-ranked grasps that were held.
        random: the same of random candidates.
        seconds: of sensing, features and ranking; not of the trials.
    """

    name: str
    category: str
    best: Rates
    random: Rates
    seconds: float


def executed_results(outcomes: Sequence[ObjectOutcome], config: EvaluateConfig) -> dict[str, Any]:
    """The content of `results.json` of `evaluate`; rates are fractions."""
    classes = [o.category for o in outcomes]
    return {
        "schema": SCHEMA,
        "grasp_types": [name for name in outcomes[0].best if name != ALL],
        "N": config.N,
        "engine": config.engine,
        "candidates": config.candidates,
        "held_out": config.held_out,
        "ranking": config.ranking,
        "seed": config.seed,
        "success_rate": class_means(classes, [o.best for o in outcomes]),
        "interval95": bootstrap_interval(classes, [o.best for o in outcomes], config.bootstrap, config.seed),
        "random": class_means(classes, [o.random for o in outcomes]),
        "per_object": [_row(o) for o in outcomes],
    }


def judged_results(
    success: Sequence[np.ndarray], probability: Sequence[np.ndarray] | None, config: EvaluateConfig
) -> dict[str, Any]:
    """More of `results.json` where a judge ranked, or things stood on a table; of the best CG grasps of each object.

    Args:
        success: of each object (<= N,) bool, best first.
        probability: of each (<= N,) float, as a judge has it; None: the votes ranked.
    """
    first = [float(ran[0]) if len(ran) else 0.0 for ran in success]
    found: dict[str, Any] = {"judge": config.judge, "table": config.table, "top1": float(np.mean(first))}
    # Of fewer grasps than N those that are missing count as failures.
    found["top_N"] = float(np.mean([ran.sum() / config.N for ran in success]))
    if probability is not None:
        p, outcomes = np.concatenate(probability), np.concatenate(success)
        found |= {"predicted": float(p.mean()) if len(p) else 0.0, "ece": reliability(p, outcomes).ece}
    return {"judged": found}


def _row(outcome: ObjectOutcome) -> Mapping[str, Any]:
    return {
        "object": outcome.name,
        "class": outcome.category,
        **outcome.best,
        "random": outcome.random,
        "seconds": round(outcome.seconds, 3),
    }
