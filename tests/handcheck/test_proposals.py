"""Descriptions that are proposed for bare URDFs: of shipped hands, without their descriptions, and of public ones."""

from pathlib import Path

import numpy as np
import pytest
from commands import ROOT

from spgf_torch.errors import InputError
from spgf_torch.handcheck.check import check_hand
from spgf_torch.handcheck.finding import failed
from spgf_torch.handcheck.proposal import Proposal, propose
from spgf_torch.handcheck.proposal_text import proposal_text
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.description_file import read_description

SHARED = ROOT.parent / "shared/hands"


@pytest.fixture(scope="module")
def proposals() -> dict[str, Proposal]:
    """Of URDFs that come with the package."""
    names = ("panda", "sdh2", "robotiq_2f", "so101")
    return {name: propose(HandConfig(name=name, urdf=str(ROOT / f"data/hands/{name}.urdf"))) for name in names}


@pytest.mark.parametrize("name", ["panda", "sdh2", "robotiq_2f", "so101"])
def test_the_proposal_for_a_shipped_urdf_passes_every_check(name: str, proposals: dict[str, Proposal]) -> None:
    hand = proposals[name].hand
    assert hand is not None, proposals[name].error
    assert [finding.line() for finding in failed(check_hand(hand))] == []
    assert sorted(hand.preshapes) == ["narrow", "wide"]


def test_two_jaws_that_slide(proposals: dict[str, Proposal]) -> None:
    """The Panda opens by 80 mm along y, with a finger joint that falls, which the other one follows by its <mimic>."""
    config = proposals["panda"].config
    wide, narrow = config.preshapes["wide"], config.preshapes["narrow"]
    assert config.approach == [0, 0, 1]
    assert config.fingers == {"panda_leftfinger": ["panda_leftfinger"], "panda_rightfinger": ["panda_rightfinger"]}
    assert wide.opening == pytest.approx(0.08, abs=0.0011) and narrow.opening == pytest.approx(0.04, abs=0.0011)
    assert wide.close == {"panda_finger_joint1": -1}
    assert wide.oppose == [["panda_leftfinger"], ["panda_rightfinger"]]
    assert config.closing.effort == 50  # N at a pad, less than three quarters of 70


def test_two_fingers_against_a_thumb(proposals: dict[str, Proposal]) -> None:
    """The SDH-2 with knuckles at 0; flexion grows, fingers press half as hard, they open to 0.6 of their reach."""
    config = proposals["sdh2"].config
    wide = config.preshapes["wide"]
    assert wide.oppose == [["finger_1_tip", "finger_2_tip"], ["thumb_tip"]]
    assert wide.hold == {"finger_1_knuckle_joint": 0, "finger_2_knuckle_joint": 0}
    assert wide.close["thumb_proximal_joint"] == 1 and wide.close["finger_1_proximal_joint"] == 0.5
    assert 0 < wide.close["finger_1_distal_joint"] < wide.close["thumb_distal_joint"] < 0.5
    assert -60 < wide.open["thumb_proximal_joint"] < -45  # the cosine of 53 deg is 0.6
    assert config.preshapes["narrow"].open["thumb_proximal_joint"] == pytest.approx(
        wide.open["thumb_proximal_joint"] / 2, abs=1
    )
    for pad in wide.pads.values():  # the face is 14.8 mm before the distal joint's axis
        assert pad[0] == pytest.approx(0.0148, abs=1e-4) and abs(pad[1]) < 0.012


def test_parts_of_a_linkage_are_no_fingers_and_one_jaw_closes_on_the_palm(proposals: dict[str, Proposal]) -> None:
    assert len(proposals["robotiq_2f"].config.fingers) == 2
    single = proposals["so101"]
    assert len(single.config.fingers) == 2 and "palm" in single.config.fingers
    assert single.config.preshapes["wide"].oppose[1] == ["palm"]
    assert any("one finger moves" in words for words in single.doubts["fingers"])


@pytest.mark.parametrize("name", ["panda", "sdh2", "so101"])
def test_what_is_written_is_what_was_proposed(name: str, proposals: dict[str, Proposal], tmp_path: Path) -> None:
    words = proposal_text(proposals[name])
    (tmp_path / "written.yaml").write_text(words)
    assert read_description(tmp_path / "written.yaml") == proposals[name].config
    assert all(len(line) <= 120 for line in words.splitlines() if "# ?" not in line and "urdf:" not in line)
    doubts = [line for line in words.splitlines() if line.lstrip().startswith("# ?")]
    assert len(doubts) >= sum(map(len, proposals[name].doubts.values()))


def arm(joints: int, fingers: str) -> str:
    """A row of joints, each 0.1 m on; at its end a wrist with what is fixed to it, and fingers."""
    links = "".join(f'<link name="l{i}"/>' for i in range(joints + 1))
    row = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><limit lower="-1" upper="1"/>'
        "</joint>"
        for i in range(joints)
    )
    flange = f'<joint name="f" type="fixed"><parent link="l{joints}"/><child link="flange"/></joint>'
    moving = "".join(
        f'<link name="{name}"/><joint name="{name}_joint" type="prismatic"><parent link="flange"/>'
        f'<child link="{name}"/><limit lower="0" upper="0.04"/></joint>'
        for name in fingers.split()
    )
    return f'<robot name="arm">{links}{row}<link name="flange"/>{flange}{moving}</robot>'


@pytest.mark.parametrize(("joints", "fingers", "count"), [(4, "a b", 4), (4, "a", 4), (3, "a b c", 3)])
def test_an_arm_is_told_with_the_link_at_its_end(joints: int, fingers: str, count: int, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(arm(joints, fingers))
    with pytest.raises(InputError) as error:
        propose(HandConfig(name="arm", urdf=str(tmp_path / "arm.urdf")))
    told = f"expected a hand, got {count} joints in a row, as of an arm; root=l{joints} takes what is at its end"
    assert told in str(error.value) and str(error.value).endswith("; fixed to that: flange")


@pytest.mark.parametrize(("joints", "told"), [(0, "with collision shapes"), (2, "with collision shapes")])
def test_a_wrist_is_no_arm(joints: int, told: str, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(arm(joints, "a b"))
    with pytest.raises(InputError, match=told):
        propose(HandConfig(name="arm", urdf=str(tmp_path / "arm.urdf")))


@pytest.mark.skipif(not SHARED.is_dir(), reason="no shared hands")
@pytest.mark.parametrize(("name", "opening"), [("franka_hand", 0.08), ("dex_panda", 0.08)])
def test_public_urdfs_as_they_come(name: str, opening: float) -> None:
    proposal = propose(HandConfig(name=name, urdf=str(SHARED / name / f"{name}.urdf")))
    assert proposal.hand is not None, proposal.error
    assert [finding.line() for finding in failed(check_hand(proposal.hand))] == []
    assert proposal.config.preshapes["wide"].opening == pytest.approx(opening, abs=0.0015)
    np.testing.assert_array_equal(proposal.config.approach, [0, 0, 1])


@pytest.mark.skipif(not SHARED.is_dir(), reason="no shared hands")
def test_a_whole_arm_as_it_comes() -> None:
    with pytest.raises(InputError, match="got 5 joints in a row, as of an arm; root=gripper_link takes"):
        propose(HandConfig(name="so101", urdf=str(SHARED / "so101/so101.urdf")))
