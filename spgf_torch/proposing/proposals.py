"""Proposed grasps of all types in one ranking, and what orders types among each other."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.voting import Votes
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.judge_influences import Numbers
from spgf_torch.proposing.voters import Voters

# Probabilities nearer 0 or 1 than this are not distinguished by the order of proposals.
_EDGE = 1e-6


@dataclass(frozen=True)
class Proposals:
    """Grasps in the frame of the texlets, the best first, all types in one ranking.

    Attributes:
        T_object_tcp: (G, 4, 4) f32, m.
        grasp_type: (G,) int64, index into `grasp_types`, the sorted names.
        probability: (G,) f32, calibrated, that the grasp succeeds.
        score: (G,) f32, what orders them (`between_types`); the probability where a judge ranked.
        support: (G,) int64, votes.
        voted_by: of each grasp (prototype, votes), most votes first.
        judged: (G, 2) f64, of a judge P(free) and P(holds | free); None where the votes ranked.
        numbers: what the judge knew of each; () where the votes ranked.
        voters: the features that were asked for their votes; None of a judge alone.
    """

    T_object_tcp: Tensor
    grasp_type: Tensor
    grasp_types: tuple[str, ...]
    probability: Tensor
    score: Tensor
    support: Tensor
    voted_by: tuple[tuple[tuple[int, int], ...], ...]
    judged: Tensor | None = None
    numbers: tuple[Numbers, ...] = ()
    voters: Voters | None = None

    def __len__(self) -> int:
        return len(self.grasp_type)

    def best(self, n: int) -> dict[str, Tensor]:
        """The n best of each grasp type and of all together (CG): indices (<= n,) int64, best first."""
        of_type = {name: (self.grasp_type == code).nonzero()[:n, 0] for code, name in enumerate(self.grasp_types)}
        return {**of_type, "CG": torch.arange(min(n, len(self)), device=self.grasp_type.device)}


def between_types(score: Tensor, probability: Tensor, grasp_type: Tensor, config: ProposingConfig) -> Tensor:
    """(G,) f32 by which grasps of all types are ordered: of each type as the scores (G,) order it.

    The score says how much better than usual of its type a grasp is: a pinch of 40 % where 2 % are usual is above a
    power grasp of 95 % where 97 % are. The calibrated probability (G,) compares types, but a grasp of which the votes
    say nothing has that of free candidates, which are drawn on the mesh and hold more often. So the log-odds of each
    type's probabilities, sorted to fall with its scores, count beside these by `config.probability_weight`.
    """
    log_odds = torch.empty_like(score)
    for code in grasp_type.unique():
        its = (grasp_type == code).nonzero()[:, 0]
        its = its[torch.argsort(score[its], descending=True, stable=True)]
        log_odds[its] = torch.logit(probability[its], eps=_EDGE).sort(descending=True).values
    weight = config.probability_weight
    return (1 - weight) * score + weight * log_odds


def votes_by_prototype(votes: Votes, grasps: int) -> list[tuple[tuple[int, int], ...]]:
    """Of each of so many grasps (prototype, votes), most votes first."""
    counted: list[Counter[int]] = [Counter() for _ in range(grasps)]
    for grasp, prototype in zip(votes.grasp.tolist(), votes.prototype.tolist(), strict=True):
        counted[grasp][prototype] += 1
    return [tuple(sorted(c.items(), key=lambda item: (-item[1], item[0]))) for c in counted]
