"""From texlets and a model to ranked grasps; no mesh is needed.

1. Features from farthest-point sampling, with the seed grasps of their prototypes, give hypotheses.
2. A few voters score all hypotheses; the best of each type that are free of points, but have some to close on, are
   merged by non-maximum suppression in SE(3).
3. All voters score the remaining ones, by the votes that rank candidates elsewhere (`affordance.ranking`).
4. The best are refined: moved to better poses nearby while the score grows and the hand stays free.
5. Non-maximum suppression keeps one of each grasp.

Every step looks at relative poses only, so grasps move with their input; which cell of the SE(3) grid a relative pose
falls into is the one thing that rounding can change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, vote
from spgf_torch.affordance.pairs import cell_pairs
from spgf_torch.affordance.ranking import GraspScores, point_gains, score_grasps, shrunk_mean
from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.affordance.voting import Votes, VotingIndex, vote_totals
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import descriptor
from spgf_torch.features.interface import LocalFeatures
from spgf_torch.geometry import se3
from spgf_torch.hands import records
from spgf_torch.proposing.bodies import bodies_of, body_at
from spgf_torch.proposing.borders import clear_of_borders
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.grasp_seeds import GraspSeeds, grasp_seeds
from spgf_torch.proposing.proposals import Proposals, between_types, votes_by_prototype
from spgf_torch.proposing.sampling import farthest_point_sampling, first_of_each, non_maximum_suppression
from spgf_torch.proposing.voters import Voters, voters_of_each
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import typed

# No table, no obstacles.
NOTHING = Surroundings()


@dataclass(frozen=True)
class Pool:
    """Poses under consideration: T (G, 4, 4), grasp_type (G,) int64, score (G,) f32."""

    T: Tensor
    grasp_type: Tensor
    score: Tensor

    def at(self, chosen: Tensor) -> Pool:
        """Select those at the indices `chosen` (C,) int64, in this order."""
        return Pool(self.T[chosen], self.grasp_type[chosen], self.score[chosen])

    def best_of_each_type(self, n: int) -> Tensor:
        """Indices (<= n of each type,) int64 of the n highest scores of each type, best first within a type."""
        order = torch.argsort(self.score, descending=True, stable=True)
        types = self.grasp_type[order]
        return torch.cat([order[:0], *(order[types == code][:n] for code in types.unique())])


@dataclass(frozen=True)
class Proposer:
    """A model made ready to propose grasps: what depends on the model alone is computed once."""

    model: GraspModel
    affordance: AffordanceConfig
    features: FeatureConfig
    config: ProposingConfig
    clearance: Clearance

    @staticmethod
    def of(model: GraspModel, config: ProposingConfig, volumes: Mapping[str, HandVolume]) -> Proposer:
        """With the settings that the model was learned with; volumes: grasp type -> the open hand."""
        affordance = typed(AffordanceConfig, model.settings["affordance"])
        features = typed(FeatureConfig, model.settings["features"])
        if config.neighbours is not None:
            affordance = replace(affordance, features_per_object=config.neighbours.voters)
        return Proposer(model, affordance, features, config, Clearance.of(volumes, config))

    @cached_property
    def index(self) -> VotingIndex:
        return VotingIndex(self.model.condensed, self.model.grid)

    @cached_property
    def grasp_seeds(self) -> GraspSeeds:
        volumes = self.clearance.volumes
        symmetry = [volumes[grasp_type].symmetry for grasp_type in self.clearance.grasp_types]
        return grasp_seeds(self.model, self.gains, self.config, symmetry)

    @cached_property
    def gains(self) -> Tensor:
        """(P,) f32: the gain in log-odds of a vote that finds a point of the model."""
        return point_gains(self.model.condensed, self.affordance)

    @cached_property
    def moves(self) -> Tensor:
        """(rounds, moves, 4, 4) f32: small random displacements, the same for every grasp and every object."""
        config, generator = self.config, torch.Generator().manual_seed(0)
        shape = (config.rounds, config.moves, 3)
        step = 1 / torch.arange(1.0, config.rounds + 1).view(-1, 1, 1)
        shift = config.move * step * torch.randn(shape, generator=generator)
        rotation = math.radians(config.move_deg) * step * torch.randn(shape, generator=generator)
        quaternion = torch.cat([torch.ones(*shape[:2], 1), rotation / 2], dim=-1)  # a small rotation vector's
        return se3.pose(shift, quaternion).to(self.model.centres.device)

    def propose(self, texlets: Texlets, around: Surroundings = NOTHING) -> Proposals:
        """Propose grasps for texlets, the best first; none where no feature votes for any.

        No hand touches an obstacle or reaches below a table; none comes from below, if others can.
        """
        bodies = None if self.config.neighbours is None else bodies_of(texlets, self.config.neighbours)
        points = texlets.positions.to(self.model.centres.device)
        return self.propose_from(self.described(texlets), points, around, bodies)

    def described(self, texlets: Texlets) -> LocalFeatures:
        """Describe the texlets, on the model's device."""
        device = self.model.centres.device
        positions, normals = texlets.positions.to(device), texlets.normals.to(device)
        return descriptor(self.features)(positions, normals, self.features, torch.Generator().manual_seed(0))

    def propose_from(
        self, features: LocalFeatures, points: Tensor, around: Surroundings = NOTHING, bodies: Tensor | None = None
    ) -> Proposals:
        """Propose from features of the points (N, 3) that the hand must not touch, of bodies (N,) with a quota each."""
        voters, around = self.voters(features), around.near(points, self.clearance.reach)
        for given in around.relaxed():
            pool = self.prune(voters, points, given)
            if len(pool.score):
                break
        for moves in self.moves:
            pool = self.refine(pool, moves, voters, points, given)
        pool = self.distinct(pool, self.config.apart, self.config.apart_deg)
        if bodies is not None and self.config.neighbours is not None:
            near = body_at(pool.T[:, :3, 3], points, bodies)
            pool = pool.at(first_of_each(near, self.config.neighbours.quota).nonzero()[:, 0])
        return self.proposals(pool, voters)

    def voters(self, features: LocalFeatures) -> Voters:
        """Select the features that vote."""
        valid = features.valid.nonzero()[:, 0]
        T, relations = features.T_object_feature[valid], features.relations()[valid]
        order = farthest_point_sampling(T, self.affordance.features_per_object, self.config.normal_weight)
        return Voters(T[order], assign(relations[order], self.model.centres), valid[order])

    def prune(self, voters: Voters, points: Tensor, around: Surroundings) -> Pool:
        """Reduce hypotheses to the best of each type, free and far from each other, scored by all voters."""
        config, proposing = self.config, voters.first(self.config.proposing_features)
        T, grasp_type = self.grasp_seeds.hypotheses(proposing.T_object_feature, proposing.prototype)
        possible = self.above(T, grasp_type, around).nonzero()[:, 0]
        at = T[possible], grasp_type[possible]
        if around.borders is not None:
            possible = possible[clear_of_borders(around.borders, *at, self.clearance.regions)]
        sparse = around.sparse(config.coarse_cell)
        possible = possible[self.clearance.free_of_points(sparse, T[possible], grasp_type[possible])]
        few = voters.first(config.coarse_points).T_object_feature[:, :3, 3]
        if config.neighbours is not None:  # of which the best would else nearly all collide
            possible = possible[self.clearance.closes_on_points(points, T[possible], grasp_type[possible])]
            possible = possible[self.clearance.free_of_points(few, T[possible], grasp_type[possible])]
            possible = possible[self.seen_free(T[possible], grasp_type[possible], around)]
        T, grasp_type = T[possible], grasp_type[possible]
        pool = Pool(T, grasp_type, self.score(T, grasp_type, voters, config.coarse_voters))
        pool = pool.at(pool.best_of_each_type(config.hypotheses))
        pool = pool.at(self.clearance.free_of_points(few, pool.T, pool.grasp_type).nonzero()[:, 0])
        pool = pool.at(self.clearance.closes_on_points(points, pool.T, pool.grasp_type).nonzero()[:, 0])
        pool = pool.at(self.clearance.free_of_obstacles(around.obstacles, pool.T, pool.grasp_type).nonzero()[:, 0])
        pool = self.distinct(pool, config.merge_distance, config.merge_deg)
        pool = pool.at(pool.best_of_each_type(config.survivors))
        pool = pool.at(self.clearance.free_of_points(points, pool.T, pool.grasp_type).nonzero()[:, 0])
        return replace(pool, score=self.score(pool.T, pool.grasp_type, voters, len(voters)))

    def distinct(self, pool: Pool, distance: float, angle_deg: float) -> Pool:
        """Those that no better one of their type is the same grasp as."""
        symmetry = self.clearance.symmetry(pool.grasp_type)
        its = pool.T, pool.grasp_type, pool.score
        return pool.at(non_maximum_suppression(*its, distance, angle_deg, symmetry))

    def above(self, T: Tensor, grasp_type: Tensor, around: Surroundings) -> Tensor:
        """(G,) bool: the hand stays above the table on its whole way, and does not come from below."""
        above = ~around.from_below(T)
        if around.table is not None:
            above &= self.clearance.free_of_plane(around.table, T, grasp_type, around.retreat)
        return above

    def seen_free(self, T: Tensor, grasp_type: Tensor, around: Surroundings) -> Tensor:
        """(G,) bool: the hand reaches into no place that nobody saw free, and is not where grasps failed."""
        free = ~around.failed_at(T[:, :3, 3])
        free[free.clone()] = self.clearance.free_of_hidden(around.hidden, T[free], grasp_type[free])
        return free

    def refine(self, pool: Pool, moves: Tensor, voters: Voters, points: Tensor, around: Surroundings) -> Pool:
        """Move the best of each type by the best of the moves (M, 4, 4) that scores higher and leaves them free."""
        best = pool.best_of_each_type(self.config.refined)
        T = (pool.T[best].unsqueeze(1) @ moves.to(pool.T.dtype)).flatten(0, 1)
        grasp_type = pool.grasp_type[best].repeat_interleave(len(moves))
        score = self.score(T, grasp_type, voters, len(voters))
        better = (score > pool.score[best].repeat_interleave(len(moves))).nonzero()[:, 0]
        free = self.clearance.free_of_points(points, T[better], grasp_type[better])
        free &= self.clearance.closes_on_points(points, T[better], grasp_type[better])
        free &= self.clearance.free_of_obstacles(around.obstacles, T[better], grasp_type[better])
        free &= self.above(T[better], grasp_type[better], around)
        free &= self.seen_free(T[better], grasp_type[better], around)
        if around.borders is not None:
            free &= clear_of_borders(around.borders, T[better], grasp_type[better], self.clearance.regions)
        gained = torch.full_like(score, -math.inf)
        gained[better[free]] = score[better[free]]
        top = gained.view(len(best), len(moves)).max(dim=1)
        moved = top.values > pool.score[best]
        new_T, new_score = pool.T.clone(), pool.score.clone()
        from_move = torch.arange(len(best), device=best.device) * len(moves) + top.indices
        new_T[best[moved]], new_score[best[moved]] = T[from_move[moved]], top.values[moved]
        return Pool(new_T, pool.grasp_type, new_score)

    def proposals(self, pool: Pool, voters: Voters) -> Proposals:
        """Keep the best `count` of each type, with the votes of all voters."""
        config = self.config
        pool = pool.at(pool.best_of_each_type(config.count))
        pool = pool.at(torch.argsort(pool.score, descending=True, stable=True))
        votes = self.votes(pool.T, pool.grasp_type, voters)
        scores = self.scores(votes, pool.grasp_type, self.affordance)  # what calibration was learned for
        probability = scores.calibrated(self.model.calibration).probability
        supported = (scores.votes > 0).nonzero()[:, 0]
        score = between_types(pool.score[supported], probability[supported], pool.grasp_type[supported], config)
        order = torch.argsort(score, descending=True, stable=True)
        supported, score = supported[order], score[order]
        voted_by = votes_by_prototype(votes, len(pool.score))
        return Proposals(
            pool.T[supported].float(),
            pool.grasp_type[supported],
            self.clearance.grasp_types,
            probability[supported],
            score,
            scores.votes[supported],
            tuple(voted_by[i] for i in supported.tolist()),
            voters=voters,
        )

    def score(self, T: Tensor, grasp_type: Tensor, voters: Voters, n: int) -> Tensor:
        """(G,) f32 score of poses (G, 4, 4) by the first n voters; with few, fewer votes draw it towards 0."""
        first = voters.first(n)
        shrinkage = self.config.vote_shrinkage * len(first) / max(1, len(voters))
        affordance = replace(self.affordance, vote_shrinkage=shrinkage)
        found = vote_totals(self.index, self.gains, first.T_object_feature, first.prototype, T, grasp_type)
        return shrunk_mean(found.log_odds_gain, found.votes, affordance)

    def votes(self, T: Tensor, grasp_type: Tensor, voters: Voters) -> Votes:
        """What the voters say of poses (G, 4, 4)."""
        pairs = cell_pairs(voters.T_object_feature, T, grasp_type, self.affordance)
        return vote(self.index, pairs, voters.prototype)

    def who_voted(self, proposals: Proposals, chosen: list[int]) -> Sequence[records.Voters | None]:
        """The votes on each of the chosen proposals, one by one; None of proposals that nobody voted on."""
        if proposals.voters is None:
            return [None] * len(chosen)
        at = proposals.T_object_tcp[chosen], proposals.grasp_type[chosen]
        return voters_of_each(self.index, self.gains, proposals.voters, *at)

    def scores(self, votes: Votes, grasp_type: Tensor, affordance: AffordanceConfig) -> GraspScores:
        """The votes on free grasps of types (G,), combined."""
        free = torch.zeros_like(grasp_type, dtype=torch.bool)
        return score_grasps(votes, self.model.condensed.base_rate, grasp_type, free, affordance)
