"""Fitting a judge to rows: two factors, each with images and without; scikit-learn learns, plain arrays remain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from threadpoolctl import threadpool_limits
from torch import Tensor

from spgf_torch.judging.config import JudgeConfig, TreesConfig
from spgf_torch.judging.training_rows import Rows
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.proposing.judge import FACTORS, KNOWN, VIEWS, Curve, Judge
from spgf_torch.proposing.judge_features import NAMES
from spgf_torch.proposing.tree_ensembles import Form, Logistic, Trees
from spgf_torch.settings import plain
from spgf_torch.threads import in_parts

# Rows below which an object weighs less than others: a few are no sample of it.
_FEW = 50
# Probabilities nearer 0 or 1 than this are not told apart where a calibration is learned.
_EDGE = 1e-6
# Values of a number that trees tell apart: scikit-learn's most.
BINS = 255
# Strength of the logistic form's regularisation (scikit-learn's C), and steps until it must have settled.
_C, _STEPS = 0.3, 5000


def learn_judge(rows: Rows, config: JudgeConfig, known: Sequence[str] = tuple(KNOWN)) -> dict[tuple[str, str], Form]:
    """The factors of a judge: P(free) from all rows, P(holds | free) from those that were tried and free.

    Args:
        known: which of `KNOWN` are needed; to choose trials, the one with images alone.
    """
    tried = rows.at(rows.tried)
    every = torch.ones_like(rows.free)
    targets = {"free": (rows, every, rows.free), "holds": (tried, tried.free, tried.success)}
    keys = [(name, factor) for name in known for factor in FACTORS]

    def work(key: tuple[str, str]) -> Form:
        its, among, label = targets[key[1]]
        # Each on one thread of its own: scikit-learn's threads wait for each other at every split of every tree.
        with threadpool_limits(1, user_api="openmp"):
            return fit(its.numbers[among, : len(KNOWN[key[0]])], label[among], weights(its)[among], config)

    return dict(zip(keys, in_parts(work, keys), strict=True))


def settings_of(config: JudgeConfig) -> Mapping[str, Any]:
    """What `Judge.settings` holds."""
    return {"hand": plain(config.hand), "hypotheses": plain(config.hypotheses)}


def judge_of(factors: Mapping[tuple[str, str], Form], objects: Sequence[GraspObject], config: JudgeConfig) -> Judge:
    """A judge of these factors, which learned from these objects."""
    return Judge(factors, settings_of(config), config.sure, {obj.name: obj.digest for obj in objects})


def calibration_of(best: Rows) -> dict[str, Curve]:
    """`Judge.calibration` from the executed best of judges that had not seen the object, and what these said."""
    views = best.numbers[:, NAMES.index("views")]
    of_each = zip(VIEWS, (views <= 1, views > 1), strict=True)
    return {name: rising_curve(best.probability[of], best.success[of]) for name, of in of_each if of.any()}


def rising_curve(p: Tensor, success: Tensor) -> Curve:
    """What makes p (R,) the share of successes (R,).

    A prior of one standard deviation on the shift and on the slopes' logarithms keeps them finite.
    """
    from scipy.optimize import minimize  # half a second

    its = p.double().clamp(_EDGE, 1 - _EDGE).numpy()
    low, high, sign = np.log(its), -np.log1p(-its), np.where(success.numpy(), 1.0, -1.0)

    def loss(curve: np.ndarray) -> float:
        log_odds = math.exp(curve[0]) * low + math.exp(curve[1]) * high + curve[2]
        return float(np.logaddexp(0, -sign * log_odds).sum() + 0.5 * (curve**2).sum())

    slope_low, slope_high, shift = minimize(loss, np.zeros(3)).x
    return math.exp(slope_low), math.exp(slope_high), float(shift)


def weights(rows: Rows) -> Tensor:
    """(R,) f64, mean 1: each object counts alike, however many of its trials are admissible."""
    count = torch.bincount(rows.obj).clamp(min=_FEW)
    weight = 1 / count[rows.obj].double()
    return weight / weight.mean() if len(weight) else weight


def fit(numbers: Tensor, label: Tensor, weight: Tensor, config: JudgeConfig) -> Form:
    """One factor from numbers (R, D), labels (R,) bool and weights (R,); of one label alone, its share smoothed."""
    positives = int(label.sum())
    if positives in (0, len(label)):
        return _constant(math.log((positives + 1) / (len(label) - positives + 1)))
    x, y, w = numbers.double().numpy(), label.numpy(), weight.numpy()
    return _trees(x, y, w, config.learning) if config.form == "trees" else _logistic(x, y, w)


def _trees(x: np.ndarray, y: np.ndarray, weight: np.ndarray, config: TreesConfig) -> Trees:
    learner = HistGradientBoostingClassifier(
        max_iter=config.trees,
        learning_rate=config.rate,
        max_leaf_nodes=config.leaves,
        min_samples_leaf=config.least,
        l2_regularization=config.l2,
        early_stopping=False,
        random_state=0,
    )
    edges = [quantiles(column) for column in x.T]
    # Few whole numbers, of which scikit-learn need not find weighted quantiles, which takes it most of the time.
    ranks = np.stack([np.searchsorted(its, column) for its, column in zip(edges, x.T, strict=True)], axis=1)
    return unranked(trees_of(learner.fit(ranks, y, sample_weight=weight)), edges)


def quantiles(values: np.ndarray) -> np.ndarray:
    """(<= BINS - 1,) float64, rising: places between values (R,) where a tree may part them."""
    found = np.unique(values)
    if len(found) > BINS:
        found = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)[1:-1], method="lower"))
        above = np.unique(values)
        after = above[np.minimum(np.searchsorted(above, found, side="right"), len(above) - 1)]
        return (found + after) / 2
    return (found[:-1] + found[1:]) / 2


def unranked(trees: Trees, edges: Sequence[np.ndarray]) -> Trees:
    """The same trees asked about numbers, which were learned from their ranks among `edges`, of each feature."""
    threshold = trees.threshold.clone()
    for node in (trees.feature >= 0).nonzero()[:, 0].tolist():
        threshold[node] = edges[int(trees.feature[node])][int(threshold[node])]
    return replace(trees, threshold=threshold)


def trees_of(learner: HistGradientBoostingClassifier) -> Trees:
    """The arrays of a fitted classifier of two classes and numbers that are all there."""
    trees = [stage[0].nodes for stage in learner._predictors]
    root = np.cumsum([0, *(len(nodes) for nodes in trees[:-1])])
    nodes = np.concatenate(trees)
    first = np.repeat(root, [len(tree) for tree in trees])
    leaf, own = nodes["is_leaf"].astype(bool), np.arange(len(nodes))
    arrays = (
        root.astype(np.int32),
        np.asarray(learner._baseline_prediction, np.float64).reshape(1),
        np.where(leaf, -1, nodes["feature_idx"]).astype(np.int16),
        np.where(leaf, 0.0, nodes["num_threshold"]),
        np.where(leaf, own, nodes["left"] + first).astype(np.int32),
        np.where(leaf, own, nodes["right"] + first).astype(np.int32),
        np.where(leaf, nodes["value"], 0.0),
    )
    return Trees(*(torch.from_numpy(np.ascontiguousarray(array)) for array in arrays))


def _logistic(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> Logistic:
    mean, scale = torch.from_numpy(x.mean(axis=0)), torch.from_numpy(x.std(axis=0)).clamp(min=1e-9)
    terms = Logistic.terms(torch.from_numpy(x), mean, scale).numpy()
    learner = LogisticRegression(C=_C, max_iter=_STEPS).fit(terms, y, sample_weight=weight)
    return Logistic(mean, scale, torch.from_numpy(learner.coef_[0].copy()), torch.from_numpy(learner.intercept_.copy()))


def _constant(log_odds: float) -> Trees:
    """One leaf."""
    zero = torch.zeros(1)
    one = zero.int()
    leaf = torch.tensor([-1], dtype=torch.int16)
    return Trees(one, torch.tensor([log_odds]).double(), leaf, zero.double(), one, one, zero.double())
