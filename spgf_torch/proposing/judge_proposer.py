"""From what is seen to ranked grasps by a judge: hypotheses from geometry, each weighed, the best of each place kept.

The votes of local shapes (`propose`) take no part in the ranking; they are reported beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.proposing.borders import clear_of_borders
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.config import HypothesesConfig, ProposingConfig
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.judge_features import Seen, in_images, judge_features
from spgf_torch.proposing.judge_influences import Numbers
from spgf_torch.proposing.one_thing import one_thing
from spgf_torch.proposing.proposals import Proposals, votes_by_prototype
from spgf_torch.proposing.propose import NOTHING, Pool, Proposer
from spgf_torch.proposing.sampling import first_of_each, non_maximum_suppression


@dataclass(frozen=True)
class Ranked:
    """Grasps in order, the best first: poses (G), probability (G,) f32 that they hold when executed.

    Attributes:
        score (G,) f32: what orders them: the probability, among neighbours less in unseen space (`seen_weight`).
        factors (G, 2) f64: of a judge P(free) and P(holds | free), whose product that is; None of another ranking.
        numbers: what it knew of each; () of another ranking.
    """

    poses: Hypotheses
    probability: Tensor
    score: Tensor
    factors: Tensor | None = None
    numbers: tuple[Numbers, ...] = ()


@dataclass(frozen=True)
class JudgedProposer:
    """A judge made ready to propose grasps.

    Attributes:
        proposer: whose votes are reported with a grasp; None: none are.
    """

    judge: Judge
    search: Search
    config: ProposingConfig
    proposer: Proposer | None

    @staticmethod
    def of(judge: Judge, proposer: Proposer) -> JudgedProposer:
        """With the clearances of the proposer; InputError where the judge is of another hand than its model."""
        judge.check_hand(proposer.model.settings.get("hand"), "the model's hand")
        search = Search.of(proposer.clearance, searched(judge.hypotheses, proposer.config))
        return JudgedProposer(judge, search, proposer.config, proposer)

    @staticmethod
    def alone(judge: Judge, volumes: Mapping[str, HandVolume], config: ProposingConfig) -> JudgedProposer:
        """Without a model, so without votes; `volumes`: grasp type -> the open hand."""
        search = Search.of(Clearance.of(volumes, config), searched(judge.hypotheses, config))
        return JudgedProposer(judge, search, config, None)

    def propose(self, seen: Seen, around: Surroundings = NOTHING) -> Proposals:
        """Grasps for what is seen, the most probable first, with the votes of local shapes on each."""
        found = ranked(self.judge, self.search, self.config, seen, around)
        names = self.search.clearance.grasp_types
        if (proposer := self.proposer) is None:
            none = torch.zeros(len(found.poses), dtype=torch.int64)
            its = found.poses.T, found.poses.grasp_type, names, found.probability, found.score
            no_votes = ((),) * len(none)
            return Proposals(*its, none, no_votes, found.factors, found.numbers)
        device = proposer.model.centres.device
        T, grasp_type = found.poses.T.to(device), found.poses.grasp_type.to(device)
        voters = proposer.voters(proposer.described(seen.texlets))
        votes = proposer.votes(T, grasp_type, voters)
        probability, score = found.probability.to(device), found.score.to(device)
        support = torch.bincount(votes.grasp, minlength=len(T))
        voted_by = tuple(votes_by_prototype(votes, len(T)))
        its = T, grasp_type, names, probability, score
        return Proposals(*its, support, voted_by, found.factors, found.numbers, voters)


def searched(hypotheses: HypothesesConfig, config: ProposingConfig) -> HypothesesConfig:
    """How a judge looks for hypotheses; among neighbours about more places, and more of them, than about one thing."""
    if config.neighbours is None:
        return hypotheses
    return replace(hypotheses, seeds=config.neighbours.seeds, hypotheses=config.neighbours.judged)


def ranked(judge: Judge, search: Search, config: ProposingConfig, seen: Seen, around: Surroundings) -> Ranked:
    """The most probable grasps, no two of which are the same, at most `config.count` of each type."""
    hypotheses = candidates(search, config, seen, around)
    numbers = judge_features(seen, hypotheses, search)
    scene = config.neighbours is not None and judge.knows_scenes and bool(seen.views)
    both = judge.both_in_scene(numbers) if scene else judge.both(numbers, images=bool(seen.views))
    factors = torch.stack(both, dim=1)
    probability = factors.prod(1).float()
    score = probability * seen_weight(hypotheses, search, config, around)
    kept = best_indices(seen, hypotheses, score, search, config)
    usual = numbers.median(0).values if len(numbers) else numbers
    known = tuple(Numbers(numbers[i], usual, bool(seen.views), scene) for i in kept.tolist())
    return Ranked(hypotheses.at(kept), probability[kept], score[kept], factors[kept], known)


def seen_weight(
    hypotheses: Hypotheses, search: Search, config: ProposingConfig, around: Surroundings
) -> Tensor | float:
    """(H,) f32: what of a probability counts in the order, less where the hand reaches into unseen space."""
    if config.neighbours is None:
        return 1.0
    clear = search.clearance.free_of_hidden(around.hidden, hypotheses.T, hypotheses.grasp_type)
    return torch.where(clear, 1.0, config.neighbours.unseen_weight)


def candidates(search: Search, config: ProposingConfig, seen: Seen, around: Surroundings) -> Hypotheses:
    """What a judge weighs: hypotheses within the images, clear of borders, among neighbours of one thing if any is."""
    if config.neighbours is not None and config.neighbours.unseen_weight > 0:
        around = replace(around, hidden=around.hidden[:0])
    hypotheses = search.hypotheses(seen.texlets, around)
    hypotheses = hypotheses.at(in_images(seen, hypotheses, search))
    clear = clear_of_borders(around.borders, hypotheses.T, hypotheses.grasp_type, search.clearance.regions)
    hypotheses = hypotheses.at(clear)
    if config.neighbours is not None and bool((one := one_thing(seen, hypotheses, search, config.neighbours)).any()):
        hypotheses = hypotheses.at(one)
    return hypotheses


def best_of(seen: Seen, hypotheses: Hypotheses, score: Tensor, search: Search, config: ProposingConfig) -> Ranked:
    """The highest scores (H,) f32, no two of the same grasp, at most `config.count` of each type."""
    kept = best_indices(seen, hypotheses, score, search, config)
    return Ranked(hypotheses.at(kept), score[kept], score[kept])


def best_indices(seen: Seen, hypotheses: Hypotheses, score: Tensor, search: Search, config: ProposingConfig) -> Tensor:
    """(G,) int64, those of `best_of`, the best first."""
    alike = torch.zeros_like(hypotheses.grasp_type)  # a wide and a narrow grasp of one place are one grasp
    limits = config.apart, config.apart_deg, search.clearance.symmetry(hypotheses.grasp_type)
    kept = non_maximum_suppression(hypotheses.T, alike, score, *limits)
    if config.neighbours is not None:
        kept = kept[first_of_each(seen.body_at(hypotheses.T[kept, :3, 3]), config.neighbours.quota)]
    pool = Pool(hypotheses.T[kept], hypotheses.grasp_type[kept], score[kept])
    kept = kept[of_each := pool.best_of_each_type(config.count)]
    return kept[torch.argsort(pool.score[of_each], descending=True, stable=True)]
