"""Settings of shape-grasp particles and voting, and the names of rankings."""

from __future__ import annotations

from dataclasses import dataclass

from spgf_torch.settings import bounded, defaults_from

# What a novel object's grasps can be ranked by (affordance/ranking.py).
RANKINGS = ("paper", "log_odds", "log_odds_free", "calibrated")


# The one of these that cross-validation inside the training folds chose, in each fold anew.
NESTED = "nested"


# A learned judge's probability (judging/candidates.py), where it is asked for.
JUDGE = "judge"


@dataclass
@defaults_from("affordance/lattice.yaml")
class AffordanceConfig:
    """Shape-grasp particles, neighbourhood analysis, condensation, voting (paper, section 3.4)."""

    reach: float = bounded(0.005, 0.5)
    voxel: float = bounded(0.001, 0.1)
    rotation_deg: float = bounded(5.0, 90.0)
    kernel: float = bounded(0.0, 0.1)
    kernel_deg: float = bounded(0.0, 90.0)
    min_support: float = bounded(0.0, 1e6)
    shrinkage: float = bounded(0.0, 1e6)
    vote_shrinkage: float = bounded(0.0, 1e6)
    features_per_object: int = bounded(1, 1_000_000)
