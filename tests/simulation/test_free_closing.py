"""A hand that closes on nothing: where its joints go, when they stand still, what is told of one that explodes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from small_hands import FINGER, described, jaw, jaw_preshape, joint, link, robot

from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.free_closing import _exploded, close_without_object

EPISODE = settings(EpisodeConfig)


def test_phases_close_one_after_the_other(tmp_path: Path) -> None:
    """The left finger goes to its limit of 20 mm, then the right one to its own of 10, with 0.1 m/s."""
    preshape = {"open": {"left_joint": 0.05, "right_joint": 0.05}, "oppose": [["left"], ["right"]]}
    preshape["phases"] = [{"left_joint": -1}, {"right_joint": -1}]
    urdf = robot(
        link("left", FINGER[0], "-0.005 0 0.03"),
        link("right", FINGER[0], "0.005 0 0.03"),
        joint("left_joint", "left", axis="-1 0 0", limit="0.02 0.05"),
        joint("right_joint", "right", axis="1 0 0", limit="0.01 0.05"),
    )
    free = close_without_object(described(tmp_path, urdf, preshapes={"only": preshape}), "only", EPISODE)
    left, right = free.joints["left_joint"], free.joints["right_joint"]
    begins = int(np.argmax(right < 0.0499))
    assert left[begins] == pytest.approx(0.02, abs=1e-4) and right[0] == pytest.approx(0.05, abs=1e-5)
    assert free.end == pytest.approx({"left_joint": 0.02, "right_joint": 0.01}, abs=1e-4)
    assert free.still == pytest.approx(0.3 + 0.4 + 2 * 0.06, abs=0.06) and not free.exploded


def test_fingers_meet_and_do_not_pass_each_other(tmp_path: Path) -> None:
    """Faces meet where the joints' values are 0 together; their limits would let them pass by 20 mm each."""
    urdf = jaw().replace('lower="0"', 'lower="-0.02"')
    free = close_without_object(described(tmp_path, urdf, preshapes={"only": jaw_preshape()}), "only", EPISODE)
    assert sum(free.end.values()) == pytest.approx(0, abs=2e-3)
    assert max(free.drift.values()) < 1e-6 and free.still == pytest.approx(0.3, abs=0.15)


def test_time_that_is_too_short_is_told(tmp_path: Path) -> None:
    """30 mm at 0.1 m/s take 0.3 s."""
    closing = {"effort": 20, "speed": 0.1, "time": 0.2}
    free = close_without_object(
        described(tmp_path, jaw(), preshapes={"only": jaw_preshape()}, closing=closing), "only", EPISODE
    )
    assert free.still is None and free.times[-1] == pytest.approx(0.2)
    assert all(0.005 < value < 0.015 for value in free.end.values())


@pytest.mark.parametrize(("last", "exploded"), [(0.06, False), (0.08, True), (-0.03, True), (math.nan, True)])
def test_a_joint_far_beyond_its_limits_explodes(tmp_path: Path, last: float, exploded: bool) -> None:
    """0 to 50 mm, and 20 mm beyond them."""
    hand = described(tmp_path, jaw(), preshapes={"only": jaw_preshape()})
    assert _exploded(hand, "left_joint", np.array([0.03, last])) == exploded
