"""The experiment's ranking `judge`: recorded candidates, ranked by judges that have not seen their object.

It stands beside the paper's votes (`affordance.ranking`) and is cross-validated over the same folds, from the same
recorded trials of the training objects, in the experiment's own clouds. It knows more than votes do: which space no
camera has seen, how near sensed points come to the open hand, and of each training trial whether the open hand
collided or the grasp failed later: P(free) x P(holds | free) from the numbers of `proposing.judge_features`. Prototypes
and features have no part in it: it is the same for every K. Random trials alone teach it; a hand's judge
(`python -m spgf_torch.judge`) learns from trials of its own choosing besides.

Candidates at which a sensed point lies inside the open hand are not judged. They come after all others, as a robot
would have it, and as in the ranking `log_odds_free`. Candidates lie across a wall of the mesh, which tells of what no
camera sees: rates among them are no rates of hypotheses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.experiment import teaching
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.judging.clouds import seen_as
from spgf_torch.judging.config import JudgeConfig, TreesConfig
from spgf_torch.judging.learning import judge_of, learn_judge
from spgf_torch.judging.training_rows import SAMPLED, Rows
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.config import HypothesesConfig, ProposingConfig
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.judge_features import judge_features
from spgf_torch.settings import plain, settings
from spgf_torch.simulation.table import TrialTable
from spgf_torch.threads import in_parts

# Score of a candidate that is not judged: below every probability, all alike.
EXCLUDED = -1.0
KIND = "numbers"  # of entries of the cache


@dataclass(frozen=True)
class SeenCandidates:
    """One object's candidates as a judge sees them.

    Attributes:
        index: of the object among all. table: all its G candidates.
        free: (F,) int64, those at which no sensed point lies inside the open hand, ascending.
        numbers: (F, 31) f32, `judge_features.NAMES` of these.
    """

    index: int
    table: TrialTable
    free: Tensor
    numbers: Tensor

    def rows(self, teach: Tensor) -> Rows:
        """A row for each of the free candidates among `teach` (C,) int64."""
        taught = torch.isin(self.free, teach.cpu())
        obj, cloud, round_, rank = (torch.full((int(taught.sum()),), value) for value in (self.index, 0, 0, SAMPLED))
        nowhere = torch.full(obj.shape, torch.nan)
        outcome = self.table.outcome[self.free[taught]]
        return Rows(self.numbers[taught], outcome, obj, cloud, round_, rank, nowhere.isfinite(), nowhere)

    def scores(self, judge: Judge) -> Tensor:
        """(G,) f32: the probability that each holds; `EXCLUDED` where it is not free."""
        scores = torch.full((len(self.table),), EXCLUDED)
        scores[self.free] = judge.probability(self.numbers, images=True)
        return scores


@dataclass(frozen=True)
class CandidateRanking:
    """Ranks candidates by judges.

    Attributes:
        experiment: its sensing, seed and how many trials teach. config: how a judge learns. search: the hand.
    """

    experiment: TrainConfig
    config: JudgeConfig
    search: Search
    cache: Cache

    @staticmethod
    def of(experiment: TrainConfig, cache: Cache) -> CandidateRanking:
        """With the experiment's hand and sensing; how a judge learns is as in conf/hypotheses and conf/learning."""
        proposing, hypotheses = settings(ProposingConfig), settings(HypothesesConfig)
        config = JudgeConfig(
            hand=experiment.hand,
            sensing=experiment.sensing,
            seed=experiment.seed,
            form="trees",
            sure=0.0,
            hypotheses=hypotheses,
            learning=settings(TreesConfig),
        )
        clearances = (proposing.plane_clearance, proposing.between, proposing.obstacle_clearance)
        search = Search.of(Clearance(open_hand(experiment.hand), *clearances), hypotheses)
        return CandidateRanking(experiment, config, search, cache)

    def scores(
        self,
        design: Design,
        objects: Sequence[GraspObject],
        tables: Sequence[TrialTable],
        examples: Sequence[DescribedObject],
        stages: ProgressReporter,
    ) -> list[Tensor]:
        """(G,) f32 for each object: `SeenCandidates.scores` of a judge that learned from the training folds alone."""
        given = list(zip(range(len(objects)), objects, tables, examples, strict=True))
        with stages.stage("rows", len(objects), "objects") as advance:
            seen = [(advance(1), done)[1] for done in in_parts(lambda each: self.seen(*each), given)]
        teach = teaching(examples, self.experiment)
        found: dict[int, Tensor] = {}
        with stages.stage("judges", len(design.tests), "folds") as advance:
            for test in design.tests:
                rows = Rows.together([seen[i].rows(teach[i]) for i in design.training(test)])
                judge = judge_of(learn_judge(rows, self.config, ["images"]), [], self.config)
                found |= {i: seen[i].scores(judge) for i in design.novel(test)}
                advance(1)
        return [found[i] for i in range(len(objects))]

    def seen(self, index: int, obj: GraspObject, table: TrialTable, example: DescribedObject) -> SeenCandidates:
        """An object's candidates in the experiment's own cloud of it; their numbers are kept in the cache."""
        free = (~example.collides.cpu()).nonzero()[:, 0]
        poses = Hypotheses(table.T_object_tcp.float(), table.grasp_type).at(free)
        sensing, seed = self.experiment.sensing, self.experiment.seed

        def make() -> dict[str, Tensor]:
            cloud = seen_as(obj, sensing, False, seed)
            return {KIND: judge_features(cloud.seen, poses, self.search)}

        surface = (obj.name, obj.mesh.vertices, obj.mesh.faces)
        key = fingerprint(
            code_fingerprint(__name__),
            surface,
            plain(sensing),
            seed,
            poses,
            self.search.clearance.volumes,
            self.search.config,
        )
        return SeenCandidates(index, table, free, self.cache.tensors(KIND, key, make)[KIND])
