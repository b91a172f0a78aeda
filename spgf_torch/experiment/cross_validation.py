"""Cross-validation inside the training folds: how probabilities are calibrated and a ranking is chosen.

One training fold at a time is held out from the others, of which prototypes and the shape-grasp space are learned anew
(`design.Design.inner_folds`). What they say of its grasps calibrates probabilities. To choose the ranking, each
held-out fold has probabilities that the others calibrated: no ranking is judged on grasps that it was fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration, fit_calibration
from spgf_torch.affordance.config import RANKINGS
from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.experiment.execution import ranked_grasps


def calibrate(scores: Sequence[GraspScores], success: Sequence[Tensor], groups: Sequence[int]) -> Calibration:
    """Calibration on grasps of objects that were held out.

    Args:
        success: of each object (G,) bool. groups: of each object the group with which it was held out.
    """
    log_odds, grasp_type, collides = (
        torch.cat([getattr(each, name) for each in scores]) for name in ("log_odds", "grasp_type", "collides")
    )
    group = torch.cat([torch.full_like(each.grasp_type, g) for each, g in zip(scores, groups, strict=True)])
    return fit_calibration(log_odds, grasp_type, collides, torch.cat(list(success)), scores[0].types, group)


def calibrated_elsewhere(
    scores: Sequence[GraspScores], success: Sequence[Tensor], groups: Sequence[int]
) -> list[GraspScores]:
    """The scores of each object with the probabilities that the other groups calibrate; arguments of `calibrate`."""
    rows = list(zip(scores, success, groups, strict=True))
    of_others = {group: calibrate(*zip(*(row for row in rows if row[2] != group), strict=True)) for group in {*groups}}
    return [each.calibrated(of_others[group]) for each, _, group in rows]


def choose(scores: Sequence[GraspScores], success: Sequence[Tensor], n: int) -> str:
    """The ranking whose n best grasps of all types together succeed most often; the first of equals."""
    rates = dict.fromkeys(RANKINGS, 0.0)
    for each, outcomes in zip(scores, success, strict=True):
        for name in rates:
            best = ranked_grasps(each.by_ranking[name])[:n]
            rates[name] += float(outcomes[best].float().sum()) / max(1, len(best))
    return max(rates, key=lambda name: rates[name])
