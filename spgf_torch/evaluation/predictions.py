"""What was predicted on objects by models that had not seen them, and `predictions.parquet`, which keeps it.

The file has a row a candidate grasp: object, class, fold and type, success and collides, votes, `score_` of each
ranking, probability before and after calibration, and the pose T_object_tcp.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch

from spgf_torch.affordance.config import NESTED
from spgf_torch.errors import InputError
from spgf_torch.evaluation.success import of_each_type
from spgf_torch.files.checks import name as checked_name
from spgf_torch.files.digests import BLANK, KEY, check_seal, sealed
from spgf_torch.files.parquet import parquet_table
from spgf_torch.files.reading import existing, reason
from spgf_torch.files.writing import write_bytes
from spgf_torch.geometry import se3
from spgf_torch.objects.config import CLASSES

if TYPE_CHECKING:
    from spgf_torch.affordance.ranking import GraspScores
    from spgf_torch.experiment.describe import TriedGrasps
    from spgf_torch.experiment.named import Identity

MOST_ROWS = 20_000_000  # of an experiment: a hundred objects with 100,000 candidates of each type
POSE = ("px", "py", "pz", "qw", "qx", "qy", "qz")
SCORE = "score_"  # before the name of a ranking
_COLUMNS = ("object", "class", "fold", "type", "success", "collides", "votes", "probability_before", "probability")


@dataclass(frozen=True)
class Predictions:
    """One object's G candidate grasps, predicted on by a model that had not seen it.

    Attributes:
        chosen: the ranking that was chosen without this object's fold; "" where nobody says.
        scores: ranking -> (G,) float score of each grasp, -inf without votes; `config.NESTED` is the chosen one.
        probability_before, probability (G,) float: of success, as voted and as calibrated; votes (G,) int.
        success (G,) bool; grasp_type (G,) int: index into `grasp_types`.
        collides (G,) bool: a sensed point lies inside the open hand.
        pose (G, 7) float: T_object_tcp as x y z (m) and quaternion wxyz.
        grasp_types: names of the hand's grasp types.
    """

    name: str
    category: str
    fold: int
    chosen: str
    scores: Mapping[str, np.ndarray]
    probability_before: np.ndarray
    probability: np.ndarray
    votes: np.ndarray
    success: np.ndarray
    grasp_type: np.ndarray
    collides: np.ndarray
    pose: np.ndarray
    grasp_types: tuple[str, ...]

    @staticmethod
    def of(obj: Identity, table: TriedGrasps, scores: GraspScores, fold: int) -> Predictions:
        """What was predicted on an object, beside what became of its grasps."""
        return Predictions(
            name=obj.name,
            category=obj.category,
            fold=fold,
            chosen=scores.chosen,
            scores={name: score.cpu().numpy() for name, score in scores.by_ranking.items()},
            probability_before=scores.probability_before.cpu().numpy(),
            probability=scores.probability.cpu().numpy(),
            votes=scores.votes.cpu().numpy(),
            success=table.success.numpy(),
            grasp_type=table.grasp_type.numpy(),
            collides=scores.collides.cpu().numpy(),
            pose=pose_columns(table.T_object_tcp),
            grasp_types=table.grasp_types,
        )

    @cached_property
    def T_object_tcp(self) -> np.ndarray:  # noqa: N802
        """(G, 4, 4) float64."""
        position, quaternion = torch.from_numpy(self.pose).double().split([3, 4], dim=1)
        return se3.pose(position, quaternion).numpy()

    def of_type(self, name: str) -> np.ndarray:
        """(G,) bool: which grasps are of a type; CG takes all."""
        return of_each_type(self.grasp_type, self.grasp_types)[name]

    def ranked(self, ranking: str, grasp_type: str, n: int) -> np.ndarray:
        """Indices of the n highest-ranked grasps of a type (CG: all), best first; ties go to the earlier grasp."""
        score, among = self.scores[ranking], np.flatnonzero(self.of_type(grasp_type))
        return among[np.argsort(-score[among], kind="stable")[:n]]


def pose_columns(T: torch.Tensor) -> np.ndarray:
    """(G, 7) of poses (G, 4, 4): x y z (m) and quaternion wxyz."""
    return np.concatenate([se3.position_of(T).numpy(), se3.quaternion_of(T).numpy()], axis=1)


def write_predictions(path: Path, objects: Sequence[Predictions]) -> None:
    """Write `predictions.parquet`: a row a candidate grasp of every object."""
    sizes = [len(o.success) for o in objects]
    columns: dict[str, Any] = {
        "object": pa.array(np.repeat([o.name for o in objects], sizes)).dictionary_encode(),
        "class": pa.array(np.repeat([o.category for o in objects], sizes)).dictionary_encode(),
        "fold": np.repeat(np.array([o.fold for o in objects], dtype=np.int8), sizes),
        "type": pa.array(np.concatenate([np.array(o.grasp_types)[o.grasp_type] for o in objects])).dictionary_encode(),
    }
    for name in ("success", "collides"):
        columns[name] = np.concatenate([getattr(o, name) for o in objects])
    columns["votes"] = np.concatenate([o.votes for o in objects]).astype(np.int32)
    for name in (name for name in objects[0].scores if name != NESTED):  # that one is one of the others
        columns[SCORE + name] = np.concatenate([o.scores[name] for o in objects]).astype(np.float32)
    for name in ("probability_before", "probability"):
        columns[name] = np.concatenate([getattr(o, name) for o in objects]).astype(np.float32)
    poses = np.concatenate([o.pose for o in objects]).astype(np.float32)
    columns |= {name: poses[:, i] for i, name in enumerate(POSE)}
    sink = io.BytesIO()
    pq.write_table(pa.table(columns).replace_schema_metadata({KEY: BLANK}), sink, compression="zstd")
    write_bytes(path, sealed(sink.getvalue()))


def read_predictions(path: Path, chosen: Mapping[int, str]) -> list[Predictions]:
    """The predictions on each object; chosen: fold -> the ranking that was chosen without it, as results.json says.

    Raises InputError where the file is missing, damaged or not ours.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected the predictions of a run, got no such file")
    check_seal(existing(path), "the predictions of a run")
    table = parquet_table(path, "the predictions of a run", None, MOST_ROWS)
    try:
        return _by_object({name: _array(table[name]) for name in table.column_names}, chosen)
    except (KeyError, ValueError, TypeError, InputError, OverflowError, pa.ArrowException) as error:
        raise InputError(f"{path}: expected the columns of predictions, got others ({reason(error)})") from None


