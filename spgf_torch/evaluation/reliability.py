"""How far predicted probabilities can be trusted: Brier score, expected calibration error, reliability diagrams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from spgf_torch.evaluation.predictions import Predictions

# Bins of equal width of the expected calibration error, as usual (Guo et al. 2017 use 10 to 15).
BINS = 10

# What gives a grasp its probability, by the end of its keys in results.json.
PREDICTORS = {"": "calibrated", "_flag": "collision flag alone", "_before": "as voted"}

SCORES = {"brier": "Brier score", "ece": "calibration error"}

Blocks = Mapping[str, Mapping[str, float]]  # grasp type -> score and predictor -> value


@dataclass(frozen=True)
class Reliability:
    """A reliability diagram of B bins of equal width over [0, 1].

    Attributes:
        predicted, observed: (B,) float, mean probability, and share of successes; NaN in empty bins.
        count: (B,) int, of each bin.
    """

    predicted: np.ndarray
    observed: np.ndarray
    count: np.ndarray

    @property
    def ece(self) -> float:
        """Expected calibration error: mean distance of the two, weighted by count; 0 of nothing."""
        gaps = np.nan_to_num(np.abs(self.predicted - self.observed))
        return float((gaps * self.count).sum() / max(1, self.count.sum()))


def reliability(probability: np.ndarray, success: np.ndarray, bins: int = BINS) -> Reliability:
    """The diagram of probabilities (G,) in [0, 1] against outcomes (G,) bool."""
    p, outcome = probability.astype(np.float64), success.astype(np.float64)
    which = np.clip((p * bins).astype(np.int64), 0, bins - 1)
    count = np.bincount(which, minlength=bins)
    filled = np.where(count > 0, count, np.nan)
    return Reliability(np.bincount(which, p, bins) / filled, np.bincount(which, outcome, bins) / filled, count)


def predicted(objects: Sequence[Predictions], grasp_type: int, free: bool) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """What PREDICTORS say of the grasps of a type on all objects: (G,) each, and their outcomes (G,) bool.

    Args:
        free: only of grasps without a sensed collision.
    """
    kept = [(o.grasp_type == grasp_type) & ~(free & o.collides) for o in objects]
    parts = [
        (o.probability_before[k], o.probability[k], o.collides[k], o.success[k], np.full(int(k.sum()), o.fold))
        for o, k in zip(objects, kept, strict=True)
    ]
    before, after, collides, success, fold = (np.concatenate(column) for column in zip(*parts, strict=True))
    return {"": after, "_flag": by_flag_alone(collides, success, fold), "_before": before}, success


def score_table(free: Blocks, everything: Blocks) -> tuple[list[str], list[list[str]]]:
    """Head and rows of a table of the blocks `calibration_free` and `calibration` of results.json, as text."""
    head = [f"{score}, {told}" for score in SCORES.values() for told in PREDICTORS.values()]
    rows = []
    for words, blocks in (("without a sensed collision", free), ("all", everything)):
        for grasp_type, block in blocks.items():
            values = [block.get(score + end) for score in SCORES for end in PREDICTORS]
            shown = ["-" if value is None else f"{value:.3f}" for value in values]
            rows.append([f"{grasp_type}, {words}", *shown])
    return ["candidates", *head], rows


def by_flag_alone(flag: np.ndarray, success: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """(G,) float: how often grasps of the other folds succeed that have the same flag (G,) bool; 0 where none has."""
    probability = np.zeros(len(flag))
    for own in np.unique(fold):
        for value in (False, True):
            taught = success[(fold != own) & (flag == value)]
            probability[(fold == own) & (flag == value)] = taught.mean() if len(taught) else 0.0
    return probability


def brier(probability: np.ndarray, success: np.ndarray) -> float:
    """Mean squared distance of probability (G,) and outcome (G,) bool; 0 of nothing."""
    return float(np.mean((probability - success) ** 2)) if len(success) else 0.0


def auc(score: np.ndarray, success: np.ndarray) -> float:
    """Area under the ROC curve: how often a success has the higher score of a pair; 0.5 where there are no pairs."""
    positives, negatives = int(success.sum()), int((~success).sum())
    if not positives or not negatives:
        return 0.5
    values, at = np.unique(score, return_inverse=True)
    count = np.bincount(at, minlength=len(values))
    rank = np.cumsum(count) - (count - 1) / 2  # of ties the mean, from 1
    return float((rank[at][success].sum() - positives * (positives + 1) / 2) / (positives * negatives))
