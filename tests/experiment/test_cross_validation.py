"""Nested cross-validation: what teaches what, and how the ranking is chosen."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.pairs import CellPairs
from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.cross_validation import calibrate, calibrated_elsewhere, choose
from spgf_torch.experiment.described_object import DescribedObject, sample_of_each_type
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.experiment import Experiment
from spgf_torch.experiment.learning import side_by_side
from spgf_torch.progress import ProgressReporter

FOLD = np.array([0, 1, 2, 0, 1, 2])


def test_a_design_keeps_novel_objects_apart() -> None:
    design = Design(FOLD, np.array([5, 4, 3, 2, 1, 0]), limit=3)
    assert design.tests == [0, 1, 2] and design.novel(1) == [1, 4]
    assert design.training(1) == [2, 3, 5] and design.training(None) == [3, 4, 5]
    assert design.groups(1) == [[3], [2, 5]]


def test_objects_of_other_parts_do_not_teach() -> None:
    """Parts of objects 0, 1, 4 and 2, 3, 5; the fold of an object is one of its part's."""
    design = Design(np.array([0, 1, 2, 3, 1, 2]), np.array([5, 4, 3, 2, 1, 0]), 100, np.array([0, 0, 1, 1, 0, 1]))
    assert design.tests == [0, 1, 2, 3] and design.novel(1) == [1, 4]
    assert design.training(0) == [1, 4] and design.training(1) == [0] and design.training(3) == [2, 5]
    assert design.groups(3) == [[2], [5]] and design.training(None) == [0, 1, 2, 3, 4, 5]


def test_a_single_training_fold_is_halved() -> None:
    design = Design(np.array([0, 0, 0, 1]), np.arange(4), limit=100)
    assert design.groups(1) == [[0, 2], [1]]


def example(grasps: int) -> DescribedObject:
    none, grasp_type = torch.zeros(0, dtype=torch.int32), torch.arange(grasps) % 2
    pairs, success = CellPairs(none, none, none, grasp_type), torch.arange(grasps) % 3 == 0
    return DescribedObject(torch.zeros(1, 144), pairs, torch.zeros(grasps).bool(), ("NPG", "WPG"), success)


def test_samples_of_grasps() -> None:
    generator = torch.Generator().manual_seed(0)
    obj = example(40)
    both = obj.sample_of_each_type(5, generator)
    assert torch.bincount(obj.grasp_type[both]).tolist() == [5, 5] and both.tolist() == sorted(set(both.tolist()))
    assert len(obj.sample(7, generator)) == 7 and obj.sample(100, generator).tolist() == list(range(40))
    assert obj.of_grasps(torch.arange(40)) is obj  # nothing is copied
    some = obj.of_grasps(torch.tensor([3, 8]))
    assert some.outcomes.tolist() == [True, False] and some.grasp_type.tolist() == [1, 0]


def test_a_sample_of_each_of_three_types() -> None:
    """Of one, five and three at most three each; the codes need not begin at 0."""
    grasp_type = torch.tensor([2, 1, 2, 2, 3, 2, 3, 2, 3])
    found = sample_of_each_type(grasp_type, 3, torch.Generator().manual_seed(0))
    assert torch.bincount(grasp_type[found]).tolist() == [0, 1, 3, 3] and found.tolist() == sorted(set(found.tolist()))
    assert len(sample_of_each_type(grasp_type[:0], 3, torch.Generator())) == 0


def test_what_nobody_tried_teaches_nothing() -> None:
    asked = replace(example(4), success=None)
    assert len(asked.of_grasps(torch.tensor([1, 2]))) == 2 and asked.of_grasps(torch.tensor([1, 2])).success is None
    with pytest.raises(ValueError, match="outcomes of trials"):
        _ = asked.outcomes
    assert asked.with_success(torch.tensor([True, False, False, True])).outcomes.sum() == 2


def scores_of(log_odds: Tensor, paper: Tensor | None = None) -> GraspScores:
    """NPG without sensed collisions, one vote each."""
    paper, zero = log_odds if paper is None else paper, torch.zeros(len(log_odds), dtype=torch.long)
    by_ranking = {"paper": paper, "log_odds": log_odds, "log_odds_free": log_odds}
    return GraspScores(zero + 1, paper, paper, by_ranking, zero, zero.bool(), 2)


@pytest.mark.parametrize(("winner", "paper", "log_odds"), [("paper", 1.0, 0.0), ("log_odds", 0.0, 1.0)])
def test_the_ranking_that_finds_successes_is_chosen(winner: str, paper: float, log_odds: float) -> None:
    """Grasps 0 to 3 succeed; one score knows that, the other says the opposite. Ties go to the first of the names."""
    success = torch.tensor([True] * 4 + [False] * 4)
    knows, opposite = success.float(), (~success).float()
    scores = scores_of(knows if log_odds else opposite, knows if paper else opposite)
    assert choose([scores.calibrated(uncalibrated(torch.tensor([0.5, 0.5])))], [success], n=4) == winner


def test_an_object_without_votes_counts_as_none_of_its_grasps() -> None:
    """No ranking has a best grasp on the first object. On the second, `paper` finds one success, the others both."""
    none, two = torch.full((4,), -torch.inf), torch.tensor([True, False, True, False])
    paper, log_odds = torch.tensor([4.0, 3, 2, 1]), torch.tensor([4.0, 1, 3, 2])
    scores = [scores_of(none), scores_of(log_odds, paper)]
    known = [each.calibrated(uncalibrated(torch.tensor([0.5, 0.5]))) for each in scores]
    assert choose(known, [torch.ones(4).bool(), two], n=2) != "paper"


