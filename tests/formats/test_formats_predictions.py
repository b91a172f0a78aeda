"""One asymmetric grasp through every format and back; its numbers are worked out in `asymmetric`."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from asymmetric import BASE_W, BASE_XYZ, EXACT, GRIPPERS, T_BASE_TCP, T_INPUT_BASE, T_INPUT_TCP, WAITING, asymmetric

from spgf_torch.formats.graspnet import joints_path, read_graspnet, read_row_joints, write_graspnet
from spgf_torch.formats.grasps_json import read_grasps, write_grasps
from spgf_torch.formats.isaac import read_isaac, write_isaac

OPEN = {"left": 0.04, "right": 0.04, "thumb": -1.5, "shadow": 0.1}
CLOSED = {"left": 0.0, "right": 0.0, "thumb": -1.5, "shadow": 0.1}


def driven(joints: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in joints.items() if name != "shadow"}


def test_the_grasp_itself() -> None:
    grasp = asymmetric()
    np.testing.assert_allclose(grasp.T_input_tcp, T_INPUT_TCP, atol=EXACT)
    np.testing.assert_allclose(grasp.T_input_base, T_INPUT_BASE, atol=EXACT)
    np.testing.assert_allclose(grasp.T_input_pregrasp[:3, 3], WAITING, atol=EXACT)
    np.testing.assert_allclose(grasp.T_input_pregrasp[:3, :3], grasp.T_input_tcp[:3, :3])
    assert grasp.voted_by == [(7, 30), (3, 12)]  # most votes first


def test_grasps_json(tmp_path: Path) -> None:
    path = tmp_path / "grasps.json"
    write_grasps(path, [asymmetric(), asymmetric("NPG", 0.25)], GRIPPERS)
    first, second = read_grasps(path)
    np.testing.assert_allclose(first.T_input_tcp, T_INPUT_TCP, atol=EXACT)
    np.testing.assert_allclose(first.T_input_base, T_INPUT_BASE, atol=EXACT)
    np.testing.assert_allclose(first.T_input_pregrasp[:3, 3], WAITING, atol=EXACT)
    assert (first.type, first.probability, first.support) == ("WPG", 0.875, 42)
    assert first.joints == OPEN and first.closed == CLOSED and first.voted_by == [(7, 30), (3, 12)]
    assert (second.type, second.probability, second.joints["left"]) == ("NPG", 0.25, 0.02)
    assert np.array_equal(first.T_input_tcp, asymmetric().T_input_tcp)  # to the last bit


def test_grasps_json_has_the_keys_of_the_contract(tmp_path: Path) -> None:
    path = tmp_path / "grasps.json"
    write_grasps(path, [asymmetric()], GRIPPERS)
    known = json.loads(path.read_text())
    assert known["schema"] == 1 and known["frame"] == "input"
    contract = {"type", "probability", "support", "T_input_tcp", "T_input_base", "joints", "voted_by"}
    assert contract <= set(known["grasps"][0])
    assert known["grasps"][0]["voted_by"][0] == {"prototype": 7, "votes": 30}


def test_isaac(tmp_path: Path) -> None:
    path = tmp_path / "grasps.yaml"
    write_isaac(path, [asymmetric(), asymmetric("NPG", 0.25)], GRIPPERS, object_frame="camera")
    known = read_isaac(path)
    assert (known.object_frame_link, known.gripper_frame_link) == ("camera", "palm")
    first, second = known.grasps
    assert (first.name, second.name) == ("grasp_0", "grasp_1")
    assert (first.confidence, second.confidence) == (0.875, 0.25)
    np.testing.assert_allclose(first.T_object_gripper, T_INPUT_BASE, atol=EXACT)
    np.testing.assert_allclose(first.T_object_gripper @ T_BASE_TCP, T_INPUT_TCP, atol=EXACT)
    assert first.cspace == driven(CLOSED) and first.pregrasp_cspace == driven(OPEN)
    assert second.pregrasp_cspace["left"] == 0.02 and second.cspace["left"] == 0


def test_isaac_says_w_and_xyz(tmp_path: Path) -> None:
    """Exchanged, (0.966; 0, 0.259, 0) would read (0; 0.966, 0, 0.259): another rotation, of 180 deg."""
    path = tmp_path / "grasps.yaml"
    write_isaac(path, [asymmetric()], GRIPPERS)
    known = yaml.safe_load(path.read_text())
    assert known["format"] == "isaac_grasp" and known["format_version"] == 1.0
    assert isinstance(known["format_version"], float)
    orientation = known["grasps"]["grasp_0"]["orientation"]
    assert orientation["w"] == pytest.approx(BASE_W, abs=EXACT)
    assert orientation["xyz"] == pytest.approx(BASE_XYZ, abs=EXACT)


@pytest.mark.parametrize("turn", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1)])
def test_isaac_reads_w_and_xyz(turn: tuple[int, ...], tmp_path: Path) -> None:
    """No rotation, and half turns about x and about z: (w; x, y, z), as diagonals of +1 where the axis stays."""
    w, *xyz = turn
    path = tmp_path / "grasps.yaml"
    path.write_text(
        "format: isaac_grasp\nformat_version: 1.0\nobject_frame_link: /World/mug\ngripper_frame_link: panda_hand\n"
        f"grasps:\n  grasp_0:\n    confidence: 1.0\n    position: [1, 2, 3]\n    orientation: {{w: {w}, xyz: {xyz}}}\n"
        "    cspace_position: {finger: 0.01}\n    pregrasp_cspace_position: {finger: 0.04}\n"
    )
    (grasp,) = read_isaac(path).grasps
    stays = {(1, 0, 0, 0): (1, 1, 1), (0, 1, 0, 0): (1, -1, -1), (0, 0, 0, 1): (-1, -1, 1)}[turn]
    np.testing.assert_allclose(grasp.T_object_gripper[:3, :3], np.diag(stays), atol=1e-12)
    assert grasp.T_object_gripper[:3, 3].tolist() == [1, 2, 3] and grasp.pregrasp_cspace == {"finger": 0.04}


def test_graspnet(tmp_path: Path) -> None:
    path = tmp_path / "grasps.npy"
    write_graspnet(path, [asymmetric(), asymmetric("NPG", 0.25)], GRIPPERS)
    first, second = read_graspnet(path)
    np.testing.assert_allclose(first.T_input_tcp, T_INPUT_TCP, atol=EXACT)
    assert (first.score, first.width, first.height, first.depth, first.object_id) == (0.875, 0.08, 0.02, 0.015, -1)
    assert (second.score, second.width) == (0.25, 0.04)
    hands = read_row_joints(joints_path(path))
    assert [hand.gripper for hand in hands] == ["claw_WPG", "claw_NPG"]
    assert hands[0].joints == OPEN and hands[0].closed == CLOSED and hands[1].joints["left"] == 0.02


def test_graspnet_columns(tmp_path: Path) -> None:
    """x is the approach (0.5, 0, c), y the closing (0, 1, 0), z = x cross y = (-c, 0, 0.5), as columns.

    Row by row: (0.5, 0, -c), (0, 1, 0), (c, 0, 0.5). The fingertips, `depth` along x from the translation, lie 15 mm
    beyond the TCP: (0.1, 0.2, 0.3) + 0.015 (0.5, 0, c) = (0.1075, 0.2, 0.3129904).
    """
    path, c = tmp_path / "grasps.npy", 0.8660254
    write_graspnet(path, [asymmetric()], GRIPPERS)
    rows = np.load(path, allow_pickle=False)
    assert rows.shape == (1, 17) and rows.dtype == np.float64
    expected = [0.875, 0.08, 0.02, 0.015, 0.5, 0, -c, 0, 1, 0, c, 0, 0.5, 0.1, 0.2, 0.3, -1]
    np.testing.assert_allclose(rows[0], expected, atol=EXACT)
    tip = rows[0, 13:16] + rows[0, 3] * rows[0, 4:13].reshape(3, 3)[:, 0]
    np.testing.assert_allclose(tip, [0.1075, 0.2, 0.3129904], atol=EXACT)


def test_no_grasps_are_a_file_too(tmp_path: Path) -> None:
    write_grasps(tmp_path / "none.json", [], GRIPPERS)
    write_isaac(tmp_path / "none.yaml", [], GRIPPERS)
    write_graspnet(tmp_path / "none.npy", [], GRIPPERS)
    assert read_grasps(tmp_path / "none.json") == []
    assert read_isaac(tmp_path / "none.yaml").grasps == []
    assert read_graspnet(tmp_path / "none.npy") == [] and read_row_joints(tmp_path / "none.joints.json") == []
