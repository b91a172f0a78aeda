"""Calibration: from a grasp's log-odds score to the probability that it succeeds.

Platt scaling (Platt 1999) of each grasp type on its own: a logistic regression on the score, with a term for sensed
collisions and one for grasps without votes, fitted on grasps that the scores were not learned from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from spgf_torch.hands.config import GRASP_TYPES

# Standard deviation of the prior on each weight: keeps the fit finite where a class of outcomes is absent.
PRIOR = 10.0

TERMS = ("constant", "score", "collides", "no votes")


@dataclass(frozen=True)
class Calibration:
    """Weights (types, TERMS) f32 of the logistic regressions, a row a grasp type."""

    weights: Tensor

    def probability(self, score: Tensor, grasp_type: Tensor, collides: Tensor) -> Tensor:
        """(G,) f32 probability of success; `score` (G,) is the log-odds score, -inf without votes."""
        logit = (_terms(score, collides) * self.weights.to(score.device)[grasp_type]).sum(1)
        return torch.sigmoid(logit)


def uncalibrated(base_rate: Tensor) -> Calibration:
    """The score taken at its word: log-odds on top of those of the base rate (types,), whatever else is known."""
    constant = torch.logit(base_rate, eps=1e-4)
    nothing = torch.zeros_like(constant)
    return Calibration(torch.stack([constant, torch.ones_like(constant), nothing, nothing], dim=1))


def fit_calibration(score: Tensor, grasp_type: Tensor, collides: Tensor, success: Tensor) -> Calibration:
    """Platt scaling on held-out grasps: score (G,) f32, grasp_type (G,) int64, collides (G,) and success (G,) bool."""
    terms, outcomes = _terms(score, collides).double().cpu().numpy(), success.cpu().numpy()
    types = grasp_type.cpu().numpy()
    rows = [_logistic(terms[types == code], outcomes[types == code]) for code in range(len(GRASP_TYPES))]
    return Calibration(torch.from_numpy(np.stack(rows)).float())


def _terms(score: Tensor, collides: Tensor) -> Tensor:
    silent = torch.isinf(score)
    known = torch.where(silent, torch.zeros_like(score), score)
    return torch.stack([torch.ones_like(known), known, collides.to(known.dtype), silent.to(known.dtype)], dim=1)


def _logistic(terms: np.ndarray, success: np.ndarray) -> np.ndarray:
    """Weights (T,) that minimise the negative log-likelihood plus the prior: convex, one minimum."""
    from scipy.optimize import minimize  # half a second, which asking a model does not need

    sign = np.where(success, 1.0, -1.0)

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (terms @ weights)
        slope = -sign / (1 + np.exp(np.clip(margin, -500, 500)))
        value = np.logaddexp(0, -margin).sum() + 0.5 * (weights**2).sum() / PRIOR**2
        return float(value), terms.T @ slope + weights / PRIOR**2

    return np.asarray(minimize(loss, np.zeros(terms.shape[1]), jac=True, method="L-BFGS-B").x)
