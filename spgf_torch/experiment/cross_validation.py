"""Cross-validation over objects: prototypes and grasps are learned on the training folds, the others are novel.

Inside the training folds a second cross-validation, which holds out one of them at a time, calibrates probabilities
and chooses among the rankings. Prototypes are shared there: they know shapes, not outcomes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration, fit_calibration
from spgf_torch.affordance.config import RANKINGS, AffordanceConfig
from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.execution import best_grasps
from spgf_torch.experiment.training_space import TrainingSpace


@dataclass(frozen=True)
class CrossValidation:
    """How to learn from training folds, and how to choose among the rankings inside them.

    Attributes:
        inner_grasps: of each training object, calibrate and choose rankings: a random sample, to save time.
        N: highest-ranked grasps that count. Of the sample the same share counts as N is of all.
    """

    affordance: AffordanceConfig
    inner_grasps: int
    N: int
    seed: int

    def predict(
        self, groups: Sequence[Sequence[DescribedObject]], centres: Tensor, novel: Sequence[DescribedObject]
    ) -> tuple[list[GraspScores], Calibration]:
        """Learn from the training folds and their prototypes (K, D), and score the grasps of novel objects.

        The calibration is that of the training folds.
        """
        space = TrainingSpace(groups, centres, self.affordance)
        calibration, chosen = self.nested(space, groups)
        scores = space.score_grasps(novel, [None] * len(novel))
        return [each.calibrated(calibration).with_chosen(chosen) for each in scores], calibration

    def nested(self, space: TrainingSpace, groups: Sequence[Sequence[DescribedObject]]) -> tuple[Calibration, str]:
        """Calibration and choice of the ranking on training objects, each group held out from the others."""
        generator = torch.Generator().manual_seed(self.seed)
        train = [obj for group in groups for obj in group]
        excluded_groups = [i for i, group in enumerate(groups) for _ in group]
        sampled = [obj.of_grasps(obj.sample(self.inner_grasps, generator)) for obj in train]
        scores, success = space.score_grasps(sampled, excluded_groups), [obj.outcomes for obj in sampled]
        calibration = calibrate(scores, success)
        share = sum(map(len, success)) / sum(map(len, train))
        return calibration, choose(scores, success, calibration, math.ceil(self.N * share))


def calibrate(scores: Sequence[GraspScores], success: Sequence[Tensor]) -> Calibration:
    """Calibration on grasps of objects that were held out; success: of each object (G,) bool."""
    log_odds, grasp_type, collides = (
        torch.cat([getattr(each, name) for each in scores]) for name in ("log_odds", "grasp_type", "collides")
    )
    return fit_calibration(log_odds, grasp_type, collides, torch.cat(list(success)))


def choose(scores: Sequence[GraspScores], success: Sequence[Tensor], calibration: Calibration, n: int) -> str:
    """The ranking whose n best grasps of both types together succeed most often; the first of equals."""
    rates = dict.fromkeys(RANKINGS, 0.0)
    for each, outcomes in zip(scores, success, strict=True):
        for name, score in each.calibrated(calibration).by_ranking.items():
            best = best_grasps(score, each.grasp_type, n)["CG"]
            rates[name] += float(outcomes[best].float().sum()) / max(1, len(best))
    return max(rates, key=lambda name: rates[name])
