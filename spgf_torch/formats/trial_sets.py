"""What a data set is made of: objects, their trials, their folds, what cameras see of them, and the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.formats.config import ExportConfig
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.records import Gripper, grippers_of
from spgf_torch.objects.folders import read_objects
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.progress import Stages
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.simulation.table import TrialTable, read_table, read_tables


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


def read_trial_set(config: ExportConfig, stages: Stages) -> TrialSet:
    """Objects, trials and clouds that the settings name.

    Raises InputError in one line for a table that is missing, damaged, made with another hand or with other objects,
    and for a table whose object, or an object whose table, is missing.
    """
    folder = find(config.trials)
    paths = sorted(folder.glob("*.parquet"))
    if not paths:
        got = "none in it" if folder.is_dir() else "no such folder"
        raise InputError(f"{folder}: expected the trial tables that simulate leaves, got {got}")
    found = read_objects(config, stages, Cache.open(config.cache, config.cache_gb))
    names = {obj.name for obj in found.objects}
    for path in paths:
        if path.stem not in names:
            raise InputError(f"{path}: expected its object {path.stem} in objects={config.objects}, got none")
    hand = load_hand(config.hand)
    first = read_table(paths[0]).origin  # sampler, episode, number and seed are the table's to say
    if first.hand_digest != hand.digest:
        raise InputError(f"{paths[0]}: expected trials of hand={config.hand.name}, got those of another hand")
    expected = [replace(first, object_name=obj.name, object_digest=obj.digest) for obj in found.objects]
    tables = read_tables(folder, expected)
    with stages.stage("sensing", len(found.objects), "objects") as advance:
        texlets = []
        for obj in found.objects:
            texlets.append(sense(obj, config.sensing, config.seed))
            advance(1)
    fold = stratified_folds([obj.category for obj in found.objects], config.folds, config.seed)
    return TrialSet(found.objects, tables, texlets, fold, hand, grippers_of(hand), found.notes)


def gripper_frame(gripper: Gripper) -> np.ndarray:
    """T_tcp_gripper (4, 4) float64: the exported gripper frame has the axes of tcp at the origin of the base link."""
    T = np.eye(4)
    T[:3, 3] = np.linalg.inv(gripper.T_base_tcp)[:3, 3]
    return T


def grasps_of(table: TrialTable, kind: str, gripper: Gripper) -> Grasps:
    """The trials of one grasp type, as poses of the exported gripper frame."""
    chosen = np.flatnonzero(table.grasp_type.numpy() == GRASP_TYPES.index(kind))
    poses = table.T_object_tcp.numpy()[chosen].astype(np.float64) @ gripper_frame(gripper)
    return Grasps(poses, table.success.numpy()[chosen], table.outcome.numpy()[chosen], chosen)
