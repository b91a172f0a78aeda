"""Rankings of candidate grasps from the votes of an object's features.

`paper`: "the N highest ranked grasps (in a combined selection of support and probability ...)" (section 4):
the sum of the learned probabilities over a grasp's votes, each from a point of significant support; many
votes and sure votes both count.

`log_odds`: the mean, over the votes, of log-odds(P) - log-odds(base rate of the grasp's type). It asks how much
better than usual for its type a grasp is, so that a type that succeeds more often at random does not drown the other
(the gap of the paper's Table 1). Support shrinks twice: P is drawn towards the base rate by `shrinkage` particles,
and the mean towards no evidence by `vote_shrinkage` votes, else grasps at the rim of the reach, with a vote or two,
would come first.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.voting import Votes
from spgf_torch.config import AffordanceConfig

# No significant vote at all: below every grasp that has one.
UNSUPPORTED = float("-inf")


def paper_scores(votes: Votes, condensed: Condensed, grasp_type: Tensor, config: AffordanceConfig) -> Tensor:
    """(G,) f32 sums of P over the votes of each grasp; UNSUPPORTED without votes."""
    total = _sum_per_grasp(condensed.probability[votes.point], votes, len(grasp_type))
    return total.masked_fill(vote_counts(votes, len(grasp_type)) == 0, UNSUPPORTED)


def log_odds_scores(votes: Votes, condensed: Condensed, grasp_type: Tensor, config: AffordanceConfig) -> Tensor:
    """(G,) f32 shrunken mean log-odds of each grasp's votes against its type's base rate; UNSUPPORTED without."""
    base = condensed.base_rate.clamp(1e-4, 1 - 1e-4)[grasp_type[votes.grasp]]
    support = condensed.support[votes.point]
    shrunk = (condensed.probability[votes.point] * support + base * config.shrinkage) / (support + config.shrinkage)
    gain = torch.logit(shrunk, eps=1e-4) - torch.logit(base)
    count = vote_counts(votes, len(grasp_type))
    mean = _sum_per_grasp(gain, votes, len(grasp_type)) / (count + config.vote_shrinkage).clamp(min=1)
    return mean.masked_fill(count == 0, UNSUPPORTED)


RANKINGS: dict[str, Callable[[Votes, Condensed, Tensor, AffordanceConfig], Tensor]] = {
    "paper": paper_scores,
    "log_odds": log_odds_scores,
}


def mean_probability(votes: Votes, condensed: Condensed, grasps: int) -> Tensor:
    """(G,) f32 mean learned probability over the votes of each grasp; 0 without votes."""
    total = _sum_per_grasp(condensed.probability[votes.point], votes, grasps)
    return total / vote_counts(votes, grasps).clamp(min=1)


def vote_counts(votes: Votes, grasps: int) -> Tensor:
    """(G,) int64 number of votes of each grasp."""
    return torch.bincount(votes.grasp, minlength=grasps)


def _sum_per_grasp(values: Tensor, votes: Votes, grasps: int) -> Tensor:
    return torch.zeros(grasps, dtype=values.dtype, device=values.device).index_add_(0, votes.grasp, values)
