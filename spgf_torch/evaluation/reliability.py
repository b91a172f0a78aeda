"""How far predicted probabilities can be trusted: Brier score, expected calibration error, reliability diagrams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Bins of equal width of the expected calibration error, as usual (Guo et al. 2017 use 10 to 15).
BINS = 10


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


def brier(probability: np.ndarray, success: np.ndarray) -> float:
    """Mean squared distance of probability (G,) and outcome (G,) bool; 0 of nothing."""
    return float(np.mean((probability - success) ** 2)) if len(success) else 0.0