def test_an_object_is_calibrated_by_the_other_groups() -> None:
    """Scores of 0 tell nothing: groups 4 and 6 succeed always, group 9 never. Each gets what the others suggest.

    Of the nine others of group 9 all succeed; of the others of 4 and 6 six and nine in twelve and fifteen.
    """
    success = [torch.ones(6).bool(), torch.zeros(6).bool(), torch.ones(3).bool()]
    scores, groups = [scores_of(torch.zeros(len(its))) for its in success], [4, 9, 6]
    elsewhere = [float(each.probability[0]) for each in calibrated_elsewhere(scores, success, groups)]
    assert elsewhere == pytest.approx([3 / 9, 1, 6 / 12], abs=0.01)
    everywhere = scores[0].calibrated(calibrate(scores, success, groups))
    assert float(everywhere.probability[0]) == pytest.approx(9 / 15, abs=0.01)


def test_inner_folds_hold_out_what_they_do_not_teach() -> None:
    """Folds {0, 3}, {1, 4}, {2, 5}: what the last two teach is asked about the first for the sake of 1 and of 2."""
    assert Design(FOLD, np.arange(6), limit=6).inner_folds() == {
        (2, 5): [(0, 1), (0, 4), (1, 0), (1, 3)],
        (1, 4): [(0, 2), (0, 5), (2, 0), (2, 3)],
        (0, 3): [(1, 2), (1, 5), (2, 1), (2, 4)],
    }
    few = Design(FOLD, np.array([5, 4, 3, 2, 1, 0]), limit=3).inner_folds()
    assert few == {
        (2, 5): [(0, 4), (1, 3)],
        (4,): [(0, 2), (0, 5)],  # the fold 1 may use 3, and not 4
        (3,): [(1, 2), (1, 5), (2, 1), (2, 4)],
        (1, 4): [(2, 3)],
    }


class Listening:
    """In the place of the shape-grasp space: what taught, of which prototypes, and who asked."""

    heard: ClassVar[list[tuple[list[int], list[int], list[int]]]] = []

    def __init__(self, objects: Sequence[DescribedObject], centres: Tensor, config: AffordanceConfig) -> None:
        self.taught = [int(obj.relations[0, 0]) for obj in objects], centres[:, 0].int().tolist()

    def score_grasps(self, objects: Sequence[DescribedObject]) -> list[GraspScores]:
        self.heard.append((*self.taught, [int(obj.relations[0, 0]) for obj in objects]))
        return [scores_of(obj.outcomes.float()) for obj in objects]


def test_nobody_is_asked_about_what_taught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither prototypes nor particles are of an object that is asked about, nor of the fold that is predicted on."""
    monkeypatch.setattr("spgf_torch.experiment.experiment.TrainingSpace", Listening)
    monkeypatch.setattr(Listening, "heard", [])
    objects = [replace(example(40), relations=torch.full((1, 144), float(i))) for i in range(6)]
    config = TrainConfig(N=10, inner_grasps=20, final_model=False, fold_models=False, affordance=None)
    fit: Any = lambda relations: relations  # noqa: E731
    design = Design(FOLD, np.arange(6), limit=6)
    sampled = [obj.of_grasps(torch.arange(20)) for obj in objects]
    learned = Experiment(config, design, [], objects, objects, sampled, fit).run(ProgressReporter())
    assert len(learned.scores) == 6 and len(Listening.heard) == 6
    for taught, prototypes, asked in Listening.heard:
        assert taught == prototypes and not {*taught} & {*asked}
        assert len(taught) == (2 if len(asked) == 4 else 4)
    assert all(each.chosen == "paper" for each in learned.scores)  # the first of equals


def test_given_prototypes_are_those_of_the_fold_inside_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fold t is given prototypes 10 + t: those serve its two inner folds, too, and nothing is learned."""
    monkeypatch.setattr("spgf_torch.experiment.experiment.TrainingSpace", Listening)
    monkeypatch.setattr(Listening, "heard", [])
    objects = [replace(example(40), relations=torch.full((1, 144), float(i))) for i in range(6)]
    config = TrainConfig(N=10, inner_grasps=20, final_model=False, fold_models=False, affordance=None)
    fit: Any = None

    def given(test: int | None) -> Tensor:
        assert test is not None
        return torch.full((1, 144), 10.0 + test)

    design = Design(FOLD, np.arange(6), limit=6)
    sampled = [obj.of_grasps(torch.arange(20)) for obj in objects]
    made = Experiment(config, design, [], objects, objects, sampled, fit, given)
    assert not made.shares and replace(made, given=None).shares
    learned = made.run(ProgressReporter())
    heard = sorted((prototypes, taught, asked) for taught, prototypes, asked in Listening.heard)
    assert heard == [
        ([10], [1, 2, 4, 5], [0, 3]), ([10], [1, 4], [2, 5]), ([10], [2, 5], [1, 4]),
        ([11], [0, 2, 3, 5], [1, 4]), ([11], [0, 3], [2, 5]), ([11], [2, 5], [0, 3]),
        ([12], [0, 1, 3, 4], [2, 5]), ([12], [0, 3], [1, 4]), ([12], [1, 4], [0, 3]),
    ]  # fmt: skip
    assert len(learned.scores) == 6 and learned.model is None and not learned.of_fold


def test_side_by_side_keeps_the_order_and_passes_errors_on() -> None:
    told: list[int] = []
    assert side_by_side(lambda x: x * x, range(5), told.append) == [0, 1, 4, 9, 16] and told == [1] * 5
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda x: 1 // x, [1, 0], told.append)
