"""Scores of predictions by object, and paired differences with intervals from objects drawn with replacement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spgf_torch.evaluation.reliability import auc

RESAMPLES, SEED = 10_000, 0


def interval(values: np.ndarray) -> tuple[float, float, float]:
    """Mean and 95 % interval over objects; those without a value (NaN) are left out."""
    known = np.asarray(values, float)
    known = known[~np.isnan(known)]
    means = np.random.default_rng(SEED).choice(known, (RESAMPLES, len(known))).mean(axis=1)
    return float(known.mean()), *(float(q) for q in np.quantile(means, (0.025, 0.975)))


def words(values: np.ndarray, scale: float = 1.0, digits: int = 3) -> str:
    """For people: mean (low to high)."""
    mean, low, high = (scale * value for value in interval(values))
    return f"{mean:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def scores(p: np.ndarray, held: np.ndarray, obj: np.ndarray, cloud: np.ndarray, best: int) -> Mapping[str, np.ndarray]:
    """Score -> its value of each object, in order: log-loss, Brier score, AUC, share of the `best` of each cloud."""
    found: dict[str, list[float]] = {"log_loss": [], "brier": [], "auc": [], "top": []}
    for i in np.unique(obj):
        its, held_i = np.clip(p[obj == i], 1e-6, 1 - 1e-6), held[obj == i]
        found["log_loss"].append(float(-np.mean(np.where(held_i, np.log(its), np.log1p(-its)))))
        found["brier"].append(float(np.mean((its - held_i) ** 2)))
        found["auc"].append(auc(its, held_i) if 0 < held_i.sum() < len(held_i) else np.nan)
        tops = []
        for c in np.unique(cloud[obj == i]):
            on = (cloud[obj == i] == c).nonzero()[0]
            order = on[np.argsort(-its[on], kind="stable")][:best]
            tops.append(held_i[order].sum() / best)
        found["top"].append(float(np.mean(tops)))
    return {name: np.array(values) for name, values in found.items()}
