"""The trial table: one Parquet file an object, what was tried and how it ended. Does not import sapien.

Columns: index (int32), type and outcome (dictionaries of words), position x y z (m) and quaternion w x y z of
T_object_tcp (float32). The file's metadata hold everything that the outcomes depend on (`Origin`).
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import torch
from torch import Tensor

from spgf_torch.config import GRASP_TYPES, InputError
from spgf_torch.geometry import se3
from spgf_torch.parquet import parquet_table
from spgf_torch.reading import existing, json_of, unreadable
from spgf_torch.sealing import BLANK, check_seal, sealed
from spgf_torch.sealing import KEY as SEAL
from spgf_torch.writing import write_bytes

SCHEMA = 1
OUTCOMES = ("success", "collision", "missed", "dropped", "slipped", "rotated")
POSITION, QUATERNION = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
COLUMNS = ("type", *POSITION, *QUATERNION, "outcome")
MOST_ROWS = 20_000_000  # of each of two types the most candidates that settings allow
UNIT = 1e-3  # off the length of a quaternion: float32 gives 1e-7
KEY = b"spgf_torch.trials"  # of the metadata in the Parquet schema


@dataclass(frozen=True)
class Origin:
    """What a table was made from: two tables with equal origins hold equal rows (on one machine type).

    Attributes:
        object_name, object_digest: the object (`GraspObject.digest`).
        hand_digest: the hand's URDF and settings (`Hand.digest`).
        sampler, episode: the settings as plain values.
        candidates: of each grasp type.
        seed: of the whole set; the object's own stream follows from it and the name.
    """

    object_name: str
    object_digest: str
    hand_digest: str
    sampler: dict[str, Any]
    episode: dict[str, Any]
    candidates: int
    seed: int


@dataclass(frozen=True)
class TrialTable:
    """The trials on one object.

    Attributes:
        origin: what it was made from.
        position: (M, 3) float32, m, and
        quaternion: (M, 4) float32 wxyz of T_object_tcp.
        grasp_type: (M,) int64, index into `config.GRASP_TYPES`.
        outcome: (M,) int64, index into `OUTCOMES`.
        versions: package -> version that made it.
    """

    origin: Origin
    position: Tensor
    quaternion: Tensor
    grasp_type: Tensor
    outcome: Tensor
    versions: dict[str, str]

    @property
    def object_name(self) -> str:
        return self.origin.object_name

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
    """Write `table` with its seal, at once or not at all."""
    columns: dict[str, Any] = {
        "index": np.arange(len(table), dtype=np.int32),
        "type": _words(table.grasp_type, GRASP_TYPES),
        **dict(zip(POSITION, table.position.numpy().T, strict=True)),
        **dict(zip(QUATERNION, table.quaternion.numpy().T, strict=True)),
        "outcome": _words(table.outcome, OUTCOMES),
    }
    about = {"schema": SCHEMA, "origin": asdict(table.origin), "versions": table.versions}
    content = pa.table(columns).replace_schema_metadata({KEY: json.dumps(about, sort_keys=True), SEAL: BLANK})
    sink = io.BytesIO()
    pq.write_table(content, sink, compression="zstd")
    write_bytes(path, sealed(sink.getvalue()))


def read_table(path: Path) -> TrialTable:
    """The table in one file.

    Raises InputError for a file that is missing, truncated, changed since it was written (`sealing`), or not a trial
    table of this schema.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a trial table, got no such file (make it: python -m spgf_torch.simulate)")
    check_seal(existing(path), "a trial table")
    content = parquet_table(path, "a trial table", COLUMNS, MOST_ROWS)
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
    table = TrialTable(
        origin=Origin(**about["origin"]),
        position=_floats(content, POSITION),
        quaternion=_floats(content, QUATERNION),
        grasp_type=_codes(path, content, "type", GRASP_TYPES),
        outcome=_codes(path, content, "outcome", OUTCOMES),
        versions=about["versions"],
    )
    rows = table.origin.candidates * len(GRASP_TYPES)
    if len(table) != rows:
        raise InputError(f"{path}: expected {rows} trials, got {len(table)}")
    if not (table.position.isfinite().all() and table.quaternion.isfinite().all()):
        raise InputError(f"{path}: expected finite poses, got NaN or infinite ones")
    length = torch.linalg.vector_norm(table.quaternion, dim=1)
    if len(table) and float((length - 1).abs().max()) > UNIT:
        raise InputError(
            f"{path}: expected quaternions of length 1, got {float(length.min()):.4g} to {float(length.max()):.4g}"
        )
    return table


def read_tables(folder: Path, expected: Iterable[Origin]) -> list[TrialTable]:
    """The tables of `expected`, in its order.

    Raises InputError where one is missing or damaged or was made from something else than expected.
    """
    tables = []
    for origin in expected:
        path = table_path(folder, origin.object_name)
        table = read_table(path)
        compare(path, origin, table.origin)
        tables.append(table)
    return tables


def compare(path: Path, expected: Origin, got: Origin) -> None:
    """Raises InputError for the first thing that what is in `path` was made from and that is not as expected."""
    for key, value in asdict(expected).items():
        other = getattr(got, key)
        if isinstance(value, dict) and isinstance(other, dict):
            changed = [name for name in value if value[name] != other.get(name)]
            if changed:
                key, value, other = f"{key}.{changed[0]}", value[changed[0]], other.get(changed[0])
        if value != other:
            raise InputError(f"{path}: expected trials made with {key} {_short(value)}, got {_short(other)}")


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:12] + "..."


def _words(codes: Tensor, words: tuple[str, ...]) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(pa.array(codes.numpy().astype(np.int8)), pa.array(words))


def _codes(path: Path, content: pa.Table, column: str, words: tuple[str, ...]) -> Tensor:
    values = content[column].cast(pa.string())
    codes = pc.index_in(values, pa.array(words))
    if codes.null_count:
        unknown = set(values.to_pylist()) - set(words)
        raise InputError(f"{path}: expected {column} one of {', '.join(words)}; got {min(map(str, unknown))}")
    return torch.from_numpy(codes.to_numpy().astype(np.int64))


def _floats(content: pa.Table, columns: tuple[str, ...]) -> Tensor:
    return torch.from_numpy(np.column_stack([content[name].to_numpy() for name in columns]).astype(np.float32))
