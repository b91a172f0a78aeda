"""Every candidate grasp with its scores (`predictions.parquet`), and the curves that follow from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from spgf_torch.errors import InputError
from spgf_torch.evaluation.success import TYPES, of_type
from spgf_torch.files.checks import name as checked_name
from spgf_torch.files.parquet import parquet_table
from spgf_torch.files.reading import existing, reason
from spgf_torch.files.sealing import check_seal
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.objects.config import CLASSES
from spgf_torch.reporting.data.runs import Run

NESTED = "nested"
MOST_ROWS = 20_000_000  # of an experiment: a hundred objects with 100,000 candidates of each type
POSE = ("px", "py", "pz", "qw", "qx", "qy", "qz")
_COLUMNS = ("object", "class", "fold", "type", "success", "collides", "votes", "probability_before", "probability")


@dataclass(frozen=True)
class Candidates:
    """The G candidate grasps of one object.

    Attributes:
        success, collides (G,) bool; grasp_type (G,) int: index into `config.GRASP_TYPES`; votes (G,) int.
        scores: ranking -> (G,) f32, -inf without votes.
        probability_before, probability (G,) f32: learned, and calibrated.
        pose (G, 7) f32: T_object_tcp as x y z (m) and qw qx qy qz.
    """

    name: str
    category: str
    fold: int
    grasp_type: np.ndarray
    success: np.ndarray
    collides: np.ndarray
    votes: np.ndarray
    scores: dict[str, np.ndarray]
    probability_before: np.ndarray
    probability: np.ndarray
    pose: np.ndarray

    @cached_property
    def T_object_tcp(self) -> np.ndarray:  # noqa: N802
        """(G, 4, 4) float64."""
        T = np.tile(np.eye(4), (len(self.pose), 1, 1))
        T[:, :3, :3] = Rotation.from_quat(self.pose[:, 3:], scalar_first=True).as_matrix()
        T[:, :3, 3] = self.pose[:, :3]
        return T

    def ranked(self, ranking: str, chosen: Mapping[int, str], kind: str, n: int) -> np.ndarray:
        """Indices of the n highest-ranked grasps of a type (CG: both), best first; ties go to the earlier grasp.

        `nested` is the ranking that was chosen for the object's fold.
        """
        score = self.scores[chosen[self.fold] if ranking == NESTED else ranking]
        among = np.flatnonzero(of_type(self.grasp_type, kind))
        return among[np.argsort(-score[among], kind="stable")[:n]]


def read_predictions(run: Run, ranking: str) -> list[Candidates]:
    """The candidates of each object of a run, to be ranked by `ranking`.

    Raises InputError where the file is missing, damaged, not ours or without the scores of the ranking.
    """
    path = run.folder / "predictions.parquet"
    if not path.is_file():
        raise InputError(f"{path}: expected the predictions of a run, got no such file")
    check_seal(existing(path), "the predictions of a run")
    table = parquet_table(path, "the predictions of a run", None, MOST_ROWS)
    try:
        objects = _by_object({name: _array(table[name]) for name in table.column_names})
    except (KeyError, ValueError, TypeError, InputError, OverflowError, pa.ArrowException) as error:
        raise InputError(f"{path}: expected the columns of predictions, got others ({reason(error)})") from None
    for candidates in objects:
        wanted = run.chosen.get(candidates.fold, NESTED) if ranking == NESTED else ranking
        if wanted not in candidates.scores:
            raise InputError(f"{path}: expected the scores of the ranking {wanted}, got {', '.join(candidates.scores)}")
    return objects


def precision_at(objects: Sequence[Candidates], ranking: str, chosen: Mapping[int, str], most: int) -> np.ndarray:
    """(objects, types, most) float: the share of successes among the N highest-ranked grasps, N = 1 .. most.

    Types are NPG, WPG, CG. Of fewer than N grasps the share is that of all of them.
    """
    rates = np.zeros((len(objects), len(TYPES), most))
    for i, candidates in enumerate(objects):
        for j, kind in enumerate(TYPES):
            held = candidates.success[candidates.ranked(ranking, chosen, kind, most)]
            running = np.cumsum(held) / np.arange(1, len(held) + 1)
            rates[i, j, : len(held)] = running
            rates[i, j, len(held) :] = running[-1] if len(held) else 0.0
    return rates


def ceilings_at(objects: Sequence[Candidates], most: int) -> np.ndarray:
    """(objects, types, most) float: what the best N by outcome would give."""
    held = [[c.success[of_type(c.grasp_type, kind)].sum() for kind in TYPES] for c in objects]
    n = np.arange(1, most + 1)
    return np.minimum(np.asarray(held)[..., None], n) / n


def class_curves(
    categories: Sequence[str], values: np.ndarray, resamples: int, seed: int
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Class (and "all") -> mean, lower and upper bound of `values` (objects, ...) over the class's objects.

    The bounds are 95 % percentiles over objects drawn with replacement within their class, as in the table.
    """
    rng, flat = np.random.default_rng(seed), values.reshape(len(values), -1)
    counts = np.zeros((resamples, len(flat)))  # how often each object was drawn
    for name in dict.fromkeys(categories):
        members = _members(categories, name)
        counts[:, members] = rng.multinomial(len(members), np.full(len(members), 1 / len(members)), size=resamples)
    means, curves = mean_curves(categories, values), {}
    for name, mean in means.items():
        members = _members(categories, name)
        low, high = np.quantile(counts[:, members] @ flat[members] / len(members), (0.025, 0.975), axis=0)
        curves[name] = (mean, low.reshape(mean.shape), high.reshape(mean.shape))
    return curves


