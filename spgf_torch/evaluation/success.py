"""Success-rates of ranked grasps (paper, Eq. 10), chance and ceiling beside them, and intervals over objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spgf_torch.objects.config import CLASSES

ALL = "CG"  # all grasp types of a hand in one ranking: the paper's combined grasps

Rates = dict[str, float]  # of one object: grasp type or CG -> share of successes


def of_each_type(grasp_type: np.ndarray, grasp_types: Sequence[str]) -> dict[str, np.ndarray]:
    """Grasp type, and CG at the end -> (G,) bool: which grasps are of that type; CG takes all."""
    of_type = {name: grasp_type == code for code, name in enumerate(grasp_types)}
    return {**of_type, ALL: np.ones(len(grasp_type), dtype=bool)}


def top_n(score: np.ndarray, success: np.ndarray, grasp_type: np.ndarray, n: int, grasp_types: Sequence[str]) -> Rates:
    """Eq. 10: the share of successes among the n highest-ranked grasps, of each type and of all in one ranking.

    Of fewer than n grasps the share is that of all of them; of none it is 0.

    Args:
        score: (G,) float, higher is better; ties go to the earlier grasp.
        success: (G,) bool. grasp_type: (G,) int, index into `grasp_types`.
    """
    rates = {}
    for name, of_type in of_each_type(grasp_type, grasp_types).items():
        among = np.flatnonzero(of_type)
        best = among[np.argsort(-score[among], kind="stable")[:n]]
        rates[name] = float(success[best].mean()) if len(best) else 0.0
    return rates


def random_rate(
    success: np.ndarray, grasp_type: np.ndarray, grasp_types: Sequence[str], among: np.ndarray | None = None
) -> Rates:
    """The share of successes of each type (CG: of all), of all grasps or of those `among` (G,) bool.

    Where none is among them, picking one at random cannot succeed: 0.
    """
    kept = np.ones(len(success), dtype=bool) if among is None else among
    chosen = {name: success[kept & of_type] for name, of_type in of_each_type(grasp_type, grasp_types).items()}
    return {name: float(its.mean()) if len(its) else 0.0 for name, its in chosen.items()}


def ceiling(success: np.ndarray, grasp_type: np.ndarray, n: int, grasp_types: Sequence[str]) -> Rates:
    """What the n best grasps by outcome would give: no ranking can do better."""
    each = of_each_type(grasp_type, grasp_types)
    return {name: min(n, int(success[of_type].sum())) / n for name, of_type in each.items()}


def class_means(classes: Sequence[str], rates: Sequence[Mapping[str, float]]) -> dict[str, Rates]:
    """Mean over the objects of each class, and over all objects (as in the paper: Table 1's "all")."""
    return {
        name: {grasp_type: float(np.mean([rates[i][grasp_type] for i in members])) for grasp_type in rates[0]}
        for name, members in _members(classes).items()
    }


def bootstrap_interval(
    classes: Sequence[str], rates: Sequence[Mapping[str, float]], resamples: int, seed: int
) -> dict[str, dict[str, list[float]]]:
    """95 % percentile intervals of `class_means` over objects drawn with replacement, within their class.

    "all" is the mean over the resampled classes together: their sizes are part of the design, not of chance.
    """
    rng = np.random.default_rng(seed)
    grasp_types = list(rates[0])
    values = np.array([[rate[grasp_type] for grasp_type in grasp_types] for rate in rates])
    means: dict[str, np.ndarray] = {}
    total, count = np.zeros((resamples, len(grasp_types))), 0
    for name, members in _members(classes).items():
        if name == "all":
            continue
        drawn = rng.choice(members, size=(resamples, len(members)))
        sums = values[drawn].sum(axis=1)
        means[name] = sums / len(members)
        total, count = total + sums, count + len(members)
    means["all"] = total / count
    return {
        name: {grasp_type: np.quantile(mean[:, j], (0.025, 0.975)).tolist() for j, grasp_type in enumerate(grasp_types)}
        for name, mean in means.items()
    }


def paired_difference(
    classes: Sequence[str],
    ours: Sequence[Mapping[str, float]],
    theirs: Sequence[Mapping[str, float]],
    resamples: int,
    seed: int,
) -> tuple[dict[str, Rates], dict[str, dict[str, list[float]]]]:
    """Mean of ours - theirs over the same objects, and its 95 % interval, as `class_means` and `bootstrap_interval`.

    What an object contributes to both cancels: the interval is that of the difference, not of two unrelated means.
    """
    pairs = zip(ours, theirs, strict=True)
    differences = [{grasp_type: mine[grasp_type] - other[grasp_type] for grasp_type in mine} for mine, other in pairs]
    return class_means(classes, differences), bootstrap_interval(classes, differences, resamples, seed)


def _members(classes: Sequence[str]) -> dict[str, np.ndarray]:
    """Indices of the objects of each class that occurs, in the contract's order, then of all."""
    labels = np.asarray(classes)
    present = {name: np.flatnonzero(labels == name) for name in CLASSES if (labels == name).any()}
    return {**present, "all": np.arange(len(labels))}
