"""The shipped hand as grippers, against numbers worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from asymmetric import GRIPPERS, exact_pose
from omegaconf import OmegaConf

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.records import Gripper, gripper_for, grippers_of, make_grasp
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed


@pytest.fixture(scope="module")
def hand() -> Hand:
    return load_hand(settings(HandConfig))


@pytest.fixture(scope="module")
def grippers(hand: Hand) -> dict[str, Gripper]:
    return grippers_of(hand)


def test_sdh2_as_two_grippers(grippers: dict[str, Gripper]) -> None:
    """The closing face of a fingertip ends 27.5 mm above the pad's centre (its box: 55 mm tall), 24 mm wide."""
    assert [g.name for g in grippers.values()] == ["sdh2_NPG", "sdh2_WPG"]
    for kind, width in (("NPG", 0.045), ("WPG", 0.095)):
        gripper = grippers[kind]
        assert gripper.width == width and gripper.base_link == "palm"
        assert gripper.depth == pytest.approx(0.0275, abs=1e-6)
        assert gripper.height == pytest.approx(0.024, abs=1e-6)
        assert len(gripper.active) == 8


def test_closed_pads_meet(grippers: dict[str, Gripper]) -> None:
    """The pads are 2 (0.033 - 0.0148 - 0.0865 sin q) apart: they meet at sin q = 0.0364 / 0.173, with the tips turned
    back by as much. Knuckles and thumb stay where they are."""
    meet = math.asin(0.0364 / 0.173)
    for gripper in grippers.values():
        for finger in ("finger_1", "finger_2"):
            assert gripper.closed[f"{finger}_proximal_joint"] == pytest.approx(meet, abs=1e-6)
            assert gripper.closed[f"{finger}_distal_joint"] == pytest.approx(-meet, abs=1e-6)
            assert gripper.closed[f"{finger}_knuckle_joint"] == pytest.approx(math.pi / 2)
        assert gripper.closed["thumb_proximal_joint"] == pytest.approx(-math.pi / 2)
        assert gripper.closed.keys() == gripper.joints.keys()


def test_base_of_the_shipped_hand(grippers: dict[str, Gripper]) -> None:
    """R of the asymmetric grasp is [0 -c s; 1 0 0; 0 s c]. The palm closes along its y: R_base = R Rz(-90 deg) =
    [c 0 s; 0 1 0; -s 0 c]. The TCP lies at (0.01905, 0, h) of the palm, h = 0.131 + 0.0865 cos q1, sin q1 =
    (0.0364 - 0.095) / 0.173 = -0.3387283, cos q1 = 0.9408831, h = 0.2123864. So the palm lies at
    (0.1 - (0.01905 c + h s), 0.2, 0.3 - (-0.01905 s + h c)) = (-0.0226910, 0.2, 0.1255930).
    """
    grasp = make_grasp(grippers["WPG"], exact_pose().astype(np.float32), 0.5, 1, [], retreat=0.1)
    c = math.cos(math.radians(30))
    expected = [[c, 0, 0.5, -0.0226910], [0, 1, 0, 0.2], [-0.5, 0, c, 0.1255930], [0, 0, 0, 1]]
    np.testing.assert_allclose(grasp.T_input_base, expected, atol=1e-6)
    assert grasp.T_input_tcp.dtype == np.float64


def test_a_mimic_joint_is_not_active() -> None:
    """The shipped parallel jaw: its second finger follows the first; fingers end 112.2 mm from panda_hand, 8.8 mm
    beyond the TCP at 103.4 mm."""
    values = OmegaConf.to_container(OmegaConf.load(root() / "conf/hand/panda.yaml"))
    wide = grippers_of(load_hand(typed(HandConfig, values)))["WPG"]
    assert (wide.name, wide.base_link, wide.active) == ("panda_WPG", "panda_hand", ("panda_finger_joint1",))
    assert wide.closed == pytest.approx({"panda_finger_joint1": 0, "panda_finger_joint2": 0}, abs=1e-9)
    assert wide.joints["panda_finger_joint2"] == pytest.approx(wide.width / 2)
    assert wide.depth == pytest.approx(0.0088, abs=1e-6)


def test_a_residue_of_the_search_for_the_opening_is_no_angle(hand: Hand) -> None:
    """What is told of a joint that stands at 0 is 0, whatever the physics starts at; all else is told to the digit."""
    held = {**hand.preshapes["WPG"].joints, "thumb_distal_joint": 7e-9, "finger_1_distal_joint": -2e-7}
    odd = replace(hand, preshapes={"WPG": replace(hand.preshapes["WPG"], joints=held, closed=held)})
    told = grippers_of(odd)["WPG"]
    assert told.joints == told.closed == {**held, "thumb_distal_joint": 0.0}
    assert odd.preshapes["WPG"].joints["thumb_distal_joint"] == 7e-9


def test_unusable_grasps_are_told_in_one_line() -> None:
    gripper = GRIPPERS["WPG"]
    skewed = np.eye(4)
    skewed[0, 1] = 0.1
    for pose, probability, support, words in (
        (skewed, 0.5, 1, "T_input_tcp: expected a rotation"),
        (np.full((4, 4), np.nan), 0.5, 1, "T_input_tcp: expected a finite number"),
        (np.eye(4), 1.2, 1, "probability: expected a finite number from 0 to 1, got 1.2"),
        (np.eye(4), 0.5, -1, "support: expected a whole number"),
    ):
        with pytest.raises(InputError, match=words):
            make_grasp(gripper, pose, probability, support, [], retreat=0.1)
    with pytest.raises(InputError, match="grasp type: expected one of NPG; got WPG"):
        gripper_for(make_grasp(gripper, np.eye(4), 0.5, 1, [], retreat=0.1), {"NPG": GRIPPERS["NPG"]})
