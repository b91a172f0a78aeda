"""moveit_msgs/Grasp and geometry_msgs/PoseArray to and from grasps; `moveit_grasps.json`, which holds the former."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.checks import TOLERANCE, number, rigid_of
from spgf_torch.files.writing import write_text
from spgf_torch.hands.records import Grasp, Gripper, gripper_for
from spgf_torch.ros.messages import Header, numbers, part, parts, plain_pose, plain_xyz, pose, xyz

# Which pose of a grasp a PoseArray holds.
POSES = {"tcp": "T_input_tcp", "base": "T_input_base", "pregrasp": "T_input_pregrasp"}
_WHAT = "Grasp"


@dataclass(frozen=True)
class MoveItGrasp:
    """A moveit_msgs/Grasp as the message has it.

    Attributes:
        id: its name. quality: of any scale. header: frame of the pose.
        T_frame_parent: (4, 4) float64 pose of the link that the end-effector hangs on.
        opened, closed: joint -> rad or m of the last point of the posture before and at the grasp.
        approach: (3,) unit vector in `approach_frame` in which the hand moves towards the object.
        distance: m of the approach.
    """

    id: str
    quality: float
    header: Header
    T_frame_parent: np.ndarray
    opened: dict[str, float]
    closed: dict[str, float]
    approach: np.ndarray
    approach_frame: str
    distance: float


def grasp_message(
    grasp: Grasp,
    gripper: Gripper,
    header: Header,
    name: str = "grasp_0",
    T_base_parent: np.ndarray | None = None,
    up: Sequence[float] | None = None,
) -> dict[str, Any]:
    """A moveit_msgs/Grasp as a dictionary.

    The quality is the probability. The hand opens to `joints`, approaches along +z of the TCP for as far as the
    pregrasp pose is away, all of it (min_distance), closes towards `closed`, and retreats as far: along `up`, or back
    along the approach. After placing it goes back along the approach. No contact force is asked for (0: disabled), so
    bound the force of the gripper's controller.

    Args:
        gripper: of the grasp's type. header: frame of the grasp's poses, and when they were sensed.
        T_base_parent: (4, 4) pose of the end-effector's parent link in SRDF, in the hand's base link, which the message
            wants; None: it is the base link.
        up: (3,) against gravity in the header's frame; None: not known.

    Raises:
        InputError: a frame without a name, which MoveIt takes for the object's own.
    """
    if not header.frame:
        raise InputError(
            "frame: expected the name of the frame of the grasps, got an empty one (the object's in MoveIt)"
        )
    parent = np.eye(4) if T_base_parent is None else rigid_of(T_base_parent, "T_base_parent")
    approach = grasp.T_input_tcp[:3, 2]
    distance = float(np.linalg.norm(grasp.T_input_tcp[:3, 3] - grasp.T_input_pregrasp[:3, 3]))
    lift = -approach if up is None else np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    return {
        "id": name,
        "pre_grasp_posture": _posture(grasp.joints, gripper, header),
        "grasp_posture": _posture(grasp.closed, gripper, header),
        "grasp_pose": {"header": header.plain(), "pose": plain_pose(grasp.T_input_base @ parent)},
        "grasp_quality": grasp.probability,
        "pre_grasp_approach": _translation(approach, distance, header),
        "post_grasp_retreat": _translation(lift, distance, header),
        "post_place_retreat": _translation(-approach, distance, header),
        "max_contact_force": 0.0,
        "allowed_touch_objects": [],
    }


def grasp_messages(
    grasps: Sequence[Grasp], grippers: Mapping[str, Gripper], header: Header, **how: Any
) -> list[dict[str, Any]]:
    """A moveit_msgs/Grasp of each grasp, named grasp_0, grasp_1, ... in their order; `how` as for `grasp_message`."""
    return [
        grasp_message(grasp, gripper_for(grasp, grippers), header, f"grasp_{i}", **how)
        for i, grasp in enumerate(grasps)
    ]


def read_grasp(message: Any) -> MoveItGrasp:
    """A moveit_msgs/Grasp of any program.

    Args:
        message: a dictionary with the message's fields, or rclpy's message.

    Raises:
        InputError: a field that is missing, a number that is not finite, a quaternion or a direction of length 0.
    """
    stamped, approach = part(message, "grasp_pose", _WHAT), part(message, "pre_grasp_approach", _WHAT)
    where = f"{_WHAT}.pre_grasp_approach"
    direction = part(approach, "direction", where)
    vector = xyz(direction, "vector", f"{where}.direction")
    length = float(np.linalg.norm(vector))
    if length < TOLERANCE:
        raise InputError(f"{where}.direction: expected a direction, got {vector.tolist()}")
    return MoveItGrasp(
        id=str(part(message, "id", _WHAT)),
        quality=number(part(message, "grasp_quality", _WHAT), f"{_WHAT}.grasp_quality"),
        header=Header.of(stamped, f"{_WHAT}.grasp_pose"),
        T_frame_parent=pose(part(stamped, "pose", f"{_WHAT}.grasp_pose"), f"{_WHAT}.grasp_pose.pose"),
        opened=_joints(message, "pre_grasp_posture"),
        closed=_joints(message, "grasp_posture"),
        approach=vector / length,
        approach_frame=Header.of(direction, f"{where}.direction").frame,
        distance=number(part(approach, "desired_distance", where), f"{where}.desired_distance", 0.0),
    )


def pose_array(grasps: Sequence[Grasp], header: Header, which: str = "tcp") -> dict[str, Any]:
    """A geometry_msgs/PoseArray as a dictionary: the poses `tcp`, `base` or `pregrasp` of grasps, in their order."""
    if which not in POSES:
        raise InputError(f"which: expected one of {', '.join(POSES)}; got {which!r:.40}")
    return {"header": header.plain(), "poses": [plain_pose(getattr(grasp, POSES[which])) for grasp in grasps]}


def read_poses(message: Any) -> tuple[np.ndarray, Header]:
    """(N, 4, 4) float64 poses of a PoseArray, and their frame. Raises InputError for what is no pose."""
    listed = [pose(each, f"PoseArray.poses[{i}]") for i, each in enumerate(parts(message, "poses", "PoseArray"))]
    return np.array(listed).reshape(-1, 4, 4), Header.of(message, "PoseArray")


def write_moveit(path: Path, grasps: Sequence[Grasp], grippers: Mapping[str, Gripper], frame: str = "input") -> None:
    """Write grasps, best first, as `{"grasps": [...]}`: the fields of a moveit_msgs/Grasp, a line each, atomically.

    `frame` is what the headers name; `input` stands for the frame of what was read, whose name no file says.
    """
    lines = [json.dumps(each, allow_nan=False) for each in grasp_messages(grasps, grippers, Header(frame))]
    write_text(path, '{"grasps": [' + ",".join(f"\n{line}" for line in lines) + "\n]}\n")


def _posture(joints: Mapping[str, float], gripper: Gripper, header: Header) -> dict[str, Any]:
    """trajectory_msgs/JointTrajectory of one point: the joints that are driven by themselves."""
    nothing: dict[str, list[float]] = {"velocities": [], "accelerations": [], "effort": []}
    now = {"sec": 0, "nanosec": 0}
    point = {"positions": [joints[name] for name in gripper.active], **nothing, "time_from_start": now}
    return {"header": header.plain(), "joint_names": list(gripper.active), "points": [point]}


def _translation(direction: np.ndarray, distance: float, header: Header) -> dict[str, Any]:
    """moveit_msgs/GripperTranslation: `distance` (m) along a unit vector, all of it."""
    stamped = {"header": header.plain(), "vector": plain_xyz(direction)}
    return {"direction": stamped, "desired_distance": distance, "min_distance": distance}


def _joints(message: Any, key: str) -> dict[str, float]:
    """Joint -> rad or m of the last point of a posture; none of one without points."""
    where = f"{_WHAT}.{key}"
    posture = part(message, key, _WHAT)
    names, points = parts(posture, "joint_names", where), parts(posture, "points", where)
    if not len(points):
        return {}
    at = numbers(points[-1], "positions", len(names), f"{where}.points[{len(points) - 1}]")
    return dict(zip(map(str, names), at.tolist(), strict=True))
