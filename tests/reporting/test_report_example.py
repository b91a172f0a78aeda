"""The steps of one feature that the figures of the method draw: by hand, and as `spgf` has them."""

import numpy as np
import pytest
import torch

from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.reporting.figures.example import Steps, Surroundings, telling_feature
from spgf_torch.reporting.figures.grid_figures import spread_out
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings

CONFIG = settings(FeatureConfig, radius=0.03)
TILT = np.radians(60)


def texlets() -> Texlets:
    """A centre that looks up; ahead (+x) two flat ones and one tilted by 60 deg and 10 mm lower, aside (+y) one that
    looks down, and one too far away to be a neighbour."""
    positions = torch.tensor(
        [[0, 0, 0], [0.02, 0, 0], [0.025, 0, 0], [0.02, 0, -0.01], [0, 0.01, -0.002], [0.031, 0, 0]]
    )
    tilted = [np.sin(TILT), 0, np.cos(TILT)]
    normals = torch.tensor([[0, 0, 1], [0, 0, 1], [0, 0, 1], tilted, [0, 0, -1], [0, 0, 1]], dtype=torch.float32)
    return Texlets(positions, normals)


def test_neighbours_cells_and_gaps() -> None:
    """R_x points to the mean of the steps, (0.01625, 0.0025, -0.003): the three ahead lie at alpha3 = -8.75 deg, the
    one aside at 81.25 deg, so cells 35 and 8."""
    steps = Steps.of(Surroundings.of(texlets(), 0.03), 0, CONFIG)
    turn = np.degrees(np.arctan2(0.0025, 0.01625))
    assert sorted(steps.neighbour.tolist()) == [1, 2, 3, 4] and steps.top.sum() == 3
    assert steps.angles[2] == pytest.approx([-turn, -turn, -turn, 90 - turn])
    low = np.degrees(np.arctan2(0.01, 0.02))
    assert steps.angles[0] == pytest.approx([0, 0, low, np.degrees(np.arctan2(0.002, 0.01))], abs=1e-4)
    assert steps.grid[0, 35] == pytest.approx([low / 3, 20], abs=1e-4)  # the mean of 0, 0, 60 deg
    assert np.isfinite(steps.grid[..., 0]).sum() == 2 and steps.grid[1, 8, 1] == pytest.approx(180, abs=1e-3)
    known = np.arange(35 - 6, 35 + 7) % 36  # what six cells to either side reach
    assert np.flatnonzero(~steps.gap[0]).tolist() == sorted(known) and steps.gap[1].sum() == 36 - 13
    assert steps.smooth[0, 20].tolist() == pytest.approx([90, 90]) and steps.smooth[1, 30].tolist() == [90, 180]


def test_steps_are_the_features_of_spgf() -> None:
    generator = torch.Generator().manual_seed(0)
    positions = torch.rand(80, 3, generator=generator) * 0.06
    normals = torch.nn.functional.normalize(torch.randn(80, 3, generator=generator), dim=1)
    found = spgf(positions, normals, CONFIG)
    around = Surroundings.of(Texlets(positions, normals), 0.03)
    for i in (0, 17, 51):
        steps = Steps.of(around, i, CONFIG)
        assert np.radians(steps.aligned) == pytest.approx(found.rings[i].numpy(), abs=1e-5)
        assert steps.T_object_feature == pytest.approx(found.T_object_feature[i].numpy(), abs=1e-5)
    centre, pair = around.telling_pair(0.03)
    assert around.own(centre).start <= pair < around.own(centre).stop
    assert np.abs(np.degrees(around.angles[:, pair]) - [30, 55, 40]).max() < 25


def test_one_neighbour_of_each_part_is_chosen() -> None:
    """Of four parts of the turn two hold neighbours of the top layer: the farther one ahead counts."""
    steps = Steps.of(Surroundings.of(texlets(), 0.03), 0, CONFIG)
    assert [int(steps.neighbour[i]) for i in spread_out(steps, 4)] == [2]


def test_a_gap_with_another_side_is_told_before_a_bend() -> None:
    """Three features face the camera: flat, bent, a rim; the fourth is a rim that looks away."""
    rings = torch.zeros(4, 2, 36, 2)
    rings[:, 1] = torch.tensor([np.pi / 2, np.pi])
    rings[1, 0, :9, 1] = 1.2
    rings[2:, 0, :6] = np.pi / 2
    rings[2:, 1] = torch.tensor([0.1, 3.0])
    found = spgf(torch.zeros(0, 3), torch.zeros(0, 3), CONFIG)
    found = type(found)(torch.eye(4).repeat(4, 1, 1), rings, torch.ones(4, dtype=torch.bool))
    up, down = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
    assert telling_feature(found, np.array([up, up, up, down]), (0.0, 90.0)) == 2
    assert telling_feature(found, np.array([up, up, down, down]), (0.0, 90.0)) == 1
