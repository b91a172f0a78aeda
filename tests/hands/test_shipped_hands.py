"""The shipped hands measure what their data sheets say and hold things; public descriptions work as they come."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from trial_objects import ball, box, can, from_above, from_side, grasp

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import Simulator
from spgf_torch.simulation.precheck import PreCheck

DESCRIPTIONS = sorted((Path(__file__).parent / "descriptions").glob("*.yaml"))
PUBLIC = root().parent / "shared"


def shipped(name: str) -> Hand:
    return load_hand(typed(HandConfig, yaml.safe_load((root() / f"conf/hand/{name}.yaml").read_text())))


def public(path: Path) -> HandConfig:
    """The description at `path`, which says where its files are seen from the repository."""
    if not PUBLIC.is_dir():
        pytest.skip("needs the public descriptions in ../shared")
    told = yaml.safe_load(path.read_text())
    told["packages"] = {name: str(root() / folder) for name, folder in told.get("packages", {}).items()}
    return typed(HandConfig, {**told, "urdf": str(root() / told["urdf"])})


def apart(hand: Hand, grasp_type: str, one: str, other: str) -> float:
    """m between two pads along the closing axis."""
    preshape = hand.preshapes[grasp_type]
    return float(abs((preshape.pads[one] - preshape.pads[other]) @ preshape.T_base_tcp[:3, 0]))


def outcome(hand: Hand, grasp_type: str, obj, T: np.ndarray) -> str:
    if PreCheck(obj, hand.preshapes[grasp_type]).collides(T):
        return "collision"
    return Simulator(obj, hand, settings(EpisodeConfig)).run(T, grasp_type)


def test_two_fingers_measure_as_in_the_manual():
    """85 mm open, 162.8 mm high when closed, the tips upright on the way."""
    hand = shipped("robotiq_2f")
    assert apart(hand, "pinch_wide", "left", "right") == pytest.approx(0.085, abs=1e-4)
    assert apart(hand, "pinch_narrow", "left", "right") == pytest.approx(0.0425, abs=1e-4)
    closed = Kinematics(hand.robot).links(hand.preshapes["pinch_wide"].closed)
    top = max(
        float(c.mesh.copy().apply_transform(closed[c.link] @ c.T_link_shape).bounds[1, 2])
        for c in hand.robot.collisions
    )
    assert top == pytest.approx(0.1628, abs=2e-4)
    for links in (closed, hand.preshapes["pinch_narrow"].T_base_link):
        np.testing.assert_allclose(links["left_tip"][:3, :3], np.eye(3), atol=1e-9)
    assert hand.robot.passive == {"left_inner_knuckle", "right_inner_knuckle"}


def test_three_fingers_open_as_in_the_manual():
    """155 mm; the scissor axis puts b and c side by side or apart, 72 mm between them otherwise."""
    hand = shipped("robotiq_3f")
    assert apart(hand, "cylinder", "a", "b") == pytest.approx(0.155, abs=1e-3)
    beside = {name: p.pads["b"][1] - p.pads["c"][1] for name, p in hand.preshapes.items()}
    assert beside["cylinder"] == pytest.approx(0.072)
    assert beside["pinch"] < 0.045 < 0.11 < beside["sphere"]


def test_one_jaw_opens_as_its_lever_says():
    """A point of its face is 70.9 mm from its axis, 19.6 deg before the upright: 70.9 sin(q - 19.6) + 28.1 mm."""
    hand = shipped("so101")
    assert apart(hand, "pinch_narrow", "moving", "fixed") == pytest.approx(0.0348, abs=2e-4)  # q = 25 deg
    assert apart(hand, "pinch_wide", "moving", "fixed") == pytest.approx(0.0640, abs=2e-4)  # q = 50 deg
    assert {preshape.closed["jaw_joint"] for preshape in hand.preshapes.values()} == {0}
    assert {preshape.symmetry for preshape in hand.preshapes.values()} == {1}


def test_sdh2_pinches_are_those_of_the_paper():
    fingers, paper = shipped("sdh2_fingers"), shipped("sdh2")
    for name, same in (("pinch_narrow", "NPG"), ("pinch_wide", "WPG")):
        assert fingers.preshapes[name].joints == pytest.approx(paper.preshapes[same].joints)
        np.testing.assert_allclose(fingers.preshapes[name].T_base_tcp, paper.preshapes[same].T_base_tcp, atol=1e-12)


def test_sdh2_tips_stand_where_the_fingers_put_them():
    """13.8 + 86.5 sin(30) mm to each side of the cylinder's middle, 23.3 + 86.5 sin(30) mm around the palm's axis."""
    hand = shipped("sdh2_fingers")
    assert apart(hand, "cylinder_tip", "thumb", "first") == pytest.approx(2 * 0.05705, abs=2e-4)
    pads = hand.preshapes["sphere_tip"].pads
    for pad in pads.values():
        assert np.linalg.norm(pad[:2]) == pytest.approx(0.06655, abs=2e-4)
    towards = {name: np.degrees(np.arctan2(pad[1], pad[0])) % 360 for name, pad in pads.items()}
    assert towards == pytest.approx({"thumb": 180, "first": 300, "second": 60}, abs=0.1)


HELD = {
    "robotiq_2f pinch_narrow": (box((0.03, 0.06, 0.1)), from_side(0.05)),
    "robotiq_2f pinch_wide": (can(), from_side(0.06)),
    "so101 pinch_narrow": (box((0.016, 0.03, 0.1), 0.1), from_side(0.05)),
    "so101 pinch_wide": (can(0.02), from_side(0.06)),
    "robotiq_3f cylinder": (can(0.05), from_side(0.06)),
    "robotiq_3f pinch": (can(0.025), from_side(0.06)),
    "robotiq_3f sphere": (ball(0.05), from_above(0.05)),
    "sdh2_fingers cylinder_power": (can(0.05), from_side(0.06)),
    "sdh2_fingers cylinder_tip": (can(0.04), from_side(0.06)),
    "sdh2_fingers sphere_power": (ball(0.055), from_above(0.055)),
    "sdh2_fingers sphere_tip": (ball(0.045), from_above(0.045)),
    "sdh2_fingers pinch_narrow": (box((0.03, 0.06, 0.1)), from_side(0.05)),
}


@pytest.mark.parametrize("case", HELD)
def test_each_type_holds_what_it_is_for(case):
    obj, T = HELD[case]
    name, grasp_type = case.split()
    assert outcome(shipped(name), grasp_type, obj, T) == "success"


def test_what_is_too_wide_for_a_pinch_takes_three_fingers():
    """A can of 120 mm, wider than the pinch and the three tips open."""
    hand, wide = shipped("sdh2_fingers"), can(0.06, 0.1, 0.4)
    T = grasp((0, -0.01, 0.05), (0, 1, 0), (1, 0, 0))
    assert {outcome(hand, name, wide, T) for name in ("pinch_narrow", "pinch_wide", "cylinder_tip")} == {"collision"}
    assert outcome(hand, "cylinder_power", wide, T) == "success"


@pytest.mark.parametrize("path", DESCRIPTIONS, ids=lambda path: path.stem)
def test_public_descriptions_are_short(path):
    assert len(path.read_text().splitlines()) <= 15


@pytest.mark.parametrize("name", ["dex_panda", "robotiq_2f140_ri", "robotiq_3f", "barrett"])
def test_public_hands_hold_something(name):
    """A URDF as it comes, nothing edited. All ten, with their rates: tests/endurance/public_hands.py."""
    hand = load_hand(public(Path(__file__).parent / f"descriptions/{name}.yaml"))
    widest = max(hand.preshapes, key=lambda name: hand.preshapes[name].opening)
    assert outcome(hand, widest, can(0.025, mass=0.1), from_side(0.05)) == "success"
