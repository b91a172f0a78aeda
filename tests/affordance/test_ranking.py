"""Rankings and calibration: by hand, and against what they are defined by."""

import math

import pytest
import torch

from spgf_torch.affordance.calibration import Calibration, fit_calibration, uncalibrated
from spgf_torch.affordance.config import RANKINGS, AffordanceConfig
from spgf_torch.affordance.ranking import UNSUPPORTED, GraspScores, score_grasps
from spgf_torch.affordance.voting import Votes
from spgf_torch.settings import settings

SHRUNK = settings(AffordanceConfig, shrinkage=10, vote_shrinkage=2)
BASE = torch.tensor([0.1, 0.5])
NO_COLLISION = torch.zeros(3, dtype=torch.bool)


def hand_made(collides: torch.Tensor = NO_COLLISION) -> GraspScores:
    """P = 0.8 (support 30) and P = 0.1 (support 10): both vote on grasp 0 (NPG), the first on 1 (WPG), none on 2."""
    zero = torch.zeros(3, dtype=torch.long)
    votes = Votes(torch.tensor([0, 0, 1]), zero, torch.tensor([0.8, 0.1, 0.8]), torch.tensor([30.0, 10.0, 30.0]))
    return score_grasps(votes, BASE, torch.tensor([0, 1, 1]), collides, SHRUNK)


def logit(p: float) -> float:
    return math.log(p / (1 - p))


def test_paper_ranking_by_hand() -> None:
    scores = hand_made()
    assert scores.by_ranking["paper"].tolist() == pytest.approx([0.9 / 4, 0.8 / 3, UNSUPPORTED])
    assert scores.probability_before.tolist() == pytest.approx([0.45, 0.8, 0.5]) and scores.votes.tolist() == [2, 1, 0]
    assert torch.equal(scores.probability, scores.probability_before)


def test_log_odds_ranking_by_hand() -> None:
    """Shrinkage 10, NPG (base 0.1): 25/40 = 0.625 and 0.1; WPG (base 0.5): 29/40 = 0.725. Then 2 votes of nothing."""
    expected = [(logit(0.625) - logit(0.1) + 0.0) / (2 + 2), (logit(0.725) - logit(0.5)) / (1 + 2), UNSUPPORTED]
    assert hand_made().log_odds.tolist() == pytest.approx(expected, rel=1e-4)


def test_sensed_collisions_come_last_but_before_no_support() -> None:
    scores = hand_made(torch.tensor([True, False, False])).calibrated(uncalibrated(BASE)).by_ranking
    assert tuple(scores) == RANKINGS
    assert scores["log_odds_free"].argsort(descending=True).tolist() == [1, 0, 2]
    assert scores["log_odds"].argsort(descending=True).tolist() == [0, 1, 2]
    assert scores["calibrated"][2] == UNSUPPORTED


def test_the_chosen_ranking_and_others_join() -> None:
    """The chosen one under the name `nested`, in this order: it is that of the columns of per_object.csv."""
    scores = (
        hand_made().calibrated(uncalibrated(BASE)).with_chosen("paper").joined_by("judge", torch.tensor([1.0, 2, 3]))
    )
    assert tuple(scores.by_ranking) == (*RANKINGS, "nested", "judge") and scores.chosen == "paper"
    assert torch.equal(scores.by_ranking["nested"], scores.by_ranking["paper"])
    assert scores.by_ranking["judge"].tolist() == [1, 2, 3]


def test_uncalibrated_takes_the_score_at_its_word() -> None:
    """Score 0 is the base rate; score s adds s to its log-odds; without votes the base rate stays."""
    score = torch.tensor([0.0, 1.5, -math.inf])
    p = uncalibrated(BASE).probability(score, torch.tensor([0, 0, 1]), NO_COLLISION)
    assert p.tolist() == pytest.approx([0.1, 1 / (1 + math.exp(-(logit(0.1) + 1.5))), 0.5], rel=1e-4)


def test_calibration_finds_the_logistic_law_that_made_the_outcomes() -> None:
    """NPG: -1 + 2 s, less 3 in a collision; WPG: 0.5 + s; 40,000 outcomes each: weights within 0.15."""
    generator = torch.Generator().manual_seed(0)
    n = 40_000
    score, grasp_type = torch.randn(2 * n, generator=generator), torch.arange(2).repeat_interleave(n)
    collides = torch.rand(2 * n, generator=generator) < 0.3
    law = torch.tensor([[-1.0, 2.0, -3.0, 0.0], [0.5, 1.0, 0.0, 0.0]])
    p = Calibration(law).probability(score, grasp_type, collides)
    success = torch.rand(2 * n, generator=generator) < p
    found = fit_calibration(score, grasp_type, collides, success)
    assert torch.allclose(found.weights, law, atol=0.15)
    assert float((found.probability(score, grasp_type, collides) - p).abs().mean()) < 0.01


def test_calibration_without_successes_stays_finite() -> None:
    score = torch.tensor([0.0, 1.0, -math.inf, 2.0])
    grasp_type, success = torch.zeros(4, dtype=torch.long), torch.zeros(4, dtype=torch.bool)
    found = fit_calibration(score, grasp_type, success, success)
    assert found.weights.isfinite().all() and found.weights[1].abs().sum() == 0
    assert (found.probability(score, grasp_type, success) < 0.1).all()
