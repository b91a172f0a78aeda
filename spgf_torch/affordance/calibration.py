"""Calibration: from a grasp's log-odds score to the probability that it succeeds.

Platt scaling (Platt 1999) of each grasp type on its own: a logistic regression on the score, with a term for sensed
collisions and one for grasps without votes, fitted on grasps that the scores were not learned from. Votes against a
grasp may tell less than votes for one, so the curve may bend: below the bend all scores count as the bend itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

# Standard deviation of the prior on each weight: keeps the fit finite where a class of outcomes is absent.
PRIOR = 10.0

TERMS = ("constant", "score", "collides", "no votes")
NUMBERS = (*TERMS, "bend")

# Where the curve may bend: quantiles of the scores of grasps without a sensed collision. At the first it is straight.
BENDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)

# A bend below every score.
STRAIGHT = torch.finfo(torch.float32).min

# Newton's method: steps, halvings of a step, and the relative decrease of the loss that ends it.
STEPS, HALVINGS, SETTLED = 100, 30, 1e-12


@dataclass(frozen=True)
class Calibration:
    """Of each grasp type the weights of a logistic regression and its bend: (types, NUMBERS) f32."""

    numbers: Tensor

    def probability(self, score: Tensor, grasp_type: Tensor, collides: Tensor) -> Tensor:
        """(G,) f32 probability of success; `score` (G,) is the log-odds score, -inf without votes."""
        its = self.numbers.to(score.device)[grasp_type]
        return torch.sigmoid((_terms(score, collides, its[:, -1]) * its[:, :-1]).sum(1))


def uncalibrated(base_rate: Tensor) -> Calibration:
    """The score taken at its word: log-odds on top of those of the base rate (types,), whatever else is known."""
    constant = torch.logit(base_rate, eps=1e-4)
    nothing = torch.zeros_like(constant)
    bend = torch.full_like(constant, STRAIGHT)
    return Calibration(torch.stack([constant, torch.ones_like(constant), nothing, nothing, bend], dim=1))


def fit_calibration(
    score: Tensor, grasp_type: Tensor, collides: Tensor, success: Tensor, types: int, group: Tensor | None = None
) -> Calibration:
    """Platt scaling on grasps that the scores were not learned from.

    Args:
        score: (G,) f32, log-odds. grasp_type: (G,) int64. collides, success: (G,) bool.
        types: how many grasp types the hand has.
        group: (G,) int64, groups of objects, held out from each other to choose the bend; None: there is none.
    """
    columns = (score, collides, success, torch.zeros_like(grasp_type) if group is None else group)
    of_types = [[column[grasp_type == code] for column in columns] for code in range(types)]
    return Calibration(torch.stack([_curve(*its) for its in of_types]).to(score.device))


def _curve(score: Tensor, collides: Tensor, success: Tensor, group: Tensor) -> Tensor:
    """The NUMBERS (N,) f32 of one type."""
    known = score[~collides & ~torch.isinf(score)].double()
    places = torch.quantile(known, known.new_tensor(BENDS)).tolist() if len(known) else [STRAIGHT]
    free = ~collides
    bend = _chosen_bend(places, score[free], success[free], group[free])
    weights = _logistic(_columns(score, collides, bend), success.cpu().numpy())
    return torch.from_numpy(np.append(weights, bend)).float()


def _chosen_bend(places: list[float], score: Tensor, success: Tensor, group: Tensor) -> float:
    """The place of the least held-out log loss on grasps without a sensed collision.

    Others than the first must lower it in most groups: a single object with many such grasps outweighs a group.
    """
    groups, outcomes = group.cpu().numpy(), success.cpu().numpy()
    free = torch.zeros_like(success)
    loss = np.array([_held_out_loss(_columns(score, free, at), outcomes, groups) for at in places])
    helps = 2 * (loss < loss[0]).sum(axis=1) > loss.shape[1]
    helps[0] = True
    return places[int(np.where(helps, loss.sum(axis=1), np.inf).argmin())]


def _held_out_loss(terms: np.ndarray, success: np.ndarray, group: np.ndarray) -> list[float]:
    """Log loss of each group's grasps, added up, by the curve of the other groups."""
    losses = []
    for left_out in (group == g for g in np.unique(group)):
        margin = terms[left_out] @ _logistic(terms[~left_out], success[~left_out])
        losses.append(float(np.logaddexp(0, np.where(success[left_out], -margin, margin)).sum()))
    return losses


def _columns(score: Tensor, collides: Tensor, bend: float) -> np.ndarray:
    return _terms(score.double(), collides, score.new_tensor(bend).double()).cpu().numpy()


def _terms(score: Tensor, collides: Tensor, bend: Tensor) -> Tensor:
    """(G, TERMS): what is weighed."""
    silent = torch.isinf(score)
    known = torch.where(silent, torch.zeros_like(score), torch.maximum(score, bend))
    return torch.stack([torch.ones_like(known), known, collides.to(known.dtype), silent.to(known.dtype)], dim=1)


def _logistic(terms: np.ndarray, success: np.ndarray) -> np.ndarray:
    """Weights (T,) that minimise the negative log-likelihood plus the prior, convex, by Newton's method."""
    sign, precision = np.where(success, 1.0, -1.0), 1 / PRIOR**2

    def loss(weights: np.ndarray) -> float:
        return float(np.logaddexp(0, -sign * (terms @ weights)).sum() + 0.5 * precision * (weights**2).sum())

    weights = np.zeros(terms.shape[1])
    value = loss(weights)
    for _ in range(STEPS):
        wrong = 1 / (1 + np.exp(np.clip(sign * (terms @ weights), -500, 500)))
        slope = precision * weights - terms.T @ (sign * wrong)
        curvature = precision * np.eye(len(weights)) + (terms.T * (wrong * (1 - wrong))) @ terms
        step = np.linalg.solve(curvature, slope)
        tried = next((t for t in 0.5 ** np.arange(HALVINGS) if loss(weights - t * step) < value), 0.0)
        weights, before = weights - tried * step, value
        value = loss(weights)
        if before - value <= SETTLED * before:
            break
    return weights
