"""Nested cross-validation: what teaches what, and how the ranking is chosen."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.pairs import CellPairs
from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.experiment.cross_validation import choose
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.experiment import Design
from spgf_torch.experiment.learning import side_by_side

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
    return DescribedObject(torch.zeros(1, 144), pairs, torch.zeros(grasps).bool(), success)


def test_samples_of_grasps() -> None:
    generator = torch.Generator().manual_seed(0)
    obj = example(40)
    both = obj.sample_of_each_type(5, generator)
    assert torch.bincount(obj.grasp_type[both]).tolist() == [5, 5] and both.tolist() == sorted(set(both.tolist()))
    assert len(obj.sample(7, generator)) == 7 and obj.sample(100, generator).tolist() == list(range(40))
    some = obj.of_grasps(torch.tensor([3, 8]))
    assert some.outcomes.tolist() == [True, False] and some.grasp_type.tolist() == [1, 0]


def test_what_nobody_tried_teaches_nothing() -> None:
    asked = replace(example(4), success=None)
    assert len(asked.of_grasps(torch.tensor([1, 2]))) == 2 and asked.of_grasps(torch.tensor([1, 2])).success is None
    with pytest.raises(ValueError, match="outcomes of trials"):
        _ = asked.outcomes
    assert asked.with_success(torch.tensor([True, False, False, True])).outcomes.sum() == 2


@pytest.mark.parametrize(("winner", "paper", "log_odds"), [("paper", 1.0, 0.0), ("log_odds", 0.0, 1.0)])
def test_the_ranking_that_finds_successes_is_chosen(winner: str, paper: float, log_odds: float) -> None:
    """Grasps 0 to 3 succeed; one score knows that, the other says the opposite. Ties go to the first of the names."""
    success = torch.tensor([True] * 4 + [False] * 4)
    knows, opposite = success.float(), (~success).float()
    zero = torch.zeros(8, dtype=torch.long)
    by_ranking = {
        "paper": knows if paper else opposite,
        "log_odds": knows if log_odds else opposite,
        "log_odds_free": knows if log_odds else opposite,
    }
    scores = GraspScores(zero + 1, knows, knows, by_ranking, zero, torch.zeros(8, dtype=torch.bool))
    assert choose([scores], [success], uncalibrated(torch.tensor([0.5, 0.5])), n=4) == winner


def test_side_by_side_keeps_the_order_and_passes_errors_on() -> None:
    told: list[int] = []
    assert side_by_side(lambda x: x * x, range(5), told.append) == [0, 1, 4, 9, 16] and told == [1] * 5
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda x: 1 // x, [1, 0], told.append)
