"""The trial table: one Parquet file an object, candidates and their outcomes. Does not import sapien.

Columns: index (int32), type and outcome (dictionaries of words), position x y z (m) and quaternion w x y z of
T_object_tcp (float32); of a robot's episode also why each ended (`causes`). The file's metadata hold everything that
the outcomes depend on (`Provenance`).
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.files.digests import BLANK, check_seal, sealed
from spgf_torch.files.digests import KEY as SEAL
from spgf_torch.files.parquet import parquet_table
from spgf_torch.files.reading import existing, json_of, unreadable
from spgf_torch.files.writing import write_bytes
from spgf_torch.geometry import se3
from spgf_torch.simulation.causes import CAUSE_COLUMNS, Causes, has_causes
from spgf_torch.simulation.columns import codes_in, dictionary, floats, words_of

SCHEMA = 1
OUTCOMES = ("success", "collision", "missed", "dropped", "slipped", "rotated")
POSITION, QUATERNION = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
COLUMNS = ("type", *POSITION, *QUATERNION, "outcome")
MOST_ROWS = 20_000_000  # of two grasp types the most candidates that settings allow
UNIT = 1e-3  # off the length of a quaternion: float32 gives 1e-7
KEY = b"spgf_torch.trials"  # of the metadata in the Parquet schema


@dataclass(frozen=True)
class Provenance:
    """What a table was made from: two tables with equal provenances hold equal rows (on one machine type).

    Attributes:
        object_name, object_digest: the object (`GraspObject.digest`).
        hand_digest: the hand's URDF and settings (`Hand.digest`).
        sampler, episode: the settings as plain values.
        candidates: of each grasp type; with a budget, the most of each.
        seed: of the whole set; the object's own stream follows from it and the name.
        budget: trials that need physics, by which candidates were allotted (`allotment`); None: all were tried.
    """

    object_name: str
    object_digest: str
    hand_digest: str
    sampler: dict[str, Any]
    episode: dict[str, Any]
    candidates: int
    seed: int
    budget: int | None = None

    @property
    def plain(self) -> dict[str, Any]:
        """The fields by name, without a budget where there is none: such tables do not tell of it."""
        return {key: value for key, value in asdict(self).items() if key != "budget" or value is not None}


@dataclass(frozen=True)
class TrialTable:
    """The trials on one object.

    Attributes:
        provenance: what it was made from.
        position: (M, 3) float32, m, and
        quaternion: (M, 4) float32 wxyz of T_object_tcp.
        grasp_type: (M,) int64, index into `grasp_types`.
        outcome: (M,) int64, index into `OUTCOMES`.
        versions: package -> version that made it.
        grasp_types: names of the hand's grasp types, sorted.
        causes: why each ended; None of an episode that does not know.
    """

    provenance: Provenance
    position: Tensor
    quaternion: Tensor
    grasp_type: Tensor
    outcome: Tensor
    versions: dict[str, str]
    grasp_types: tuple[str, ...]
    causes: Causes | None = None

    @property
    def object_name(self) -> str:
        return self.provenance.object_name

    @cached_property
    def T_object_tcp(self) -> Tensor:  # noqa: N802
        """(M, 4, 4) float32, exactly the simulated poses."""
        return pose_matrix(self.position, self.quaternion)

    @cached_property
    def success(self) -> Tensor:
        """(M,) bool."""
        return self.outcome == OUTCOMES.index("success")

    def __len__(self) -> int:
        return len(self.outcome)


def pose_matrix(position: Tensor, quaternion: Tensor) -> Tensor:
    """T (M, 4, 4) float32 of a stored float32 position (M, 3) and quaternion (M, 4) wxyz.

    The one way from a stored pose to the simulated one: the same bits in, the same bits out.
    """
    return se3.pose(position.double(), quaternion.double()).float()


def table_path(folder: Path, object_name: str) -> Path:
    """Where an object's trials stand in the folder of a table."""
    return folder / f"{object_name}.parquet"


def write_table(path: Path, table: TrialTable) -> None:
    """Write `table` with its seal, atomically."""
    about = {"schema": SCHEMA, "origin": table.provenance.plain, "versions": table.versions}
    columns = columns_of(table) | (table.causes.columns() if table.causes else {})
    write_columns(path, columns, {KEY: json.dumps(about, sort_keys=True)})


def columns_of(table: Any) -> dict[str, Any]:
    """What is tried and how it ended, by the names of `COLUMNS`, and the rows' index; `table` has a `TrialTable`'s."""
    return {
        "index": np.arange(len(table.outcome), dtype=np.int32),
        "type": dictionary(table.grasp_type, table.grasp_types),
        **dict(zip(POSITION, table.position.numpy().T, strict=True)),
        **dict(zip(QUATERNION, table.quaternion.numpy().T, strict=True)),
        "outcome": dictionary(table.outcome, OUTCOMES),
    }


