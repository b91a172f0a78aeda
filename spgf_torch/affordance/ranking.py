"""Rankings of candidate grasps from the votes of an object's features.

`paper`: "the N highest ranked grasps (in a combined selection of support and probability, here the support depict
that a grasp have achieved a significant amount of votes)" (section 4): the mean of the learned probabilities over a
grasp's votes, drawn towards 0 by `vote_shrinkage` votes, so that a grasp needs both sure votes and many.

`log_odds`: the mean, over the votes, of log-odds(P) - log-odds(base rate of the grasp's type). It asks how much
better than usual for its type a grasp is, so that a type that succeeds more often at random does not drown the other
(the gap of the paper's Table 1). Support shrinks twice: P is drawn towards the base rate by `shrinkage` particles,
and the mean towards no evidence by `vote_shrinkage` votes.

`log_odds_free`: the same, but grasps that would start in a sensed collision come after all others.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.voting import Votes
from spgf_torch.config import AffordanceConfig

FREE = "log_odds_free"

# Far below any score, yet above no support at all: sensed collisions keep their order among themselves.
COLLIDING = -1e3

# No significant vote at all: below every grasp that has one.
UNSUPPORTED = float("-inf")


def paper_scores(votes: Votes, condensed: Condensed, grasp_type: Tensor, config: AffordanceConfig) -> Tensor:
    """(G,) f32 shrunken mean probability of each grasp's votes; UNSUPPORTED without votes."""
    return _shrunken_mean(condensed.probability[votes.point], votes, len(grasp_type), config)


def log_odds_scores(votes: Votes, condensed: Condensed, grasp_type: Tensor, config: AffordanceConfig) -> Tensor:
    """(G,) f32 shrunken mean log-odds of each grasp's votes against its type's base rate; UNSUPPORTED without."""
    base = condensed.base_rate.clamp(1e-4, 1 - 1e-4)[grasp_type[votes.grasp]]
    support = condensed.support[votes.point]
    shrunk = (condensed.probability[votes.point] * support + base * config.shrinkage) / (support + config.shrinkage)
    gain = torch.logit(shrunk, eps=1e-4) - torch.logit(base)
    return _shrunken_mean(gain, votes, len(grasp_type), config)


RANKINGS: dict[str, Callable[[Votes, Condensed, Tensor, AffordanceConfig], Tensor]] = {
    "paper": paper_scores,
    "log_odds": log_odds_scores,
}


def all_scores(
    votes: Votes, condensed: Condensed, grasp_type: Tensor, collides: Tensor, config: AffordanceConfig
) -> dict[str, Tensor]:
    """Every ranking's score of each grasp: name -> (G,) f32, higher is better.

    Args:
        grasp_type (G,) int64, collides (G,) bool: a sensed point lies inside the open hand.
    """
    scores = {name: rank(votes, condensed, grasp_type, config) for name, rank in RANKINGS.items()}
    return {**scores, FREE: scores["log_odds"] + COLLIDING * collides}


def vote_counts(votes: Votes, grasps: int) -> Tensor:
    """(G,) int64 number of votes of each grasp."""
    return torch.bincount(votes.grasp, minlength=grasps)


def _shrunken_mean(values: Tensor, votes: Votes, grasps: int, config: AffordanceConfig) -> Tensor:
    """(G,) f32 mean of the votes' values together with `vote_shrinkage` votes of 0; UNSUPPORTED without votes."""
    count = vote_counts(votes, grasps)
    mean = _sum_per_grasp(values, votes, grasps) / (count + config.vote_shrinkage).clamp(min=1)
    return mean.masked_fill(count == 0, UNSUPPORTED)


def _sum_per_grasp(values: Tensor, votes: Votes, grasps: int) -> Tensor:
    return torch.zeros(grasps, dtype=values.dtype, device=values.device).index_add_(0, votes.grasp, values)
