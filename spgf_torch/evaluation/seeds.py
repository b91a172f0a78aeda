"""Rates of one experiment that was repeated with several seeds: means, and intervals over seeds and objects together.

A seed decides folds, noise and draws for all objects at once, and an object is as hard under every seed: the two are
crossed, not nested. So both are drawn with replacement, each by itself, and every drawn object counts under every
drawn seed: the bootstrap of Owen (2007, The pigeonhole bootstrap, Annals of Applied Statistics 1(2), 386-411), with
objects drawn within their class. Of one seed it is the bootstrap over objects. Drawing from S seeds shows 1 - 1/S of
their variance; what is chance of a single object under a single seed is counted more than once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spgf_torch.evaluation.success import Rates, class_means
from spgf_torch.objects.config import CLASSES

OfSeeds = Sequence[Sequence[Mapping[str, float]]]  # of each seed, of each object in the same order: type -> rate


def mean_over_seeds(classes: Sequence[str], rates: OfSeeds) -> dict[str, Rates]:
    """Mean over seeds and objects, of each class that occurs and of all objects."""
    means = [{kind: float(np.mean([rate[kind] for rate in of])) for kind in of[0]} for of in zip(*rates, strict=True)]
    return class_means(classes, means)


def interval_over_seeds(
    classes: Sequence[str], rates: OfSeeds, resamples: int, seed: int
) -> dict[str, dict[str, tuple[float, float]]]:
    """95 % percentile intervals of `mean_over_seeds`, over seeds and objects drawn with replacement.

    Args:
        classes: of each object.
        resamples: how often both are drawn. seed: of the draws.
    """
    rng = np.random.default_rng(seed)
    kinds, labels = list(rates[0][0]), np.asarray(classes)
    values = np.array([[[rate[kind] for kind in kinds] for rate in of_seed] for of_seed in rates])
    drawn = rng.multinomial(len(values), np.full(len(values), 1 / len(values)), size=resamples) / len(values)
    of_object = np.tensordot(drawn, values, 1)  # (resamples, objects, types): mean over the drawn seeds
    sums = {}
    for name in (name for name in CLASSES if name in classes):
        members = np.flatnonzero(labels == name)
        counts = rng.multinomial(len(members), np.full(len(members), 1 / len(members)), size=resamples)
        sums[name] = np.einsum("ri,rik->rk", counts, of_object[:, members])
    means = {name: total / (labels == name).sum() for name, total in sums.items()}
    means["all"] = np.sum(list(sums.values()), axis=0) / len(labels)
    return {name: _bounds(mean, kinds) for name, mean in means.items()}


def _bounds(means: np.ndarray, kinds: Sequence[str]) -> dict[str, tuple[float, float]]:
    low, high = np.quantile(means, (0.025, 0.975), axis=0).tolist()
    return dict(zip(kinds, zip(low, high, strict=True), strict=True))
