"""One asymmetric grasp as moveit_msgs/Grasp and in a PoseArray; its numbers are worked out in `asymmetric`."""

import json
from pathlib import Path

import numpy as np
import pytest
from asymmetric import BASE_W, BASE_XYZ, EXACT, GRIPPERS, T_INPUT_BASE, T_INPUT_TCP, WAITING, asymmetric
from definitions import differences

from spgf_torch.errors import InputError
from spgf_torch.ros.grasps import grasp_message, pose_array, read_grasp, read_poses, write_moveit
from spgf_torch.ros.messages import Header

HEADER = Header("camera", 3, 4)
OPEN, CLOSED = {"left": 0.04, "right": 0.04, "thumb": -1.5}, {"left": 0.0, "right": 0.0, "thumb": -1.5}
# A quarter turn about the base's z, 0.1 m along its x: where a flange is under a hand that is screwed on turned.
T_BASE_PARENT = np.array([[0, -1.0, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_a_grasp_for_moveit() -> None:
    values = grasp_message(asymmetric(), GRIPPERS["WPG"], HEADER)
    assert differences(values, "moveit_msgs/Grasp") == []
    pose = values["grasp_pose"]
    assert pose["header"] == {"stamp": {"sec": 3, "nanosec": 4}, "frame_id": "camera"}
    assert list(pose["pose"]["position"].values()) == pytest.approx(T_INPUT_BASE[:3, 3].tolist(), abs=EXACT)
    x, y, z, w = pose["pose"]["orientation"].values()
    assert [w, x, y, z] == pytest.approx([BASE_W, *BASE_XYZ], abs=EXACT)
    assert values["grasp_quality"] == 0.875 and values["max_contact_force"] == 0
    approach, lift = values["pre_grasp_approach"], values["post_grasp_retreat"]
    assert list(approach["direction"]["vector"].values()) == pytest.approx([0.5, 0, 0.8660254], abs=EXACT)
    assert approach["desired_distance"] == approach["min_distance"] == pytest.approx(0.06)
    assert list(lift["direction"]["vector"].values()) == pytest.approx([-0.5, 0, -0.8660254], abs=EXACT)


def test_the_lift_goes_up_where_up_is_known() -> None:
    values = grasp_message(asymmetric(), GRIPPERS["WPG"], HEADER, up=(0, 0, -2))
    assert values["post_grasp_retreat"]["direction"]["vector"] == {"x": 0, "y": 0, "z": -1}
    assert values["post_place_retreat"]["direction"]["vector"]["x"] == pytest.approx(-0.5)


def test_the_pose_is_that_of_the_parent_link() -> None:
    """The base is turned by 30 deg about y, so its x is (c, 0, -s): 0.1 m along it from the base's origin."""
    values = grasp_message(asymmetric(), GRIPPERS["WPG"], HEADER, T_base_parent=T_BASE_PARENT)
    known = read_grasp(values)
    np.testing.assert_allclose(known.T_frame_parent[:3, 3], [0.0692820, 0.2, 0.0867949], atol=EXACT)
    np.testing.assert_allclose(known.T_frame_parent[:3, 0], [0, 1, 0], atol=EXACT)  # the base's y


def test_a_grasp_there_and_back() -> None:
    known = read_grasp(json.loads(json.dumps(grasp_message(asymmetric(), GRIPPERS["WPG"], HEADER, "best"))))
    assert (known.id, known.quality, known.header, known.approach_frame) == ("best", 0.875, HEADER, "camera")
    np.testing.assert_allclose(known.T_frame_parent, T_INPUT_BASE, atol=EXACT)
    assert known.opened == OPEN and known.closed == CLOSED
    np.testing.assert_allclose(known.approach, T_INPUT_TCP[:3, 2], atol=EXACT)
    assert known.distance == pytest.approx(0.06)


@pytest.mark.parametrize("axis", range(3))
def test_quaternions_are_read_x_y_z_w(axis: int) -> None:
    """A half turn about an axis leaves that axis alone."""
    turn = dict(zip("xyzw", [0, 0, 0, 0.0], strict=True)) | {"xyz"[axis]: 1}
    pose = {"position": {"x": 1, "y": 2, "z": 3}, "orientation": turn}
    poses, header = read_poses({"header": HEADER.plain(), "poses": [pose]})
    assert header == HEADER and poses[0, :3, 3].tolist() == [1, 2, 3]
    np.testing.assert_allclose(poses[0, :3, :3].diagonal(), [1 if i == axis else -1 for i in range(3)], atol=EXACT)


def test_an_array_of_poses() -> None:
    grasps = [asymmetric(), asymmetric("NPG")]
    values = pose_array(grasps, HEADER)
    assert differences(values, "geometry_msgs/PoseArray") == []
    np.testing.assert_allclose(read_poses(values)[0], [T_INPUT_TCP] * 2, atol=EXACT)
    np.testing.assert_allclose(read_poses(pose_array(grasps, HEADER, "base"))[0][1], T_INPUT_BASE, atol=EXACT)
    np.testing.assert_allclose(read_poses(pose_array(grasps, HEADER, "pregrasp"))[0][0, :3, 3], WAITING, atol=EXACT)
    assert read_poses(pose_array([], HEADER))[0].shape == (0, 4, 4)
    with pytest.raises(InputError, match="which: expected one of tcp, base, pregrasp"):
        pose_array(grasps, HEADER, "palm")


def test_a_file_for_moveit(tmp_path: Path) -> None:
    path = tmp_path / "moveit_grasps.json"
    write_moveit(path, [asymmetric(), asymmetric("NPG", 0.25)], GRIPPERS)
    first, second = map(read_grasp, json.loads(path.read_text())["grasps"])
    assert (first.id, second.id, second.quality, second.opened["left"]) == ("grasp_0", "grasp_1", 0.25, 0.02)
    assert first.header.frame == "input"
    write_moveit(path, [], GRIPPERS)
    assert json.loads(path.read_text()) == {"grasps": []}


def test_grasps_that_cannot_be_used() -> None:
    values = grasp_message(asymmetric(), GRIPPERS["WPG"], HEADER)
    with pytest.raises(InputError, match="frame: expected the name"):
        grasp_message(asymmetric(), GRIPPERS["WPG"], Header(""))
    with pytest.raises(InputError, match="quaternion of length 1, got 2"):
        values["grasp_pose"]["pose"]["orientation"] = {"x": 2.0, "y": 0.0, "z": 0.0, "w": 0.0}
        read_grasp(values)
    with pytest.raises(InputError, match="grasp_quality"):
        read_grasp({key: value for key, value in values.items() if key != "grasp_quality"})
    with pytest.raises(InputError, match="expected 2 numbers, got 1"):
        posture = {"header": HEADER.plain(), "joint_names": ["a", "b"], "points": [{"positions": [0.1]}]}
        read_grasp(grasp_message(asymmetric(), GRIPPERS["WPG"], HEADER) | {"pre_grasp_posture": posture})
