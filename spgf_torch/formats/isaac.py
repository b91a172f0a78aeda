"""Isaac grasp YAML, format version 1.0 (NVIDIA Isaac Sim, Grasp Editor).

`position` (m) and `orientation` (w, and xyz) are the pose of `gripper_frame_link` in `object_frame_link`. For predicted
grasps these are the hand's base link with the axes of its URDF, because that is the frame that Isaac finds under this
name, and the input's frame; for trial tables the exported gripper frame (`trial_sets.gripper_frame`) and the object's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import yaml
from scipy.spatial.transform import Rotation

from spgf_torch.errors import InputError
from spgf_torch.files.checks import TOLERANCE, entry, joint_values, name, number, vector
from spgf_torch.files.reading import yaml_values
from spgf_torch.files.writing import write_text
from spgf_torch.formats.common import DIGITS, rounded, write_splits
from spgf_torch.formats.trial_sets import Grasps, TrialSet, grasps_of
from spgf_torch.geometry import se3
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

if TYPE_CHECKING:
    from spgf_torch.objects.grasp_object import GraspObject

FORMAT, VERSION = "isaac_grasp", 1.0
TIMES = 4  # as much YAML as in other files is read: 60,000 grasps


@dataclass(frozen=True)
class IsaacGrasp:
    """A grasp as the file has it.

    Attributes:
        name: its key. confidence: 0 to 1. T_object_gripper: (4, 4) float64, of the file's gripper in its object frame.
        cspace: active joint -> rad or m, closed. pregrasp_cspace: the same, open.
    """

    name: str
    confidence: float
    T_object_gripper: np.ndarray
    cspace: dict[str, float]
    pregrasp_cspace: dict[str, float]


@dataclass(frozen=True)
class IsaacGrasps:
    """A file: the names of its two frames, and its grasps in their order."""

    object_frame_link: str
    gripper_frame_link: str
    grasps: list[IsaacGrasp]


def write_isaac(
    path: Path, grasps: Sequence[Grasp], grippers: Mapping[str, Gripper], object_frame: str = "input"
) -> None:
    """Write predicted grasps as grasp_0, grasp_1, ... best first.

    `cspace_position` is the closed hand, `pregrasp_cspace_position` the open one of the grasp's type: active joints
    only. All types stand in one file, for each grasp brings its own joints.
    """
    values = {
        "format": FORMAT,
        "format_version": VERSION,
        "object_frame_link": object_frame,
        "gripper_frame_link": next(iter(grippers.values())).base_link,
        "grasps": {f"grasp_{i}": _plain(grasp, gripper_for(grasp, grippers)) for i, grasp in enumerate(grasps)},
    }
    write_text(path, yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=200))


def write_isaac_trials(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """Write a trial table: `<gripper>/<object>.yaml` with one object and one gripper each, and `splits`.

    A failed grasp has confidence 0. `gripper_frame_link` is the root link of `hand/<gripper>.urdf`.
    """
    for gripper in trials.grippers.values():
        (folder / gripper.name).mkdir(parents=True)
    for i, obj in enumerate(trials.objects):
        for gripper in trials.grippers.values():
            path = folder / gripper.name / f"{obj.name}.yaml"
            path.write_text(_trials_text(obj, gripper, grasps_of(trials, i, gripper)))
        advance(1)
    write_splits(folder / "splits", trials, lambda obj: f"{obj.name}.yaml")


def _trials_text(obj: GraspObject, gripper: Gripper, grasps: Grasps) -> str:
    """The YAML text of one object's trials with one gripper, `grasp_<row of the table>`.

    The joints are the same in every grasp, so that all but the first refer to the first's (YAML's & and *). Written by
    hand: PyYAML takes minutes for 100,000 grasps.
    """
    T = torch.from_numpy(grasps.T_object_gripper)
    closed = "&closed " + _mapping({joint: gripper.closed[joint] for joint in gripper.active})
    opened = "&open " + _mapping({joint: gripper.joints[joint] for joint in gripper.active})
    lines = [
        f"format: {FORMAT}",
        f"format_version: {VERSION}",
        f"object_frame_link: {obj.name}",
        f"gripper_frame_link: {gripper.name}",
        "grasps:" if len(T) else "grasps: {}",
    ]
    positions, quaternions = rounded(T[:, :3, 3].numpy()), rounded(se3.quaternion_of(T).numpy())
    rows = zip(grasps.index, grasps.success, positions, quaternions, strict=True)
    for index, success, position, (w, *xyz) in rows:
        lines += [
            f"  grasp_{index}:",
            f"    confidence: {float(success)}",
            f"    position: [{_numbers(position)}]",
            f"    orientation: {{w: {_number(w)}, xyz: [{_numbers(xyz)}]}}",
            f"    cspace_position: {closed}",
            f"    pregrasp_cspace_position: {opened}",
        ]
        closed, opened = "*closed", "*open"
    return "\n".join(lines) + "\n"


def read_isaac(path: Path) -> IsaacGrasps:
    """Read an Isaac grasp file of any program.

    Raises InputError in one line for a file that is missing, cut off, of another format or version, with a tag of
    YAML that would make an object, a quaternion that is not of length 1, a number that is not finite.
    """
    what = f"an Isaac grasp file of version {VERSION}"
    if not path.is_file():
        raise InputError(f"{path}: expected {what}, got {'a folder' if path.is_dir() else 'no such file'}")
    known = yaml_values(path, what, times=TIMES)
    for key, wanted in (("format", FORMAT), ("format_version", VERSION)):
        if (got := entry(known, key, str(path))) != wanted or isinstance(got, bool):
            raise InputError(f"{path}: expected {key} {wanted}, got {got!r:.40}")
    scene, gripper = (
        name(entry(known, key, str(path)), f"{path}: {key}") for key in ("object_frame_link", "gripper_frame_link")
    )
    listed = entry(known, "grasps", str(path))
    if not isinstance(listed, Mapping):
        raise InputError(f"{path}: grasps: expected names and grasps, got {listed!r:.40}")
    grasps = [_grasp(name(key, f"{path}: grasps"), values, path) for key, values in listed.items()]
    return IsaacGrasps(scene, gripper, grasps)


def _plain(grasp: Grasp, gripper: Gripper) -> dict[str, Any]:
    w, x, y, z = se3.quaternion_of(torch.from_numpy(grasp.T_input_base)).tolist()
    return {
        "confidence": grasp.probability,
        "position": grasp.T_input_base[:3, 3].tolist(),
        "orientation": {"w": w, "xyz": [x, y, z]},
        "cspace_position": {joint: grasp.closed[joint] for joint in gripper.active},
        "pregrasp_cspace_position": {joint: grasp.joints[joint] for joint in gripper.active},
    }


def _grasp(key: str, values: Any, path: Path) -> IsaacGrasp:
    where = f"{path}: {key}"
    orientation = entry(values, "orientation", where)
    w = number(entry(orientation, "w", where), f"{where}.orientation.w")
    xyz = vector(entry(orientation, "xyz", where), 3, f"{where}.orientation.xyz")
    if abs(np.hypot(w, np.linalg.norm(xyz)) - 1) > TOLERANCE:
        raise InputError(f"{where}.orientation: expected a quaternion of length 1, got w {w:g}, xyz {xyz.tolist()}")
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([*xyz, w]).as_matrix()  # scipy's order is x y z w
    T[:3, 3] = vector(entry(values, "position", where), 3, f"{where}.position")
    closed, opened = (
        joint_values(entry(values, joints, where), f"{where}.{joints}")
        for joints in ("cspace_position", "pregrasp_cspace_position")
    )
    if closed.keys() != opened.keys():
        raise InputError(f"{where}: expected the same joints closed and open, got {len(closed)} and {len(opened)}")
    return IsaacGrasp(
        key, number(entry(values, "confidence", where), f"{where}.confidence", 0.0, 1.0), T, closed, opened
    )


def _mapping(values: Mapping[str, float]) -> str:
    return "{" + ", ".join(f"{joint}: {_number(value)}" for joint, value in values.items()) + "}"


def _numbers(values: list[float]) -> str:
    return ", ".join(map(_number, values))


def _number(value: float) -> str:
    """Without an exponent: YAML 1.1 takes 1e-05 for a word."""
    return f"{value:.{DIGITS}f}"