def mean_curves(categories: Sequence[str], values: np.ndarray) -> dict[str, np.ndarray]:
    """Class (and "all") -> mean of `values` (objects, ...) over the class's objects."""
    names = [*(name for name in CLASSES if name in categories), "all"]
    return {name: values[_members(categories, name)].mean(axis=0) for name in names}


def _members(categories: Sequence[str], name: str) -> np.ndarray:
    return np.flatnonzero([name in ("all", category) for category in categories])


def probabilities(objects: Sequence[Candidates], kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Probability before and after calibration, and success, of all objects' grasps of a type: each (G,)."""
    chosen = [of_type(c.grasp_type, kind) for c in objects]
    before, after, held = (
        np.concatenate([getattr(c, name)[mask] for c, mask in zip(objects, chosen, strict=True)])
        for name in ("probability_before", "probability", "success")
    )
    return before, after, held


def _array(column: pa.ChunkedArray) -> np.ndarray:
    if column.null_count:
        raise ValueError("a value in every row, not nulls")
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    return column.to_numpy()


def _by_object(columns: Mapping[str, np.ndarray]) -> list[Candidates]:
    if missing := [name for name in (*_COLUMNS, *POSE) if name not in columns]:
        raise ValueError(f"missing {', '.join(missing)}")
    names = columns["object"]
    starts = np.flatnonzero(np.r_[True, names[1:] != names[:-1]]) if len(names) else np.zeros(0, dtype=int)
    if not len(names):
        raise ValueError("no row")
    return [_candidates(columns, slice(a, b)) for a, b in zip(starts, [*starts[1:], len(names)], strict=True)]


def _candidates(columns: Mapping[str, np.ndarray], rows: slice) -> Candidates:
    grasp_type = np.full(rows.stop - rows.start, -1)
    for code, kind in enumerate(GRASP_TYPES):
        grasp_type[columns["type"][rows] == kind] = code
    if (grasp_type < 0).any():
        raise ValueError("unknown grasp type")
    if (category := str(columns["class"][rows.start])) not in CLASSES:
        raise ValueError(f"unknown class {category}")
    for name in ("probability_before", "probability"):
        if not ((columns[name][rows] >= 0) & (columns[name][rows] <= 1)).all():
            raise ValueError(f"{name} from 0 to 1, not others")
    pose = np.column_stack([columns[name][rows] for name in POSE])
    if not np.isfinite(pose).all() or not np.linalg.norm(pose[:, 3:], axis=1).all():
        raise ValueError("finite poses, not others")
    if any(np.isnan(values[rows]).any() for name, values in columns.items() if name.startswith("score_")):
        raise ValueError("scores that are numbers, not NaN")
    return Candidates(
        name=checked_name(str(columns["object"][rows.start]), "object"),
        category=category,
        fold=int(columns["fold"][rows.start]),
        grasp_type=grasp_type,
        success=columns["success"][rows].astype(bool),
        collides=columns["collides"][rows].astype(bool),
        votes=columns["votes"][rows],
        scores={name[6:]: values[rows] for name, values in columns.items() if name.startswith("score_")},
        probability_before=columns["probability_before"][rows],
        probability=columns["probability"][rows],
        pose=pose,
    )
