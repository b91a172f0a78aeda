"""Shapes of what was learned: members, hands; by hand."""

import numpy as np
import pytest
import torch

from spgf_torch.affordance.calibration import TERMS, Calibration
from spgf_torch.affordance.model import GraspModel
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.hands.config import HandConfig
from spgf_torch.reporting.figures.learned import Members, best_percent, spread
from spgf_torch.settings import plain, settings


def test_members_are_averaged_without_their_gaps() -> None:
    """Prototype 1 has two features; one of them has a gap on top in cell 2, both have one below all around."""
    features = np.zeros((3, 2, 4, 2))
    features[:, 1] = 90, 180
    features[1, 0, 2], features[2, 0, 2] = (90, 90), (10, 40)
    features[1, 0, 3], features[2, 0, 3] = (10, 20), (30, 60)
    prototypes = np.stack([features[0], features[1:].mean(axis=0), features[0]])
    members = Members.of(features, np.array([0, 1, 1]), prototypes)
    assert members.share == pytest.approx([1 / 3, 2 / 3, 0])
    assert members.seen[1, 0].tolist() == [1, 1, 0.5, 1] and not members.seen[1, 1].any()
    assert members.degrees[1, 0, 2:].tolist() == [[10, 40], [20, 40]]  # the prototype's own: (50, 65) and (20, 40)
    assert members.seen[2, 0].all() and members.degrees[2].tolist() == prototypes[2].tolist()  # of none: as it is


def test_spread_takes_the_farthest_next() -> None:
    position = np.array([[0, 0, 0], [0.01, 0, 0], [0.1, 0, 0], [0.05, 0, 0]])
    still = np.tile([1.0, 0, 0, 0], (4, 1))
    assert spread(position, still, 3).tolist() == [0, 2, 3]
    assert len(spread(position, still, 9)) == 4 and len(spread(position[:0], still[:0], 3)) == 0


def test_best_percent_is_of_one_prototype_and_type() -> None:
    """Of 150 points the best hundredth is two: 0.9 and 0.7 of prototype 0's WPG; prototype 1 has no point of NPG."""
    wide = torch.zeros(150)
    wide[[3, 77]] = torch.tensor([0.7, 0.9])
    probability = torch.cat([torch.full((10,), 0.2), wide, torch.full((5,), 1.0)])
    start = torch.tensor([0, 10, 160, 160, 165])  # slices: prototype, then type
    cell, support = torch.arange(165), torch.full((165,), 3.0)
    condensed = Condensed(start, cell, probability, support, torch.tensor([0.1, 0.4]))
    calibration = Calibration(torch.zeros(2, len(TERMS)))
    hand = {"hand": plain(settings(HandConfig))}
    model = GraspModel(torch.zeros(2, 144), condensed, SE3Grid(0.1, 0.012, 22.5), calibration, hand)
    found = [best_percent(model, k, kind) for k in (0, 1) for kind in ("NPG", "WPG")]
    assert found == pytest.approx([0.2, 0.8, 0.0, 1.0])
