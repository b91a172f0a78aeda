"""What moved a judge: a logistic form whose answer is known by hand."""

import math
from dataclasses import replace

import pytest
import torch
from proposing_models import CONFIG, VOLUMES

from spgf_torch.drawing.judge_words import SHOWN, WeighedNumber, weighed_words
from spgf_torch.predictor import block
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.judge import KNOWN, Judge
from spgf_torch.proposing.judge_features import NAMES, Seen
from spgf_torch.proposing.judge_influences import Numbers, Weight, weighed
from spgf_torch.proposing.judge_proposer import JudgedProposer
from spgf_torch.proposing.tree_ensembles import Logistic
from spgf_torch.settings import plain, settings


def form(weights: dict[str, float], baseline: float, names: tuple[str, ...]) -> Logistic:
    count, weight = len(names), torch.zeros(2 * len(names)).double()
    for name, value in weights.items():
        weight[names.index(name)] = value
    return Logistic(torch.zeros(count).double(), torch.ones(count).double(), weight, torch.tensor([baseline]).double())


def judge(weights: dict[str, float]) -> Judge:
    """P(free) is 1 for all that matters; P(holds | free) has these log-odds."""
    factors = {(known, "free"): form({}, 40.0, names) for known, names in KNOWN.items()}
    return Judge(factors | {(known, "holds"): form(weights, 0.0, names) for known, names in KNOWN.items()}, {}, 0.8)


def test_numbers_are_weighed_against_the_usual() -> None:
    """Log-odds 2 width - 3 anti_min: width 0.5 for 0.2 adds 0.6, anti_min 0.1 for 0.5 adds 1.2; the rest nothing."""
    values, usual = torch.zeros(len(NAMES)), torch.zeros(len(NAMES))
    values[NAMES.index("width")], usual[NAMES.index("width")] = 0.5, 0.2
    values[NAMES.index("anti_min")], usual[NAMES.index("anti_min")] = 0.1, 0.5
    values[NAMES.index("palm")] = 1.0
    for images in (True, False):
        (found,) = weighed(judge({"width": 2.0, "anti_min": -3.0}), [Numbers(values, usual, images)])
        assert [weight.name for weight in found] == ["anti_min", "width"]
        assert [weight.moved for weight in found] == pytest.approx([1.2, 0.6], abs=1e-4)
        assert found[1].value == 0.5 and math.isclose(found[1].usual, 0.2, abs_tol=1e-6)


def test_a_judge_alone_tells_what_it_weighed() -> None:
    """Without a model's votes, too: the numbers of each of its grasps, of a block."""
    hypotheses = plain(settings(HypothesesConfig, seeds=8, hypotheses=200))
    alone = JudgedProposer.alone(replace(judge({"width": 2.0}), settings={"hypotheses": hypotheses}), VOLUMES, CONFIG)
    found = alone.propose(Seen(block(0.005), ()))
    assert len(found.numbers) == len(found) > 1 and found.voters is None
    width = [float(numbers.values[NAMES.index("width")]) for numbers in found.numbers]
    probability = torch.sigmoid(2 * torch.tensor(width)) * torch.sigmoid(torch.tensor(40.0))
    assert torch.allclose(found.probability, probability, atol=1e-5)


def test_words_have_units() -> None:
    weights = [Weight("worst_finger", 0.12, 0.4, 1.0), Weight("margin", 0.006, 0.004, -0.5), Weight("type", 0, 1, 0.2)]
    assert weighed_words(weights, ("NPG", "WPG")) == (
        WeighedNumber("unseen space in the worse finger", "12 %", "40 %", 1.0),
        WeighedNumber("nearest point to the hand", "6 mm", "4 mm", -0.5),
        WeighedNumber("grasp type", "NPG", "WPG", 0.2),
    )
    assert weighed_words([Weight("new", 0.5, 0.25, 1.0)], ()) == (WeighedNumber("new", "0.50", "0.25", 1.0),)
    assert len(weighed_words([Weight("new", 0.5, 0.25, 1.0)] * 9, ())) == SHOWN


def test_every_number_has_words() -> None:
    for name in NAMES:
        (told,) = weighed_words([Weight(name, 0.0, 1.0, 1.0)], ("NPG", "WPG"))
        assert told.words != name
