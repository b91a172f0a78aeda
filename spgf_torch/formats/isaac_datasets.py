"""Isaac grasp files of whole tables: an object and one gripper a file, failures with confidence 0.

`gripper_frame_link` is the root link of `hand/<gripper>.urdf`, the exported gripper frame. `exporting.isaac` reads the
files (and writes, for single predictions, poses of the hand's own base link).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import torch

from spgf_torch.formats.common import DIGITS, rounded, write_splits
from spgf_torch.formats.isaac import FORMAT, VERSION
from spgf_torch.formats.trial_sets import Grasps, TrialSet, grasps_of
from spgf_torch.geometry import se3
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.grasp_object import GraspObject


def write_isaac_set(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """`<gripper>/<object>.yaml`, and `splits`."""
    for gripper in trials.grippers.values():
        (folder / gripper.name).mkdir(parents=True)
    for obj, table in zip(trials.objects, trials.tables, strict=True):
        for kind, gripper in trials.grippers.items():
            path = folder / gripper.name / f"{obj.name}.yaml"
            path.write_text(isaac_text(obj, gripper, grasps_of(table, kind, gripper)))
        advance(1)
    write_splits(folder / "splits", trials, lambda obj: f"{obj.name}.yaml")


def isaac_text(obj: GraspObject, gripper: Gripper, grasps: Grasps) -> str:
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
    for index, held, position, (w, *xyz) in rows:
        lines += [
            f"  grasp_{index}:",
            f"    confidence: {float(held)}",
            f"    position: [{_numbers(position)}]",
            f"    orientation: {{w: {_number(w)}, xyz: [{_numbers(xyz)}]}}",
            f"    cspace_position: {closed}",
            f"    pregrasp_cspace_position: {opened}",
        ]
        closed, opened = "*closed", "*open"
    return "\n".join(lines) + "\n"


def _mapping(values: Mapping[str, float]) -> str:
    return "{" + ", ".join(f"{joint}: {_number(value)}" for joint, value in values.items()) + "}"


def _numbers(values: list[float]) -> str:
    return ", ".join(map(_number, values))


def _number(value: float) -> str:
    """Without an exponent: YAML 1.1 takes 1e-05 for a word."""
    return f"{value:.{DIGITS}f}"
