"""What a data set is made of: objects, their trials, their folds, what cameras see of them, and the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.hands.config import grasp_types
from spgf_torch.hands.records import Gripper

if TYPE_CHECKING:  # predict writes two of the formats, and needs none of these
    from spgf_torch.hands.hand import Hand
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.sensing.texlets import Texlets
    from spgf_torch.simulation.table import TrialTable


@dataclass(frozen=True)
class TrialSet:
    """A trial table and everything that is exported beside it; the sequences are in the order of the objects.

    Attributes:
        objects: sorted by name. tables: their trials. texlets: what the simulated cameras see of them.
        fold: (objects,) int64, the fold in which each is novel.
        hand: what tried the grasps. grippers: grasp type -> the hand in its preshape.
        notes: a line each on what the folder of objects was taken for.
    """

    objects: Sequence[GraspObject]
    tables: Sequence[TrialTable]
    texlets: Sequence[Texlets]
    fold: np.ndarray
    hand: Hand
    grippers: dict[str, Gripper]
    notes: Sequence[str] = ()

    @property
    def grasp_types(self) -> tuple[str, ...]:
        """Those of the hand, in the order of the tables' codes."""
        return grasp_types(self.hand.config)

    @property
    def trials(self) -> int:
        return sum(len(table) for table in self.tables)


@dataclass(frozen=True)
class Grasps:
    """The trials of one object with one gripper, in the order of the table.

    Attributes:
        T_object_gripper: (G, 4, 4) float64. success: (G,) bool. outcome: (G,) int64, index into `trials.OUTCOMES`.
        index: (G,) int64, the rows of the object's table.
    """

    T_object_gripper: np.ndarray
    success: np.ndarray
    outcome: np.ndarray
    index: np.ndarray


def gripper_frame(gripper: Gripper) -> np.ndarray:
    """T_tcp_gripper (4, 4) float64: the exported gripper frame has the axes of tcp at the origin of the base link."""
    T = np.eye(4)
    T[:3, 3] = np.linalg.inv(gripper.T_base_tcp)[:3, 3]
    return T


def grasps_of(trials: TrialSet, number: int, gripper: Gripper) -> Grasps:
    """The trials of the object `number` with one gripper, as poses of the exported gripper frame."""
    table = trials.tables[number]
    chosen = np.flatnonzero(table.grasp_type.numpy() == trials.grasp_types.index(gripper.type))
    poses = table.T_object_tcp.numpy()[chosen].astype(np.float64) @ gripper_frame(gripper)
    return Grasps(poses, table.success.numpy()[chosen], table.outcome.numpy()[chosen], chosen)