def _array(column: pa.ChunkedArray) -> np.ndarray:
    if column.null_count:
        raise ValueError("a value in every row, not nulls")
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    return column.to_numpy()


def _by_object(columns: Mapping[str, np.ndarray], chosen: Mapping[int, str]) -> list[Predictions]:
    if missing := [name for name in (*_COLUMNS, *POSE) if name not in columns]:
        raise ValueError(f"missing {', '.join(missing)}")
    names = columns["object"]
    if not len(names):
        raise ValueError("no row")
    starts = np.flatnonzero(np.r_[True, names[1:] != names[:-1]])
    rows = [slice(a, b) for a, b in zip(starts, [*starts[1:], len(names)], strict=True)]
    words, codes = np.unique(columns["type"].astype(str), return_inverse=True)
    grasp_types = tuple(checked_name(word, "type") for word in words.tolist())
    if any(len(np.unique(codes[part])) < len(grasp_types) for part in rows):
        raise ValueError(f"grasps of each of {', '.join(grasp_types)} on every object")
    columns = {**columns, "type": codes}
    return [_of_rows({name: values[part] for name, values in columns.items()}, chosen, grasp_types) for part in rows]


def _of_rows(columns: Mapping[str, np.ndarray], chosen: Mapping[int, str], grasp_types: tuple[str, ...]) -> Predictions:
    """The predictions on one object. Raises ValueError for columns that hold what was never written."""
    if (category := str(columns["class"][0])) not in CLASSES:
        raise ValueError(f"unknown class {category}")
    for name in ("probability_before", "probability"):
        if not ((columns[name] >= 0) & (columns[name] <= 1)).all():
            raise ValueError(f"{name} from 0 to 1, not others")
    pose = np.column_stack([columns[name] for name in POSE])
    if not np.isfinite(pose).all() or not np.linalg.norm(pose[:, 3:], axis=1).all():
        raise ValueError("finite poses, not others")
    scores = {name.removeprefix(SCORE): values for name, values in columns.items() if name.startswith(SCORE)}
    if any(np.isnan(values).any() for values in scores.values()):
        raise ValueError("scores that are numbers, not NaN")
    fold = int(columns["fold"][0])
    if (ranking := chosen.get(fold, "")) in scores:
        scores[NESTED] = scores[ranking]
    return Predictions(
        name=checked_name(str(columns["object"][0]), "object"),
        category=category,
        fold=fold,
        chosen=ranking,
        scores=scores,
        probability_before=columns["probability_before"],
        probability=columns["probability"],
        votes=columns["votes"],
        success=columns["success"].astype(bool),
        grasp_type=columns["type"],
        collides=columns["collides"].astype(bool),
        pose=pose,
        grasp_types=grasp_types,
    )
