"""graspnetAPI's grasp array: (N, 17) float64 in a .npy, and beside it a JSON file with the joints that do not fit.

Columns: score, width, height, depth, rotation row by row (9), translation (3), object id. The camera's frame of the
format is the input's frame for predicted grasps, and the object's for trial tables. The axes of its gripper are x
approach, y closing, z = x cross y, where tcp has z, x and y; its origin lies `depth` behind the fingertips. Depth is
what the fingertips reach beyond the TCP, so the translation is the TCP's own: drive the point between the pads to it.
(With the base on the approach axis and the fingertips at tip_z = z of the TCP + depth, it is t_base +
(tip_z - depth) z: see docs/design/exports.md.)
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.checks import content, entries, entry, rotation
from spgf_torch.files.reading import json_of, npy_array
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.formats.common import JOINTS, HandJoints, hand_joints, write_joints, write_splits
from spgf_torch.formats.trial_sets import Grasps, TrialSet, grasps_of, gripper_frame
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

COLUMNS = 17
MOST_ROWS = 1_000_000
NO_OBJECT = -1  # graspnetAPI's own default of an object id
SCHEMA = 1
# Columns: graspnetAPI's axes in our gripper's frame: approach (0, 0, 1), closing (1, 0, 0), (0, 1, 0); see
# docs/design/exports.md.
GRASPNET_AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class GraspnetGrasp:
    """A row of the array.

    Attributes:
        score: higher is better. width: m between the fingers. height: m, of a finger across closing and approach.
        depth: m from the gripper's origin to the fingertips. object_id: -1: unknown.
        T_input_tcp: (4, 4) float64, the row's pose with the axes of tcp: +z approach, +x closing.
    """

    score: float
    width: float
    height: float
    depth: float
    T_input_tcp: np.ndarray
    object_id: int


def joints_path(path: Path) -> Path:
    """Where the joints of the rows in `path` stand: `grasps.npy` -> `grasps.joints.json`."""
    return path.with_suffix(".joints.json")


def write_graspnet(path: Path, grasps: Sequence[Grasp], grippers: Mapping[str, Gripper]) -> None:
    """Write predicted grasps, best first, as the (N, 17) array `path` and their joints as `joints_path(path)`.

    Raises InputError for a grasp of another hand than a two-finger jaw, which the array cannot describe.

    The score is the probability. graspnetAPI's evaluator takes a width of more than 0.1 m for 0.1 m; it is written as
    it is.
    """
    rows, hands = np.zeros((len(grasps), COLUMNS)), []
    for row, grasp in zip(rows, grasps, strict=True):
        gripper = gripper_for(grasp, grippers)
        if not gripper.jaw:
            raise InputError(f"{path}: expected grasps of two-finger jaws, got the type {grasp.type}")
        row[:4] = grasp.probability, gripper.width, gripper.height, gripper.depth
        row[4:13] = (grasp.T_input_tcp[:3, :3] @ GRASPNET_AXES).ravel()
        row[13:16] = grasp.T_input_tcp[:3, 3]
        row[16] = NO_OBJECT
        hands.append({"gripper": gripper.name, "joints": grasp.joints, "closed": grasp.closed})
    array = io.BytesIO()
    np.save(array, rows, allow_pickle=False)
    write_text(joints_path(path), json.dumps({"schema": SCHEMA, "rows": hands}, indent=1, allow_nan=False) + "\n")
    write_bytes(path, array.getvalue())


def write_graspnet_trials(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """Write a trial table: `<gripper>/<object>.npy`, `joints.json` beside them, and `splits`.

    The camera's frame of the format is the frame of the object's mesh, as in `clouds/`. The score is 1 where the grasp
    held and 0 where not; the object id is the object's place in the card's list.
    """
    for gripper in trials.grippers.values():
        (folder / gripper.name).mkdir(parents=True)
        write_joints(folder / gripper.name / JOINTS, gripper)
    for number, obj in enumerate(trials.objects):
        for gripper in trials.grippers.values():
            rows = _trial_rows(gripper, grasps_of(trials, number, gripper), number)
            np.save(folder / gripper.name / f"{obj.name}.npy", rows, allow_pickle=False)
        advance(1)
    write_splits(folder / "splits", trials, lambda obj: f"{obj.name}.npy")


def _trial_rows(gripper: Gripper, grasps: Grasps, object_id: int) -> np.ndarray:
    """(N, 17): score, width, height, depth, rotation row by row, translation, object id.

    From ACRONYM's frame R_gn = R GRASPNET_AXES and t_gn = t + (tip_z - depth) z (docs/design/exports.md). With our
    depth, what the fingertips reach beyond the TCP, tip_z - depth is the TCP's own z; a TCP beside the axis of the base
    adds its x and y, so that the translation is always the point between the pads.
    """
    T_gripper_tcp = np.linalg.inv(gripper_frame(gripper))
    T = grasps.T_object_gripper @ T_gripper_tcp
    rows = np.zeros((len(T), COLUMNS))
    rows[:, 0] = grasps.success
    rows[:, 1:4] = gripper.width, gripper.height, gripper.depth
    rows[:, 4:13] = (T[:, :3, :3] @ GRASPNET_AXES).reshape(-1, 9)
    rows[:, 13:16] = T[:, :3, 3]
    rows[:, 16] = object_id
    return rows


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


def read_row_joints(path: Path) -> list[HandJoints]:
    """Read the hands of the rows from the JSON file that `joints_path` names. Raises InputError in one line."""
    what = f"the joints of grasps, schema {SCHEMA}"
    known = json_of(content(path, what), path, what)
    if (got := entry(known, "schema", str(path))) != SCHEMA:
        raise InputError(f"{path}: expected schema {SCHEMA}, got {got!r:.40}")
    rows = entries(entry(known, "rows", str(path)), f"{path}: rows")
    return [HandJoints(*hand_joints(values, f"{path}: rows[{i}]")) for i, values in enumerate(rows)]


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
