"""Cross-validation over objects: prototypes and grasps are learned on the training folds, the others are novel.

Inside the training folds a second cross-validation, which holds out one of them at a time, calibrates probabilities
and chooses among the rankings. Prototypes are shared there: they know shapes, not outcomes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration, fit_calibration
from spgf_torch.affordance.config import NESTED, RANKINGS, AffordanceConfig
from spgf_torch.affordance.ranking import Judged, rankings
from spgf_torch.experiment.describe import Described
from spgf_torch.experiment.execution import best_grasps
from spgf_torch.experiment.training_set import Example, TrainedSpace


@dataclass(frozen=True)
class Predicted:
    """What a model that had not seen an object said of its grasps.

    Attributes:
        judged: votes and their combinations.
        scores: name of `config.RANKINGS`, `config.NESTED`, or one that joined -> (G,) f32.
        probability (G,) f32: calibrated.
        chosen: the ranking that the training folds chose.
    """

    judged: Judged
    scores: dict[str, Tensor]
    probability: Tensor
    chosen: str

    def joined_by(self, name: str, score: Tensor) -> Predicted:
        """The same with the scores (G,) of another ranking, which was not among those to choose from."""
        return replace(self, scores={**self.scores, name: score})


@dataclass(frozen=True)
class CrossValidation:
    """How to learn from training folds, and how to judge the rankings inside them.

    Attributes:
        inner_grasps: of each training object, calibrate and judge rankings: a random sample, to save time.
        N: highest-ranked grasps that count. Of the sample the same share counts as N is of all.
    """

    affordance: AffordanceConfig
    inner_grasps: int
    N: int
    seed: int

    def predict(
        self, groups: Sequence[Sequence[Example]], centres: Tensor, novel: Sequence[Described]
    ) -> tuple[list[Predicted], Calibration]:
        """Learn from the training folds and their prototypes (K, D), and judge the grasps of novel objects.

        The calibration is that of the training folds.
        """
        space = TrainedSpace(groups, centres, self.affordance)
        calibration, chosen = self.nested(space, groups)
        judged = space.judge(novel, [None] * len(novel))
        return [predicted(each, calibration, chosen) for each in judged], calibration

    def nested(self, space: TrainedSpace, groups: Sequence[Sequence[Example]]) -> tuple[Calibration, str]:
        """Calibration and choice of the ranking on training objects, each group held out from the others."""
        generator = torch.Generator().manual_seed(self.seed)
        train, without = [e for group in groups for e in group], [i for i, group in enumerate(groups) for _ in group]
        sampled = [e.of_grasps(e.sample(self.inner_grasps, generator)) for e in train]
        judged, success = space.judge([e.described for e in sampled], without), [e.success for e in sampled]
        calibration = calibrate(judged, success)
        share = sum(map(len, success)) / sum(len(example.success) for example in train)
        return calibration, choose(judged, success, calibration, math.ceil(self.N * share))


def predicted(judged: Judged, calibration: Calibration, chosen: str) -> Predicted:
    """Every ranking's scores, and the calibrated probability."""
    scores = rankings(judged, calibration)
    probability = calibration.probability(judged.log_odds, judged.grasp_type, judged.collides)
    return Predicted(judged, {**scores, NESTED: scores[chosen]}, probability, chosen)


def calibrate(judged: Sequence[Judged], success: Sequence[Tensor]) -> Calibration:
    """Calibration on grasps of objects that were held out; success: of each object (G,) bool."""
    score, grasp_type, collides = (
        torch.cat([getattr(j, name) for j in judged]) for name in ("log_odds", "grasp_type", "collides")
    )
    return fit_calibration(score, grasp_type, collides, torch.cat(list(success)))


def choose(judged: Sequence[Judged], success: Sequence[Tensor], calibration: Calibration, n: int) -> str:
    """The ranking whose n best grasps of both types together succeed most often; the first of equals."""
    rates = dict.fromkeys(RANKINGS, 0.0)
    for j, held in zip(judged, success, strict=True):
        for name, score in rankings(j, calibration).items():
            best = best_grasps(score, j.grasp_type, n)["CG"]
            rates[name] += float(held[best].float().sum()) / max(1, len(best))
    return max(rates, key=lambda name: rates[name])
