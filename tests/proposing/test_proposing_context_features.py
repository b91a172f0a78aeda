"""Numbers about a hand among other things, by hand and by a slow loop."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.hands.config import HandConfig
from spgf_torch.paths import find
from spgf_torch.proposing.clearance import Clearance, Plane, Surroundings
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.context_features import BALL, CONTEXT, about, context_features
from spgf_torch.proposing.hypotheses import Hypotheses, Search, local
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings, typed

TABLE = Plane.of((0.0, 0.0, 1.0), 0.02)


@pytest.fixture(scope="module")
def search() -> Search:
    from omegaconf import OmegaConf

    hand = typed(HandConfig, OmegaConf.to_container(OmegaConf.load(find("conf/hand/panda.yaml"))))
    return Search.of(Clearance(open_hand(hand), 0.005, 0.015), settings(HypothesesConfig))


def downwards(turn_deg: float, place: tuple[float, float, float]) -> torch.Tensor:
    """(1, 4, 4): from above, the closing axis turned about the vertical."""
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    T = torch.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2] = torch.tensor([c, s, 0]), torch.tensor([s, -c, 0]), torch.tensor([0, 0, -1.0])
    T[:3, 3] = torch.tensor(place)
    return T[None]


def test_two_rims_between_the_pads(search: Search) -> None:
    """Two points 20 mm apart across an opening of 80 mm, and one beside: 9 or 10 of 40 stretches lie empty between."""
    wide = search.clearance.grasp_types.index("WPG")
    points = torch.tensor([[-0.0101, 0.0, 0.1], [0.0101, 0.0, 0.105], [0.0, 0.03, 0.1]])
    seen = Seen(Texlets(points, torch.tensor([[0.0, 0, 1]]).repeat(3, 1)), bodies=torch.tensor([4, 7, 7]))
    poses = Hypotheses(downwards(0, (0.0, 0.0, 0.1)), torch.tensor([wide]))
    row = context_features(seen, Surroundings(table=TABLE, retreat=0.1), poses, search)[0]
    found = dict(zip(CONTEXT, row.tolist(), strict=True))
    assert found["down"] == 1 and found["tilt"] == 0 and found["height"] == pytest.approx(0.08)
    lowest = float(search.clearance.corners["WPG"][:, 2].max())
    assert found["lowest"] == pytest.approx(0.08 - lowest, abs=1e-6)
    assert found["body"] == pytest.approx(math.log(2)) and found["strange"] == 0.5
    assert found["others"] == pytest.approx(math.log(3))
    assert found["beside"] == pytest.approx(math.log(2)) and found["gap"] == pytest.approx(10 / 40, abs=1 / 40)
    assert found["top"] == pytest.approx(0.005, abs=1e-6) and found["foot"] == pytest.approx(0.08, abs=1e-6)
    assert found["off_x"] == pytest.approx(0, abs=1e-6) and found["off_y"] == pytest.approx(0.01, abs=1e-6)
    assert found["off_z"] == pytest.approx(-0.005 / 3, abs=1e-6)
    assert found["std_x"] == pytest.approx(0.0101 * math.sqrt(2 / 3), abs=1e-6)
    assert found["way_unseen"] == 0  # no image is known


def test_the_way_is_that_from_the_pregrasp(search: Search) -> None:
    """A point 18 cm above the TCP is clear of the hand at the grasp, and on its way where the clearance has one."""
    wide = search.clearance.grasp_types.index("WPG")
    T = downwards(0, (0.0, 0.0, 0.2))
    points = torch.tensor([[0.0, 0.0, 0.38], [0.0, 0.0, 0.2]])
    seen = Seen(Texlets(points, torch.tensor([[0.0, 0, 1]]).repeat(2, 1)))
    clearance = Clearance(search.clearance.volumes, 0.005, 0.015, way=0.2)
    swept = Search.of(clearance, search.config)
    poses, around = Hypotheses(T, torch.tensor([wide])), Surroundings(table=TABLE, retreat=0.2)
    at = CONTEXT.index("way_margin")
    there = context_features(seen, around, poses, search)[0, at]
    on_way = context_features(seen, around, poses, swept)[0, at : at + 2]
    assert on_way[0] < 0 < there and on_way[1] == search.config.margin  # there is one body
    two = replace(seen, bodies=torch.tensor([1, 0]))
    assert torch.equal(context_features(two, around, poses, swept)[0, at : at + 2], on_way[:1].repeat(2))


def test_numbers_about_a_hand_equal_a_slow_loop(search: Search) -> None:
    rng = torch.Generator().manual_seed(3)
    points = 0.06 * torch.randn(3000, 3, generator=rng) + torch.tensor([0.0, 0.0, 0.1])
    T = torch.cat([downwards(angle, (0.01, 0.0, 0.1)) for angle in (0, 25, 70)])
    hand = search.hands[1]
    own = torch.rand(3, 3000, generator=rng) < 0.8
    found = about(local(T, points), own, T, TABLE, hand)
    for g, pose in enumerate(T.double().numpy()):
        at = (points.double().numpy() - pose[:3, 3]) @ pose[:3, :3]
        x, y, z = at.T
        region = hand.region
        along = np.abs(x - region.middle) < region.half
        between = along & (np.abs(y) < region.height) & (z > region.low) & (z < region.high)
        near = np.linalg.norm(at, axis=1) < BALL
        over = points.double().numpy()[:, 2] - pose[2, 3]
        about_pads = along & (np.abs(y) < 0.03) & (z > region.low - 0.03) & (z < region.high + 0.03)
        where = np.unique(np.floor((x[between] - region.middle + region.half) / (2 * region.half) * 40))
        gap = max(np.diff(where).max() - 1, 0) / 40 if len(where) > 1 else 0.0
        mean = at[near].mean(axis=0)
        its = own[g].numpy()
        expected = [
            math.log1p(its.sum()),
            (between & ~its).sum() / between.sum(),
            math.log1p((near & ~between).sum()),
            math.log1p((near & ~its).sum()),
            gap,
            over[about_pads].max(),
            pose[2, 3] - TABLE.offset + over[between].min(),
            *np.abs(mean[:2]),
            mean[2],
            *at[near].std(axis=0),
        ]
        assert found[g].tolist() == pytest.approx(expected, abs=1e-5)
