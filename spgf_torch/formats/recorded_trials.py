"""Trials that a robot recorded: a table of one's own, CSV or Parquet, a row a trial (docs/howto/recorded_trials.md).

Columns, in any order and case: `object`, `success`, a pose, and where they are needed `type`, `frame`, `cloud`,
`view_x view_y view_z`, `class`. Poses are of the TCP, or with `frame` base of the hand's base, m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.files.checks import rotation
from spgf_torch.formats.recorded_columns import (
    MATRIX,
    POSITION,
    QUATERNION,
    WHAT,
    check_columns,
    read_columns,
    rows_of,
)
from spgf_torch.formats.recorded_rows import Recording, Row
from spgf_torch.geometry import se3
from spgf_torch.hands.config import grasp_types
from spgf_torch.hands.hand import Hand
from spgf_torch.hands.records import grippers_of

LENGTH = 0.01  # off the length of a quaternion: two decimals
FAR = 10.0  # m: what is farther from its frame's origin is in mm


@dataclass(frozen=True)
class RecordedTrials:
    """Trials on one view of an object, or on its mesh; what a trial table has that learning needs.

    Attributes:
        T_object_tcp: (M, 4, 4) f32, m, in the frame of the view or of the mesh.
        grasp_type: (M,) int64, index into `grasp_types`. success: (M,) bool.
        grasp_types: names of the hand's grasp types, sorted.
        rows: (M,) of the table, from 1.
    """

    T_object_tcp: Tensor
    grasp_type: Tensor
    success: Tensor
    grasp_types: tuple[str, ...]
    rows: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.success)

    @staticmethod
    def joined(parts: Sequence[RecordedTrials]) -> RecordedTrials:
        """Those of several views of one object, in their order; each pose stays in the frame of its view."""
        T, grasp_type, success = (
            torch.cat([getattr(part, name) for part in parts]) for name in ("T_object_tcp", "grasp_type", "success")
        )
        return RecordedTrials(T, grasp_type, success, parts[0].grasp_types, tuple(r for p in parts for r in p.rows))


@dataclass(frozen=True)
class RecordedTable:
    """All trials of a table, by what was grasped: objects by name, the clouds of each as they first occur.

    Attributes:
        ignored: columns that nothing is done with.
    """

    path: Path
    views: tuple[tuple[Recording, RecordedTrials], ...]
    ignored: tuple[str, ...]


def read_recorded(path: Path, hand: Hand) -> RecordedTable:
    """The trials in a file, made with `hand`.

    Raises InputError in one line, with the number of the row (from 1, below the names of the columns) and the column,
    for the first value that cannot be used, and for a table of other columns.
    """
    columns, ignored = read_columns(path)
    types = grasp_types(hand.config)
    check_columns(path, columns, types)
    rows = [Row(path, number, values) for number, values in enumerate(rows_of(columns), 1)]
    if not rows:
        raise InputError(f"{path}: expected {WHAT}, got no row")
    T = _poses(rows, columns, hand, types)
    grasp_type = torch.tensor([row.type(types) for row in rows])
    success = torch.tensor([row.success() for row in rows])
    views = []
    for recording, chosen in _grouped(rows):
        index = torch.tensor(chosen)
        own = RecordedTrials(T[index], grasp_type[index], success[index], types, tuple(i + 1 for i in chosen))
        views.append((recording, own))
    return RecordedTable(path, tuple(views), ignored)


def _poses(rows: Sequence[Row], columns: Mapping[str, Any], hand: Hand, types: Sequence[str]) -> Tensor:
    """T_object_tcp (M, 4, 4) f32 of all rows, exact where a trial table of ours would be."""
    if "qw" in columns:
        position, quaternion = (
            torch.tensor([[row.number_in(name) for name in names] for row in rows], dtype=torch.float64)
            for names in (POSITION, QUATERNION)
        )
        off = (quaternion.norm(dim=1) - 1).abs()
        if float(off.max()) > LENGTH:
            row = rows[int(off.argmax())]
            length = float(quaternion[int(off.argmax())].norm())
            raise InputError(f"{row.path}: row {row.number}: qw: expected a quaternion of length 1, got {length:.4g}")
        T = se3.pose(position, quaternion)
    else:
        T = torch.eye(4, dtype=torch.float64).repeat(len(rows), 1, 1)
        given = [[row.number_in(name) for name in MATRIX] for row in rows]
        T[:, :3] = torch.tensor(given, dtype=torch.float64).view(-1, 3, 4)
        for row, matrix in zip(rows, T.numpy(), strict=True):
            rotation(matrix[:3, :3], f"{row.path}: row {row.number}: t00")
    for axis, name in enumerate(POSITION if "qw" in columns else ("t03", "t13", "t23")):
        if float(T[:, axis, 3].abs().max()) > FAR:
            raise rows[int(T[:, axis, 3].abs().argmax())].wrong(name, f"metres, {FAR:g} at most")
    to_tcp = {name: torch.from_numpy(np.array(gripper.T_base_tcp)) for name, gripper in grippers_of(hand).items()}
    for i, row in enumerate(rows):
        if row.of_base():
            T[i] = T[i] @ to_tcp[types[row.type(types)]]
    return T.float()


def _grouped(rows: Sequence[Row]) -> list[tuple[Recording, list[int]]]:
    """What was grasped, with the indices of its trials; InputError where rows of one thing contradict each other."""
    found: dict[tuple[str, Path | None], tuple[Recording, list[int]]] = {}
    of_object: dict[str, Recording] = {}
    for i, row in enumerate(rows):
        its = row.recording()
        first = of_object.setdefault(its.object_name, its)
        if (first.cloud is None) != (its.cloud is None):
            raise row.wrong("cloud", f"{'none' if first.cloud is None else 'one'}, as in row {first.row}")
        if first.category != its.category:
            raise row.wrong("class", f"that of row {first.row}")
        known, members = found.setdefault((its.object_name, its.cloud), (its, []))
        if known.viewpoint != its.viewpoint:
            raise row.wrong("view_x", f"the viewpoint of row {known.row}, which has the same cloud")
        members.append(i)
    return [found[key] for key in sorted(found, key=lambda key: key[0])]
