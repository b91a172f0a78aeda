"""Whether fingers would close on one thing: by bodies, and by surfaces that face each other across a gap."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from proposing_models import VOLUMES

from spgf_torch.ops.facing_gap import facing_gap
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.config import HypothesesConfig, proposing_named
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.proposing.one_thing import one_thing
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings

CONFIG = replace(proposing_named("clutter").neighbours, strangers=0.15, gap_from=0.004, gap_to=0.02)
SEARCH = Search.of(Clearance(VOLUMES, 0.005, 0.01), settings(HypothesesConfig))
WIDE = Hypotheses(torch.eye(4)[None], torch.ones(1, dtype=torch.int64))  # 5 cm between the fingers, along x


def walls(*faces: tuple[float, float]) -> Texlets:
    """Of each (x, sign) three texlets at x (m) whose normals point along it."""
    positions = [[x, 0.004 * k, 0.0] for x, _ in faces for k in (-1, 0, 1)]
    normals = [[sign, 0.0, 0.0] for _, sign in faces for _ in range(3)]
    return Texlets(torch.tensor(positions), torch.tensor(normals))


@pytest.mark.parametrize(
    ("faces", "one"),
    [
        (((-0.002, -1), (0.002, 1)), True),  # one wall
        (((-0.008, -1), (-0.005, 1), (0.005, -1), (0.008, 1)), False),  # two, 10 mm apart
        (((-0.004, -1), (-0.0015, 1), (0.0015, -1), (0.004, 1)), True),  # 3 mm: noise
        (((-0.02, -1), (-0.015, 1), (0.015, -1), (0.02, 1)), True),  # 30 mm: the inside of a cup
        (((-0.035, -1), (-0.032, 1), (0.005, -1), (0.008, 1)), True),  # of which one is not between the fingers
    ],
)
def test_two_rims_are_not_one_wall(faces: tuple, one: bool) -> None:
    seen = Seen(walls(*faces))
    assert one_thing(seen, WIDE, SEARCH, CONFIG).tolist() == [one]
    assert one_thing(seen, WIDE, SEARCH, replace(CONFIG, gap_to=0.0)).tolist() == [True]


@pytest.mark.parametrize(("bodies", "one"), [((0, 0, 0, 0), True), ((3, 3, 3, 7), False), ((3, 7, 7, 7), True)])
def test_points_of_another_thing(bodies: tuple, one: bool) -> None:
    """Four walls that face one way; the first is not between the fingers, and the third is nearest to the TCP."""
    texlets = walls((-0.03, -1), (-0.01, -1), (0.002, -1), (0.02, -1))
    seen = Seen(texlets, bodies=torch.tensor(bodies).repeat_interleave(3))
    assert one_thing(seen, WIDE, SEARCH, CONFIG).tolist() == [one]
    assert one_thing(seen, WIDE, SEARCH, replace(CONFIG, strangers=0.34)).tolist() == [True]


def test_the_gap_equals_a_slow_loop() -> None:
    generator = np.random.default_rng(0)
    x = generator.normal(0, 0.01, (30, 25)).astype(np.float32)
    facing, between = generator.uniform(-1, 1, (30, 25)).astype(np.float32), generator.random((30, 25)) < 0.7
    gap = facing_gap(*map(torch.from_numpy, (x, facing, between)))
    for g in range(30):
        towards = x[g, between[g] & (facing[g] > 0.5)]
        back = x[g, between[g] & (facing[g] < -0.5)]
        steps = [min(b - a for b in back if b > a) for a in towards if (back > a).any()]
        assert gap[g] == pytest.approx(max(steps, default=0.0), abs=1e-7)
    assert (gap > 0).sum() > 20
