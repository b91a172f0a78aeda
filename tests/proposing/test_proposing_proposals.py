"""Grasps of any types in one ranking: each under its own name, and types ordered among each other, by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from proposing_models import AFFORDANCE, CONFIG, SETTINGS, VOLUMES, centres, features_of, two_fingers

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.model import GraspModel
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.pairs import grid_of
from spgf_torch.hands.records import Gripper
from spgf_torch.predictor import Predictor, block
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.config import HypothesesConfig, ProposingConfig
from spgf_torch.proposing.hypotheses import Search
from spgf_torch.proposing.proposals import Proposals, between_types
from spgf_torch.proposing.propose import Proposer
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

# Of rates of 2 % and 97 %, a pinch of 40 % and a power grasp of 95 %; votes draw their gains down to a fifth.
PINCH, POWER = math.log(0.4 / 0.6), math.log(0.95 / 0.05)
GAINS = PINCH - math.log(0.02 / 0.98), POWER - math.log(0.97 / 0.03)


@pytest.mark.parametrize(
    ("weight", "expected"),
    [
        (0.0, [0.2 * GAINS[0], 0.2 * GAINS[1]]),  # 0.697 and -0.106: the pinch is first
        (0.25, [0.15 * GAINS[0] + 0.25 * PINCH, 0.15 * GAINS[1] + 0.25 * POWER]),  # 0.422 and 0.656: the power grasp
        (1.0, [PINCH, POWER]),
    ],
)
def test_a_power_grasp_of_95_percent_and_a_pinch_of_40(weight: float, expected: list[float]) -> None:
    score, probability = 0.2 * torch.tensor(GAINS), torch.tensor([0.4, 0.95])
    config = settings(ProposingConfig, probability_weight=weight)
    found = between_types(score, probability, torch.tensor([0, 1]), config)
    assert found.tolist() == pytest.approx(expected, rel=1e-5)
    assert int(found.argmax()) == (1 if weight else 0)


def test_the_settings_put_the_power_grasp_first() -> None:
    config = settings(ProposingConfig)
    assert int(between_types(0.2 * torch.tensor(GAINS), torch.tensor([0.4, 0.95]), torch.arange(2), config).argmax())


def test_within_a_type_the_score_orders() -> None:
    """Three of one type: the best score has the least probability, yet counts with the greatest."""
    score, probability = torch.tensor([0.1, 0.3, 0.5, 0.2]), torch.tensor([0.8, 0.9, 0.5, 0.7])
    kind, config = torch.tensor([1, 0, 1, 1]), settings(ProposingConfig, probability_weight=1.0)
    found = between_types(score, probability, kind, config).sigmoid()
    assert found.tolist() == pytest.approx([0.5, 0.9, 0.8, 0.7])
    assert len(between_types(score[:0], probability[:0], kind[:0], config)) == 0


def test_types_of_a_model_are_ordered_by_its_weight() -> None:
    """One feature with one particle of each type, 30 mm ahead: 40 % of 50 pinches held there, where 2 % do at random,
    and 99 % of 500 power grasps, where 97 % do. Shrunk, the rates gain 3.34 and 1.10 in log-odds, over 1001, and the
    probabilities, which are little more than the rates at random, turn the order round."""
    lattice = grid_of(AFFORDANCE)
    cell = lattice.index(torch.tensor([0.0, 0.0, 0.03]), torch.tensor([1.0, 0.0, 0.0, 0.0]))
    known = torch.tensor([0.4, 0.99]), torch.tensor([50.0, 500.0]), torch.tensor([0.02, 0.97])
    condensed = Condensed(torch.tensor([0, 1, 2]), cell.repeat(2), *known)
    model = GraspModel(centres(1), condensed, lattice, uncalibrated(condensed.base_rate), SETTINGS)
    features = features_of(torch.eye(4)[None], torch.tensor([0]), model.centres)
    for weight, order in ((0.0, [0, 1]), (0.25, [1, 0])):
        config = replace(CONFIG, rounds=0, vote_shrinkage=1000, probability_weight=weight)
        found = Proposer.of(model, config, VOLUMES).propose_from(features, torch.zeros(0, 3))
        assert found.grasp_type.tolist() == order and found.grasp_types == ("NPG", "WPG")
        gains = [1001 * float(found.score[order.index(kind)]) for kind in range(2)]
        assert weight or gains == pytest.approx([3.34, 1.10], abs=0.01)
        assert found.probability[order.index(1)] > 0.97 > 0.03 > found.probability[order.index(0)]


THREE = {"WPG": two_fingers(0.05), "NPG": two_fingers(0.02), "MPG": two_fingers(0.035)}


def test_a_third_type_keeps_its_name() -> None:
    """Whatever the order that a hand lists its types in, each code's hypotheses are those of its own jaws alone."""
    config = settings(HypothesesConfig, seeds=8, hypotheses=100_000)
    search, thing = Search.of(Clearance(THREE, 0.005, 0.01), config), block(0.005, 0.03)
    names = search.clearance.grasp_types
    assert names == ("MPG", "NPG", "WPG")
    assert [round(1000 * hand.region.half, 3) for hand in search.hands] == [17.5, 10, 25]
    found, counts = search.hypotheses(thing, Surroundings()), []
    for code, name in enumerate(names):
        alone = Search.of(Clearance({name: THREE[name]}, 0.005, 0.01), config).hypotheses(thing, Surroundings())
        assert torch.equal(found.T[found.grasp_type == code], alone.T)
        counts.append(len(alone))
    assert 0 < counts[1] < counts[0] < counts[2]


