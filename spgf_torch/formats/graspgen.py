"""GraspGen's JSON files (Murali et al. 2025): an object and one gripper a file; its gripper YAML; its lists of objects.

GraspGen's loader multiplies every pose by `transform_offset_from_asset_to_graspgen_convention` from the right, and its
pictures apply the same offset to the asset's points, which agree only where the offset is its own inverse. Here the
asset (`hand/<gripper>.urdf`) has the convention's frame itself, and the offset is the identity.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from spgf_torch.errors import InputError
from spgf_torch.files.checks import entries, entry, name, number, rigid, vector
from spgf_torch.files.reading import json_values, yaml_values
from spgf_torch.formats.common import HAND, mesh_file, rounded, write_splits
from spgf_torch.formats.trial_sets import Grasps, TrialSet, grasps_of, gripper_frame
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.grasp_object import GraspObject

OFFSET = "transform_offset_from_asset_to_graspgen_convention"


@dataclass(frozen=True)
class GraspgenFile:
    """What a file holds.

    Attributes:
        file: of the mesh, relative to the data set; GraspGen's name of the object. scale: of the mesh, to metres.
        transforms: (N, 4, 4) float64, of the gripper in the scaled mesh's frame. object_in_gripper: (N,) bool.
    """

    file: str
    scale: float
    transforms: np.ndarray
    object_in_gripper: np.ndarray


@dataclass(frozen=True)
class GraspgenGripper:
    """The gripper YAML: `width` m between the open fingers, `depth` m from base to TCP along z, T_offset (4, 4)."""

    name: str
    width: float
    depth: float
    T_offset: np.ndarray


def write_graspgen(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """`grasp_data/<gripper>/<object>.json`, `splits/<gripper>/fold{F}/*.txt`, `grippers/<gripper>.yaml`."""
    (folder / "grippers").mkdir(parents=True)
    for gripper in trials.grippers.values():
        (folder / "grasp_data" / gripper.name).mkdir(parents=True)
        (folder / "grippers" / f"{gripper.name}.yaml").write_text(gripper_yaml(gripper))
        write_splits(folder / "splits" / gripper.name, trials, mesh_file)
    for i, obj in enumerate(trials.objects):
        for gripper in trials.grippers.values():
            path = folder / "grasp_data" / gripper.name / f"{obj.name}.json"
            path.write_text(grasps_text(obj, gripper, grasps_of(trials, i, gripper)))
        advance(1)


def grasps_text(obj: GraspObject, gripper: Gripper, grasps: Grasps) -> str:
    """The JSON text of one object's trials with one gripper."""
    known = {
        "object": {"file": mesh_file(obj), "scale": 1.0},
        "gripper": {"name": gripper.name},
        "grasps": {
            "transforms": rounded(grasps.T_object_gripper),
            "object_in_gripper": [bool(success) for success in grasps.success],
        },
    }
    return json.dumps(known, separators=(",", ":"))


def gripper_yaml(gripper: Gripper) -> str:
    """The text of the gripper YAML; `T_base_link_tcp` for grippers whose TCP is not straight above their base."""
    T_gripper_tcp = np.linalg.inv(gripper_frame(gripper))
    known = {
        "name": gripper.name,
        "file_name": f"{HAND}/{gripper.name}.urdf",
        "width": gripper.width,
        "depth": rounded(T_gripper_tcp[2, 3]),
        OFFSET: [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        "symmetric_antipodal": gripper.symmetry == 2,
        "T_base_link_tcp": rounded(T_gripper_tcp),
    }
    return yaml.safe_dump(known, sort_keys=False, default_flow_style=None, width=200)


def read_graspgen(path: Path) -> GraspgenFile:
    """The grasps of one file. Raises InputError in one line for a file that is missing, cut off or another."""
    return grasps_of_json(json_values(path, "grasps in GraspGen's format"), str(path))


def grasps_of_json(known: Any, where: str) -> GraspgenFile:
    """The grasps of a file's values; `where` names it in errors. Labels must be booleans: they serve as a mask."""
    described, grasps = (entry(known, key, where) for key in ("object", "grasps"))
    listed = entries(entry(grasps, "transforms", where), f"{where}: transforms")
    labels = entries(entry(grasps, "object_in_gripper", where), f"{where}: object_in_gripper")
    if len(listed) != len(labels):
        raise InputError(f"{where}: expected a label for each of {len(listed)} poses, got {len(labels)}")
    if odd := [label for label in labels if not isinstance(label, bool)]:
        raise InputError(f"{where}: object_in_gripper: expected true and false, got {odd[0]!r:.40}")
    poses = [rigid(T, f"{where}: transforms[{i}]") for i, T in enumerate(listed)]
    return GraspgenFile(
        file=name(entry(described, "file", where), f"{where}: object.file"),
        scale=number(entry(described, "scale", where), f"{where}: object.scale", 1e-9),
        transforms=np.array(poses).reshape(-1, 4, 4),
        object_in_gripper=np.array(labels, dtype=bool),
    )


def read_gripper(path: Path) -> GraspgenGripper:
    """The gripper YAML. Raises InputError in one line for a file that is missing, cut off or another."""
    known = yaml_values(path, "a gripper in GraspGen's format")
    width, depth = (number(entry(known, key, str(path)), f"{path}: {key}", 0.0) for key in ("width", "depth"))
    offset = entries(entry(known, OFFSET, str(path)), f"{path}: {OFFSET}")
    if len(offset) != 2:
        raise InputError(f"{path}: {OFFSET}: expected [[xyz], [xyzw]], got {offset!r:.60}")
    xyz, xyzw = vector(offset[0], 3, f"{path}: {OFFSET}"), vector(offset[1], 4, f"{path}: {OFFSET}")
    return GraspgenGripper(path.stem, width, depth, _pose(xyz, xyzw))


def _pose(xyz: np.ndarray, xyzw: np.ndarray) -> np.ndarray:
    """T (4, 4) of a position and a quaternion, real part last, as the YAML has it."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(xyzw).as_matrix(), xyz
    return T
