"""Rankings and calibration: by hand, and against what they are defined by."""

import math

import numpy as np
import pytest
import torch

from spgf_torch.affordance import calibration
from spgf_torch.affordance.calibration import PRIOR, STRAIGHT, Calibration, fit_calibration, uncalibrated
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
    law = torch.tensor([[-1.0, 2.0, -3.0, 0.0, STRAIGHT], [0.5, 1.0, 0.0, 0.0, STRAIGHT]])
    p = Calibration(law).probability(score, grasp_type, collides)
    success = torch.rand(2 * n, generator=generator) < p
    found = fit_calibration(score, grasp_type, collides, success, 2)
    assert torch.allclose(found.numbers[:, :4], law[:, :4], atol=0.15)
    assert float((found.probability(score, grasp_type, collides) - p).abs().mean()) < 0.01


def test_calibration_without_successes_stays_finite() -> None:
    score = torch.tensor([0.0, 1.0, -math.inf, 2.0])
    grasp_type, success = torch.zeros(4, dtype=torch.long), torch.zeros(4, dtype=torch.bool)
    found = fit_calibration(score, grasp_type, success, success, 2)
    assert found.numbers.isfinite().all() and found.numbers[1, :4].abs().sum() == 0
    assert (found.probability(score, grasp_type, success) < 0.1).all()


def test_the_prior_holds_weights_that_the_outcomes_would_not() -> None:
    """Three NPG of score 2 succeed, four WPG of score 0 fail; where the slope of the penalised likelihood is 0:

    NPG, constant c and slope s: c / PRIOR^2 = 3 (1 - sigmoid(c + 2 s)) and s / PRIOR^2 twice that, so s = 2 c.
    WPG, constant alone: c / PRIOR^2 = -4 sigmoid(c).
    """
    score, grasp_type = torch.tensor([2.0] * 3 + [0.0] * 4), torch.tensor([0] * 3 + [1] * 4)
    found = fit_calibration(score, grasp_type, torch.zeros(7).bool(), grasp_type == 0, 2).numbers.double()
    (c, s), other = found[0, :2].tolist(), float(found[1, 0])
    assert s == pytest.approx(2 * c) and c / PRIOR**2 == pytest.approx(3 / (1 + math.exp(5 * c)), rel=1e-4)
    assert other / PRIOR**2 == pytest.approx(-4 / (1 + math.exp(-other)), rel=1e-4) and other < -3
    assert not found[:, 2:4].any() and found[1, 1] == 0


def test_scores_below_the_bend_count_as_the_bend() -> None:
    """NPG 1 + 2 max(s, -0.5), less 3 in a collision, 0.25 without votes; WPG is straight."""
    bent = Calibration(torch.tensor([[1.0, 2.0, -3.0, -0.75, -0.5], [0.5, 1.0, 0.0, 0.0, STRAIGHT]]))
    score = torch.tensor([0.25, -0.5, -7.0, -math.inf, -7.0, -7.0])
    collides, grasp_type = torch.tensor([False] * 4 + [True, False]), torch.tensor([0] * 5 + [1])
    expected = [1.5, 0.0, 0.0, 0.25, -3.0, -6.5]
    assert torch.logit(bent.probability(score, grasp_type, collides)).tolist() == pytest.approx(expected, rel=1e-4)


def test_the_bend_is_found_where_groups_agree_on_it() -> None:
    """WPG: scores below their 0.3 quantile tell no more than it; NPG: each does. Without groups nothing can choose."""
    generator = torch.Generator().manual_seed(0)
    n = 8000
    score, grasp_type = torch.randn(2 * n, generator=generator), torch.arange(2).repeat_interleave(n)
    law = Calibration(torch.tensor([[0.0, 1.5, 0, 0, STRAIGHT], [-0.5, 3.0, 0, 0, -0.5244]]))
    none, group = torch.zeros(2 * n).bool(), torch.arange(2 * n) % 4
    success = torch.rand(2 * n, generator=generator) < law.probability(score, grasp_type, none)
    found = fit_calibration(score, grasp_type, none, success, 2, group).numbers
    assert float(found[1, 4]) == pytest.approx(float(score[n:].quantile(0.3)))
    assert torch.allclose(found[1, :2], law.numbers[1, :2], atol=0.2)
    assert found[0, 4] == score[:n].min()
    alone = fit_calibration(score, grasp_type, none, success, 2).numbers
    assert alone[:, 4].tolist() == [score[:n].min(), score[n:].min()]


def test_a_bend_must_help_most_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    """-1 loses least in all, because of one group; 0 helps three of four; 1 helps two, which are not most."""
    loss = {-2.0: [10.0, 10, 10, 30], -1.0: [11.0, 11, 11, 10], 0.0: [9.0, 9, 9, 31], 1.0: [5.0, 5, 12, 31]}
    monkeypatch.setattr(calibration, "_held_out_loss", lambda terms, success, group: loss[float(terms[0, 1])])
    score, success = torch.tensor([-3.0, 4.0]), torch.tensor([False, True])
    assert calibration._chosen_bend([*loss], score, success, torch.tensor([0, 1])) == 0.0
    del loss[0.0]
    assert calibration._chosen_bend([*loss], score, success, torch.tensor([0, 1])) == -2.0


def test_the_loss_of_a_group_is_by_the_curve_of_the_others() -> None:
    """The constant alone: of two successes and of three failures, 2 (1 - sigmoid(a)) = a / PRIOR^2 and so on."""
    success, group = np.array([True, True, False, False, False]), np.array([7, 7, 2, 2, 2])
    terms = np.ones((5, 1))
    up, down = (float(calibration._logistic(np.ones((n, 1)), np.full(n, n == 2))[0]) for n in (2, 3))
    assert 2 / (1 + math.exp(up)) == pytest.approx(up / PRIOR**2) and up > 3 and down < -3
    expected = [3 * math.log1p(math.exp(up)), 2 * math.log1p(math.exp(-down))]
    assert calibration._held_out_loss(terms, success, group) == pytest.approx(expected)


def test_the_prior_of_a_calibration_by_hand() -> None:
    """Four failures of score 0 leave the constant w alone to minimise 4 log(1 + exp(w)) + w^2 / 200.

    So 4 sigmoid(w) = -w / 100, at w = -4.48047: without the prior it would be minus infinity.
    """
    zero = torch.zeros(4)
    found = fit_calibration(zero, zero.long(), zero.bool(), zero.bool(), 2).numbers[0, :4]
    assert found.tolist() == pytest.approx([-4.48047, 0.0, 0.0, 0.0], rel=1e-3)