def gripper(name: str, width: float) -> Gripper:
    """A hand without shapes."""
    joints = {"jaw": width}
    return Gripper(f"claw_{name}", name, "palm", np.eye(4), joints, {"jaw": 0.0}, ("jaw",), width, 0, 0, True, 2, ())


def test_a_third_type_is_predicted_under_its_name() -> None:
    """Codes count in the order of the sorted names, not in that of the grippers."""
    grippers = {name: gripper(name, width) for name, width in (("WPG", 0.05), ("NPG", 0.02), ("MPG", 0.035))}
    kinds, of_each = torch.tensor([1, 0, 2, 0]), torch.tensor([0.9, 0.8, 0.7, 0.6])
    names = ("MPG", "NPG", "WPG")
    proposals = Proposals(torch.eye(4).repeat(4, 1, 1), kinds, names, of_each, of_each, kinds, ((), (), (), ()))
    best = proposals.best(1)
    assert {name: which.tolist() for name, which in best.items()} == {"MPG": [1], "NPG": [0], "WPG": [2], "CG": [0]}
    found = Predictor(None, settings(SensingConfig), grippers, None, 0.1).grasps(proposals, 1)
    assert [(grasp.type, grasp.joints["jaw"]) for grasp in found] == [("NPG", 0.02), ("MPG", 0.035), ("WPG", 0.05)]


def test_votes_for_a_third_type_keep_its_name() -> None:
    """Of three types only the middle one by name, NPG, has a promising particle: it is what is proposed, by that name,
    and its own jaws, 20 mm apart, are what must be free: a point 15 mm beside the TCP is in a finger."""
    lattice = grid_of(AFFORDANCE)
    cell = lattice.index(torch.tensor([0.0, 0.0, 0.03]), torch.tensor([1.0, 0.0, 0.0, 0.0]))
    rates = torch.full((3,), 0.5)
    condensed = Condensed(torch.tensor([0, 0, 1, 1]), cell[None], torch.tensor([0.9]), torch.tensor([50.0]), rates)
    model = GraspModel(centres(1), condensed, lattice, uncalibrated(rates), SETTINGS)
    proposer = Proposer.of(model, replace(CONFIG, rounds=0), THREE)
    features = features_of(torch.eye(4)[None], torch.tensor([0]), model.centres)
    found = proposer.propose_from(features, torch.zeros(0, 3))
    assert [found.grasp_types[code] for code in found.grasp_type.tolist()] == ["NPG"]
    tcp = found.T_object_tcp[0]
    for x, free in ((0.0, True), (0.015, False)):
        points = torch.stack([tcp[:3, 3], tcp[:3, 3] + x * tcp[:3, 0]])
        assert len(proposer.propose_from(features, points)) == int(free)
