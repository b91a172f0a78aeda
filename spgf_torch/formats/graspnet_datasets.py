"""graspnetAPI's grasp arrays of whole tables: an object and one gripper a file, (N, 17) float64, the joints beside.

Columns and axes are those of `exporting.graspnet`, which reads the files. The camera frame of the format is here the
frame of the object's mesh, as that of `clouds/`; score is 1 where the grasp held and 0 where not; the object id is the
object's place in the card's list.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from spgf_torch.formats.common import JOINTS, write_joints, write_splits
from spgf_torch.formats.graspnet import COLUMNS, TURN
from spgf_torch.formats.trial_sets import Grasps, TrialSet, grasps_of, gripper_frame
from spgf_torch.hands.records import Gripper


def write_graspnet_set(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """`<gripper>/<object>.npy` with `joints.json` beside them, and `splits`."""
    for gripper in trials.grippers.values():
        (folder / gripper.name).mkdir(parents=True)
        write_joints(folder / gripper.name / JOINTS, gripper)
    for number, (obj, table) in enumerate(zip(trials.objects, trials.tables, strict=True)):
        for kind, gripper in trials.grippers.items():
            rows = graspnet_rows(gripper, grasps_of(table, kind, gripper), number)
            np.save(folder / gripper.name / f"{obj.name}.npy", rows, allow_pickle=False)
        advance(1)
    write_splits(folder / "splits", trials, lambda obj: f"{obj.name}.npy")


def graspnet_rows(gripper: Gripper, grasps: Grasps, object_id: int) -> np.ndarray:
    """(N, 17): score, width, height, depth, rotation row by row, translation, object id.

    From ACRONYM's frame R_gn = R TURN and t_gn = t + (tip_z - depth) z (docs/design/exports.md). With our depth, what
    the fingertips reach beyond the TCP, tip_z - depth is the TCP's own z; a TCP beside the axis of the base is met by
    its x and y as well, so that the translation is always the point between the pads.
    """
    T_gripper_tcp = np.linalg.inv(gripper_frame(gripper))
    T = grasps.T_object_gripper @ T_gripper_tcp
    rows = np.zeros((len(T), COLUMNS))
    rows[:, 0] = grasps.success
    rows[:, 1:4] = gripper.width, gripper.height, gripper.depth
    rows[:, 4:13] = (T[:, :3, :3] @ TURN).reshape(-1, 9)
    rows[:, 13:16] = T[:, :3, 3]
    rows[:, 16] = object_id
    return rows
