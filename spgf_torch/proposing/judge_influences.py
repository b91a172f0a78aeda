"""Which numbers moved a judge most: it is evaluated again with each replaced by its median among the hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.proposing.judge import KNOWN, Judge

# Probabilities nearer to 0 and 1 have the log-odds of this.
_LEAST = 1e-6


@dataclass(frozen=True)
class Numbers:
    """What a judge knew of one grasp.

    Attributes:
        values: (D,) f32, `judge_features.NAMES`. usual: (D,) f32, their medians among all hypotheses about the target.
        images: whether unseen space was known. scene: whether it was weighed by what the judge learned in scenes.
    """

    values: Tensor
    usual: Tensor
    images: bool
    scene: bool = False


@dataclass(frozen=True)
class Weight:
    """One number of a grasp, and by how much it moved the log-odds of holding, against the usual number."""

    name: str
    value: float
    usual: float
    moved: float


def weighed(judge: Judge, grasps: Sequence[Numbers]) -> list[list[Weight]]:
    """Of each grasp the numbers that moved the judge, most first; those that did not move it are left out."""
    found = []
    for grasp in grasps:
        names = KNOWN["images" if grasp.images else "bare"]
        rows = grasp.values.repeat(len(names) + 1, 1)
        at = torch.arange(len(names))
        rows[at, at] = grasp.usual[: len(names)]
        free, holds = judge.both_in_scene(rows) if grasp.scene else judge.both(rows, grasp.images)
        log_odds = torch.logit((free * holds).clamp(_LEAST, 1 - _LEAST))
        moved = (log_odds[-1] - log_odds[:-1]).tolist()
        weights = [
            Weight(name, float(grasp.values[i]), float(grasp.usual[i]), moved[i])
            for i, name in enumerate(names)
            if moved[i] != 0.0
        ]
        found.append(sorted(weights, key=lambda weight: -abs(weight.moved)))
    return found
