"""Rankings of candidate grasps from the votes of an object's features.

`paper`: "the N highest ranked grasps (in a combined selection of support and probability, here the support depict
that a grasp have achieved a significant amount of votes)" (section 4): the mean of the learned probabilities over a
grasp's votes, drawn towards 0 by `vote_shrinkage` votes, so that a grasp needs both sure votes and many.

`log_odds`: the mean, over the votes, of log-odds(P) - log-odds(base rate of the grasp's type). It asks how much
better than usual for its type a grasp is, so that a type that succeeds more often at random does not drown the others
(the gap of the paper's Table 1). Support shrinks twice: P is drawn towards the base rate by `shrinkage` particles,
and the mean towards no evidence by `vote_shrinkage` votes.

`log_odds_free`: the same, but grasps that would start in a sensed collision come after all others.

`calibrated`: the calibrated probability of success (`calibration`), which compares the types on one scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration
from spgf_torch.affordance.config import NESTED, AffordanceConfig
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.voting import Votes

# The ranking by calibrated probabilities.
CALIBRATED = "calibrated"

# Far below any score, yet above no support at all: sensed collisions keep their order among themselves.
COLLIDING = -1e3

# No significant vote at all: below every grasp that has one.
UNSUPPORTED = float("-inf")


@dataclass(frozen=True)
class GraspScores:
    """What votes say of an object's grasps.

    Attributes:
        votes (G,) int64: how many.
        probability_before (G,) f32: their mean learned probability; the type's base rate without votes.
        probability (G,) f32: calibrated; that before until a calibration is known.
        by_ranking: name of `config.RANKINGS`, of `config.NESTED`, or one that joined -> (G,) f32, higher is better;
            UNSUPPORTED without votes.
        grasp_type (G,) int64; collides (G,) bool: a sensed point lies inside the open hand.
        types: how many grasp types the hand has.
        chosen: the ranking that was chosen on other objects, if one was.
    """

    votes: Tensor
    probability_before: Tensor
    probability: Tensor
    by_ranking: dict[str, Tensor]
    grasp_type: Tensor
    collides: Tensor
    types: int
    chosen: str = ""

    @property
    def log_odds(self) -> Tensor:
        """(G,) f32: the score that calibration starts from."""
        return self.by_ranking["log_odds"]

    def calibrated(self, calibration: Calibration) -> GraspScores:
        """With calibrated probabilities, and their ranking."""
        probability = calibration.probability(self.log_odds, self.grasp_type, self.collides)
        ranked = probability.masked_fill(self.votes == 0, UNSUPPORTED)
        return replace(self, probability=probability, by_ranking={**self.by_ranking, CALIBRATED: ranked})

    def with_chosen(self, ranking: str) -> GraspScores:
        """With `config.NESTED`: the ranking that was chosen on other objects."""
        return replace(self.joined_by(NESTED, self.by_ranking[ranking]), chosen=ranking)

    def joined_by(self, ranking: str, score: Tensor) -> GraspScores:
        """With the scores (G,) of another ranking, which was not among those to choose from."""
        return replace(self, by_ranking={**self.by_ranking, ranking: score})


def score_grasps(
    votes: Votes, base_rate: Tensor, grasp_type: Tensor, collides: Tensor, config: AffordanceConfig
) -> GraspScores:
    """Combine the votes on grasps of types (G,), given the base rate (types,) of each type; not calibrated."""
    count = torch.bincount(votes.grasp, minlength=len(grasp_type))
    total = _sum_per_grasp(votes.probability, votes, len(grasp_type))
    gain = _sum_per_grasp(log_odds_gain(votes, base_rate, grasp_type, config), votes, len(grasp_type))
    mean = torch.where(count == 0, base_rate[grasp_type], total / count)
    log_odds = shrunk_mean(gain, count, config)
    by_ranking = {
        "paper": shrunk_mean(total, count, config),
        "log_odds": log_odds,
        "log_odds_free": log_odds + COLLIDING * collides,
    }
    return GraspScores(count, mean, mean, by_ranking, grasp_type, collides, len(base_rate))


def shrunk_mean(total: Tensor, votes: Tensor, config: AffordanceConfig) -> Tensor:
    """(G,) f32 mean of votes that add up to `total` (G,), drawn towards 0 by `vote_shrinkage` of them."""
    return (total / (votes + config.vote_shrinkage)).masked_fill(votes == 0, UNSUPPORTED)


def log_odds_gain(votes: Votes, base_rate: Tensor, grasp_type: Tensor, config: AffordanceConfig) -> Tensor:
    """(V,) f32: how much better than the base rate of its grasp's type each vote is, in log-odds."""
    return _gain(votes.probability, votes.support, base_rate[grasp_type[votes.grasp]], config)


def point_gains(condensed: Condensed, config: AffordanceConfig) -> Tensor:
    """(P,) f32: the same of every point, as a vote that finds it."""
    gains = torch.empty_like(condensed.probability)
    for s, (first, end) in enumerate(pairwise(condensed.partition_start.tolist())):
        base = condensed.base_rate[s % condensed.types]
        gains[first:end] = _gain(condensed.probability[first:end], condensed.support[first:end], base, config)
    return gains


def _gain(probability: Tensor, support: Tensor, base_rate: Tensor, config: AffordanceConfig) -> Tensor:
    base = base_rate.clamp(1e-4, 1 - 1e-4)
    shrunk = (probability * support + base * config.shrinkage) / (support + config.shrinkage)
    return torch.logit(shrunk, eps=1e-4) - torch.logit(base)


def _sum_per_grasp(values: Tensor, votes: Votes, grasps: int) -> Tensor:
    return torch.zeros(grasps, dtype=values.dtype, device=values.device).index_add_(0, votes.grasp, values)
