"""graspnetAPI's grasp array: (N, 17) float64 in a .npy, and beside it a JSON file with the joints that do not fit.

Columns: score, width, height, depth, rotation row by row (9), translation (3), object id. The camera's frame of the
format is the input's frame. Its gripper's axes are x approach, y closing, z = x cross y, where tcp has z, x and y; its
origin lies `depth` behind the fingertips. Depth is here what the fingertips reach beyond the TCP, so the translation
is the TCP's own: drive the point between the pads there. (With the base on the approach axis and the fingertips at
tip_z = z of the TCP + depth, it is t_base + (tip_z - depth) z of docs/design/exports.md.)
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.checks import content, entries, entry, joint_values, name, rotation
from spgf_torch.files.reading import json_of, npy_array
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

COLUMNS = 17
MOST_ROWS = 1_000_000
NO_OBJECT = -1  # graspnetAPI's own default of an object id
SCHEMA = 1
# Columns: graspnetAPI's axes in our gripper's frame: approach (0, 0, 1), closing (1, 0, 0), (0, 1, 0); see
# docs/design/exports.md.
TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class GraspnetGrasp:
    """A row of the array.

    Attributes:
        score: higher is better. width: m between the fingers. height: m, of a finger across closing and approach.
        depth: m from the gripper's origin to the fingertips. object_id: -1 where nobody knows.
        T_input_tcp: (4, 4) float64, the row's pose with the axes of tcp: +z approach, +x closing.
    """

    score: float
    width: float
    height: float
    depth: float
    T_input_tcp: np.ndarray
    object_id: int


@dataclass(frozen=True)
class GraspJoints:
    """The hand of a row: the gripper's name, and joint -> rad or m of the open and of the closed hand."""

    gripper: str
    joints: dict[str, float]
    closed: dict[str, float]


def joints_path(path: Path) -> Path:
    """Where the joints of the rows in `path` stand: `grasps.npy` -> `grasps.joints.json`."""
    return path.with_suffix(".joints.json")


def write_graspnet(path: Path, grasps: Sequence[Grasp], grippers: Mapping[str, Gripper]) -> None:
    """Write grasps, best first, as the (N, 17) array `path` and their joints as `joints_path(path)`.

    The score is the probability. graspnetAPI's evaluator takes a width of more than 0.1 m for 0.1 m; it is written as
    it is.
    """
    rows, hands = np.zeros((len(grasps), COLUMNS)), []
    for row, grasp in zip(rows, grasps, strict=True):
        gripper = gripper_for(grasp, grippers)
        row[:4] = grasp.probability, gripper.width, gripper.height, gripper.depth
        row[4:13] = (grasp.T_input_tcp[:3, :3] @ TURN).ravel()
        row[13:16] = grasp.T_input_tcp[:3, 3]
        row[16] = NO_OBJECT
        hands.append({"gripper": gripper.name, "joints": grasp.joints, "closed": grasp.closed})
    array = io.BytesIO()
    np.save(array, rows, allow_pickle=False)
    write_text(joints_path(path), json.dumps({"schema": SCHEMA, "rows": hands}, indent=1, allow_nan=False) + "\n")
    write_bytes(path, array.getvalue())


def read_graspnet(path: Path) -> list[GraspnetGrasp]:
    """The grasps of an array as graspnetAPI saves it, in its order. Nothing in it is unpickled.

    Raises InputError in one line for a file that is missing, cut off, no such array, of another shape, or with a
    number that is not finite, a negative length, a matrix that is no rotation.
    """
    what = f"an array of N x {COLUMNS} numbers"
    if not path.is_file():
        raise InputError(f"{path}: expected {what}, got {'a folder' if path.is_dir() else 'no such file'}")
    rows = npy_array(path)
    if rows.ndim != 2 or rows.shape[1] != COLUMNS or rows.dtype.kind != "f" or len(rows) > MOST_ROWS:
        raise InputError(f"{path}: expected {what}, {MOST_ROWS} at most, got {str(rows.dtype)[:40]} {rows.shape}")
    return [_grasp(row, f"{path}: row {i}") for i, row in enumerate(rows.astype(np.float64))]


def read_joints(path: Path) -> list[GraspJoints]:
    """The hands of the rows, from the JSON file that `joints_path` names. Raises InputError in one line."""
    what = f"the joints of grasps, schema {SCHEMA}"
    known = json_of(content(path, what), path, what)
    if (got := entry(known, "schema", str(path))) != SCHEMA:
        raise InputError(f"{path}: expected schema {SCHEMA}, got {got!r:.40}")
    rows = entries(entry(known, "rows", str(path)), f"{path}: rows")
    return [_joints(values, f"{path}: rows[{i}]") for i, values in enumerate(rows)]


def _grasp(row: np.ndarray, where: str) -> GraspnetGrasp:
    if not np.isfinite(row).all():
        raise InputError(f"{where}: expected finite numbers, got NaN or infinity in column {np.isfinite(row).argmin()}")
    score, width, height, depth = row[:4].tolist()
    if min(width, height, depth) < 0:
        raise InputError(f"{where}: expected lengths from 0, got width {width:g}, height {height:g}, depth {depth:g}")
    approach, closing, third = rotation(row[4:13].reshape(3, 3), where).T
    T = np.eye(4)
    T[:3] = np.column_stack([closing, third, approach, row[13:16]])
    return GraspnetGrasp(score, width, height, depth, T, int(row[16]))


def _joints(values: Any, where: str) -> GraspJoints:
    opened, closed = (joint_values(entry(values, key, where), f"{where}.{key}") for key in ("joints", "closed"))
    return GraspJoints(name(entry(values, "gripper", where), f"{where}.gripper"), opened, closed)