def write_columns(path: Path, columns: Mapping[str, Any], about: Mapping[bytes, str]) -> None:
    """Write a sealed Parquet file of these columns and metadata, atomically."""
    metadata: dict[Any, Any] = {**about, SEAL: BLANK}
    content = pa.table(dict(columns)).replace_schema_metadata(metadata)
    sink = io.BytesIO()
    pq.write_table(content, sink, compression="zstd")
    write_bytes(path, sealed(sink.getvalue()))


def read_table(path: Path) -> TrialTable:
    """The table in one file.

    Raises InputError for a file that is missing, truncated, changed since it was written (`digests`), or not a trial
    table of this schema.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a trial table, got no such file (make it: python -m spgf_torch.simulate)")
    check_seal(existing(path), "a trial table")
    content = parquet_table(path, "a trial table", COLUMNS + CAUSE_COLUMNS, MOST_ROWS)
    try:
        return _decoded(path, content)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, pa.ArrowException) as error:
        raise unreadable(path, "the columns of a trial table", error, "others") from error


def _decoded(path: Path, content: pa.Table) -> TrialTable:
    about = json_of((content.schema.metadata or {}).get(KEY, b"{}"), path, "a trial table")
    if about.get("schema") != SCHEMA:
        raise InputError(
            f"{path}: expected a trial table of schema {SCHEMA}, got {about.get('schema', 'a foreign file')}"
        )
    names = words_of(content, "type")
    provenance = Provenance(**about["origin"])
    table = TrialTable(
        provenance=provenance,
        position=floats(content, POSITION),
        quaternion=floats(content, QUATERNION),
        grasp_type=codes_in(path, content, "type", names),
        outcome=codes_in(path, content, "outcome", OUTCOMES),
        versions=about["versions"],
        grasp_types=names,
        causes=Causes.read(path, content) if has_causes(provenance.episode) else None,
    )
    _check_counts(path, table)
    check_poses(path, table.position, table.quaternion)
    return table


def _check_counts(path: Path, table: TrialTable) -> None:
    """InputError unless each type has as many trials as the provenance says; with a budget, as others have, at most."""
    most, names = table.provenance.candidates, table.grasp_types
    counts = torch.bincount(table.grasp_type, minlength=len(names)).tolist()
    rows = most if table.provenance.budget is None or not counts else min(counts[0], most)
    if set(counts) != {rows}:
        got = ", ".join(f"{count} of {name}" for name, count in zip(names, counts, strict=True)) or "none"
        raise InputError(f"{path}: expected {rows} trials of each grasp type, got {got:.200}")


def check_poses(path: Path, position: Tensor, quaternion: Tensor) -> None:
    """InputError unless positions (M, 3) are finite and quaternions (M, 4) of length 1."""
    if not (position.isfinite().all() and quaternion.isfinite().all()):
        raise InputError(f"{path}: expected finite poses, got NaN or infinite ones")
    length = torch.linalg.vector_norm(quaternion, dim=1)
    if len(length) and float((length - 1).abs().max()) > UNIT:
        raise InputError(
            f"{path}: expected quaternions of length 1, got {float(length.min()):.4g} to {float(length.max()):.4g}"
        )


def read_tables(folder: Path, expected: Iterable[Provenance], grasp_types: tuple[str, ...]) -> list[TrialTable]:
    """The tables of `expected`, in its order; `grasp_types`: the hand's.

    Raises InputError where one is missing or damaged, was made from something else than expected, or is of other types.
    """
    tables = []
    for provenance in expected:
        path = table_path(folder, provenance.object_name)
        table = read_table(path)
        compare(path, provenance, table.provenance)
        if table.grasp_types != grasp_types:
            told, got = ", ".join(grasp_types), ", ".join(table.grasp_types)
            raise InputError(f"{path}: expected trials of the hand's grasp types {told}; got {got:.200}")
        tables.append(table)
    return tables


def compare(path: Path, expected: Provenance, got: Provenance) -> None:
    """Raises InputError for the first thing that what is in `path` was made from and that is not as expected."""
    for key, value in asdict(expected).items():
        other = getattr(got, key)
        if isinstance(value, dict) and isinstance(other, dict):
            changed = [name for name in value if value[name] != other.get(name)]
            if changed:
                key, value, other = f"{key}.{changed[0]}", value[changed[0]], other.get(changed[0])
        if value != other:
            which = "; another hand, or another URDF or description of it" if key == "hand_digest" else ""
            raise InputError(f"{path}: expected trials made with {key} {_short(value)}, got {_short(other)}{which}")


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:12] + "..."
