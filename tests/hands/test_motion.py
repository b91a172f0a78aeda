"""What moves and how, measured or told, on clamps whose numbers can be worked out by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
from clamps import clamp, described, joint, link, robot

from spgf_torch.errors import InputError
from spgf_torch.hands.hand import closing_poses, load_hand


def test_directions_and_pads_are_measured(tmp_path: Path) -> None:
    """Faces at x = -+value: joints close as they fall; the faces meet over all their height, 80 mm from the palm's
    middle (0.05 + 0.02 to the boxes' middle), and 60 mm apart each stands at 30 mm."""
    wide = load_hand(described(tmp_path, clamp())).preshapes["wide"]
    assert wide.closing.phases == ({"left_joint": -1.0, "right_joint": -1.0},)
    assert wide.joints == pytest.approx({"left_joint": 0.03, "right_joint": 0.03})
    assert wide.closed == pytest.approx({"left_joint": 0.0, "right_joint": 0.0}, abs=1e-9)
    np.testing.assert_allclose(wide.T_base_tcp[:3, 3], [0, 0, 0.07], atol=2e-3)
    np.testing.assert_allclose(wide.T_base_tcp[:3, 0], [1, 0, 0], atol=1e-9)
    assert (wide.opening, wide.symmetry, wide.jaw, wide.touch) == (0.06, 2, True, 2)


def test_joints_of_opposite_signs_and_limits(tmp_path: Path) -> None:
    """The left joint opens from 0 to -0.05 along +x, the right one from 0.01 to 0.06: each as far on its way."""
    wide = load_hand(described(tmp_path, clamp("1 0 0", "1 0 0", ("-0.05 0", "0.01 0.06")))).preshapes["wide"]
    assert wide.closing.phases == ({"left_joint": 1.0, "right_joint": -1.0},)
    # Faces at left and right: right - left = 0.06 with right = 0.01 - left.
    assert wide.joints == pytest.approx({"left_joint": -0.025, "right_joint": 0.035})


def test_a_mimic_joint_follows_with_ratio_and_offset(tmp_path: Path) -> None:
    """right = 0.5 left + 0.004: faces 1.5 left + 0.004 apart, 60 mm at left = 0.0373333."""
    urdf = robot(
        link("left", "0.01 0.02 0.06", "-0.005 0 0.02"),
        link("right", "0.01 0.02 0.06", "0.005 0 0.02"),
        joint("left_joint", "left", axis="-1 0 0"),
        joint("right_joint", "right", mimic="left_joint 0.5 0.004"),
    )
    wide = load_hand(described(tmp_path, urdf)).preshapes["wide"]
    assert wide.closing.phases == ({"left_joint": -1.0},)
    left = (0.06 - 0.004) / 1.5
    assert wide.joints == pytest.approx({"left_joint": left, "right_joint": 0.5 * left + 0.004})
    assert wide.T_base_tcp[0, 3] == pytest.approx((0.5 * left + 0.004 - left) / 2)
    assert wide.closed["right_joint"] == pytest.approx(0.004)  # left at its limit, the faces 4 mm apart


def test_another_mimic_is_another_hand(tmp_path: Path) -> None:
    """The rules of followers are no part of the XML that SAPIEN reads; where no joint follows, they do not matter."""
    fingers = link("left", "0.01 0.02 0.06", "-0.005 0 0.02"), link("right", "0.01 0.02 0.06", "0.005 0 0.02")
    driver = joint("left_joint", "left", axis="-1 0 0")
    digests, both = [], {"wide": {"opening": 0.06, "close": {"left_joint": -1, "right_joint": -1}}}
    for keys in ({}, {"preshapes": both}):
        for rule in ("left_joint 1 0", "left_joint 0.9 0"):
            urdf = robot(*fingers, driver, joint("right_joint", "right", mimic=rule))
            digests.append(load_hand(described(tmp_path, urdf, **keys)).digest)
    assert digests[0] != digests[1] and digests[2] == digests[3]


def test_one_moving_jaw(tmp_path: Path) -> None:
    """The palm's own block is one finger: only the right one moves, and half a turn makes another hand."""
    urdf = robot(
        link("fixed", "0.01 0.02 0.06", "-0.005 0 0.02"),
        link("right", "0.01 0.02 0.06", "0.005 0 0.02"),
        joint("mount", "fixed", kind="fixed"),
        joint("right_joint", "right", limit="0 0.08"),
    )
    config = described(tmp_path, urdf, fingers={"moving": ["right"], "still": ["fixed"]})
    wide = load_hand(config).preshapes["wide"]
    assert wide.joints == pytest.approx({"right_joint": 0.06})
    assert (wide.symmetry, wide.jaw) == (1, True)
    np.testing.assert_allclose(wide.T_base_tcp[:2, 3], [0.03, 0], atol=1e-3)
    np.testing.assert_allclose(wide.T_base_tcp[:3, 0], [-1, 0, 0], atol=1e-9)  # from the first finger to the second


def test_three_fingers_close_until_two_meet(tmp_path: Path) -> None:
    """Three boxes slide to the middle: two along x side by side against one; the approach is the settings'."""
    urdf = robot(
        link("a", "0.01 0.02 0.06", "-0.005 0.02 0.02"),
        link("b", "0.01 0.02 0.06", "-0.005 -0.02 0.02"),
        link("thumb", "0.01 0.06 0.06", "0.005 0 0.02"),
        *(joint(f"{name}_joint", name, axis="-1 0 0", limit="0 0.04") for name in ("a", "b")),
        joint("thumb_joint", "thumb", limit="-0.01 0.05"),
    )
    config = described(
        tmp_path,
        urdf,
        fingers={name: [name] for name in ("a", "b", "thumb")},
        preshapes={
            "power": {
                "open": {"a_joint": 0.03, "b_joint": 0.03, "thumb_joint": 0.05},
                "close": {"a_joint": -0.5, "b_joint": -0.5, "thumb_joint": -1},
                "oppose": [["a", "b"], ["thumb"]],
                "pads": {"a": [0, 0.02, 0.02], "b": [0, -0.02, 0.02], "thumb": [0, 0, 0.03]},
                "tcp": {"xyz": [0.01, 0, 0.06], "closing": [1, 0, 0]},
                "touch": 1,
            }
        },
    )
    power = load_hand(config).preshapes["power"]
    assert power.groups == (("a", "b"), ("thumb",)) and power.touch == 1 and not power.jaw and power.symmetry == 1
    np.testing.assert_allclose(power.T_base_tcp[:3, 3], [0.01, 0, 0.06])
    assert power.opening == pytest.approx(0.08)
    # a and b go 30 mm to 0, the thumb 60 mm to -10: equal shares of the ways, so they meet after 80 of 90 mm.
    assert power.closed["thumb_joint"] == pytest.approx(0.05 - 0.06 * 8 / 9, abs=2e-4)
    assert power.closed["a_joint"] == pytest.approx(0.03 - 0.03 * 8 / 9, abs=2e-4)


def test_phases_close_one_after_the_other(tmp_path: Path) -> None:
    config = described(
        tmp_path, clamp(), preshapes={"wide": {"opening": 0.06, "phases": [{"left_joint": -1}, {"right_joint": -1}]}}
    )
    wide = load_hand(config).preshapes["wide"]
    assert wide.closing.phases == ({"left_joint": -1.0}, {"right_joint": -1.0})


def test_parallel_joints_keep_the_pads_upright(tmp_path: Path) -> None:
    """A distal joint about the mirrored axis turns with its proximal one, about the same axis against it."""
    arms = [
        link("arm", "0.01 0.02 0.04", "0 0 0.02"),
        link("left", "0.01 0.02 0.04", "0 0 0.02"),
        link("right", "0.01 0.02 0.08", "0 0 0.04"),
    ]
    limits = {"limit": "-1 1"}
    for axis, ratio in (("0 1 0", -1.0), ("0 -1 0", 1.0)):
        urdf = robot(
            *arms,
            joint("near", "arm", "revolute", at="-0.03 0 0.05", axis="0 1 0", **limits),
            joint("far", "left", "revolute", "arm", "0 0 0.04", axis=axis, **limits),
            joint("right_joint", "right", at="0.005 0 0.05"),
        )
        told = {
            "opening": 0.05,
            "parallel": {"far": "near"},
            "pads": {"left": [0.005, 0, 0.02], "right": [-0.005, 0, 0.06]},
        }
        wide = load_hand(described(tmp_path, urdf, preshapes={"wide": told})).preshapes["wide"]
        assert wide.closing.follow["far"].ratio == ratio
        np.testing.assert_allclose(wide.T_base_link["left"][:3, :3], np.eye(3), atol=1e-12)


def test_closing_poses_begin_open_and_end_closed(tmp_path: Path) -> None:
    hand = load_hand(described(tmp_path, clamp()))
    poses = closing_poses(hand, "wide", np.array([0.0, 0.5, 1.0]))
    assert poses.shape == (3, 3, 4, 4)
    np.testing.assert_allclose(poses[0], np.broadcast_to(np.eye(4), (3, 4, 4)), atol=1e-12)
    moved = {link: poses[1:, k, 0, 3] for k, link in enumerate(hand.preshapes["wide"].shape_links)}
    np.testing.assert_allclose(moved["left"], [0.015, 0.03], atol=1e-9)
    np.testing.assert_allclose(moved["right"], [-0.015, -0.03], atol=1e-9)
    np.testing.assert_allclose(moved["palm"], [0, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("preshape", "message"),
    [
        ({"opening": 0.2}, r"wide.opening: expected 0.000 to 0.100 m, got 0.2"),
        (
            {"opening": 0.05, "close": {"left_jont": 1}},
            "expected a joint that moves, got left_jont; did you mean left_joint?",
        ),
        (
            {"opening": 0.05, "close": {"left_joint": 0}},
            "close.left_joint: expected a share from -1 to 1, not 0, got 0",
        ),
        (
            {"opening": 0.05, "close": {"left_joint": 1}, "phases": [{"left_joint": 1}]},
            "expected close or phases, got both",
        ),
        (
            {"opening": 0.05, "hold": {"left_joint": 0}, "close": {"left_joint": 1}},
            "do not stand in hold, got left_joint",
        ),
        ({"opening": 0.05, "oppose": [["left"]]}, "oppose: expected two or more groups"),
        ({"opening": 0.05, "oppose": [["left"], ["middle"]]}, "oppose: expected a finger, got middle"),
        ({"opening": 0.05, "touch": 3, "oppose": [["left"], ["right"]]}, "touch: expected a number of groups up to 2"),
        ({"opening": 0.05, "open": {"left_joint": 0.01}}, "expected opening or open, got both"),
        ({"opening": 0.05, "pads": {"left": [0, 0]}}, "pads.left: expected three numbers"),
        ({"opening": 0.05, "tcp": {"closing": [0, 0, 1]}}, "tcp.closing: expected a direction across the approach"),
        ({"open": {"left_joint": 0.06}}, "open.left_joint: expected 0 to 0.05 m, its limits; got 0.06"),
        (
            {"opening": 0.05, "parallel": {"left_joint": {"of": "right_joint", "rato": 1}}},
            "expected of, ratio and offset",
        ),
    ],
)
def test_wrong_preshapes_are_told_in_one_line(tmp_path: Path, preshape: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_hand(described(tmp_path, clamp(), preshapes={"wide": preshape}))


@pytest.mark.parametrize("name", ["CG", "a b", "../x", ""])
def test_names_that_files_and_columns_cannot_have(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"hand\.preshapes: expected names of letters, digits, _ and -, not CG"):
        load_hand(described(tmp_path, clamp(), preshapes={name: {"opening": 0.05}}))


def test_drives_from_the_urdf(tmp_path: Path) -> None:
    """40 N of the joints, of which three quarters press; 30 mm in 0.8 s are less than the URDF's 0.1 m/s; the drive
    gives 30 N after 40 ms at that speed."""
    wide = load_hand(described(tmp_path, clamp())).preshapes["wide"]
    closing, drive = wide.closing, wide.drives["left_joint"]
    assert closing.effort == pytest.approx(30.0)
    assert closing.speed == pytest.approx(0.03 / 0.8)
    assert closing.time == pytest.approx(1.1)
    assert drive.effort == 40
    assert drive.stiffness == pytest.approx(30 / (0.04 * 0.03 / 0.8))
    assert drive.damping == pytest.approx(0.01 * drive.stiffness)


def test_what_the_description_says_of_a_joint_is_taken(tmp_path: Path) -> None:
    """Damping goes by the share, so that a weak finger is not late."""
    config = described(
        tmp_path,
        clamp(),
        joints={"left_joint": {"effort": 35, "stiffness": 900, "damping": 20}},
        preshapes={"wide": {"opening": 0.06, "close": {"left_joint": -0.5, "right_joint": -1}}},
        closing={"effort": 24, "speed": 0.02, "time": 3},
    )
    wide = load_hand(config).preshapes["wide"]
    left = wide.drives["left_joint"]
    assert (left.effort, left.stiffness, left.damping) == (35, 900, 10)
    assert (wide.closing.effort, wide.closing.speed, wide.closing.time) == (24, 0.02, 3)
    assert math.isclose(wide.drives["right_joint"].stiffness, 24 / (0.04 * 0.02))
