"""Writing an experiment's files: each is there as a whole or not at all, and what is read again carries a digest."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.affordance.config import NESTED
from spgf_torch.evaluation.novel import Novel
from spgf_torch.evaluation.results import object_rates
from spgf_torch.evaluation.success import TYPES
from spgf_torch.files.sealing import BLANK, KEY, digest_of, sealed, sealed_json
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.hands.config import GRASP_TYPES

DIGITS = 6
RESULTS, FILES = "results.json", "files"
UNSEALED = ("config.yaml", "per_object.csv")
POSE = ("px", "py", "pz", "qw", "qx", "qy", "qz")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with rates rounded to a millionth, at once or not at all."""
    write_text(path, json.dumps(_rounded(content), indent=1) + "\n")


def write_results(folder: Path, content: Mapping[str, Any]) -> None:
    """`results.json` of a run, the last of its files: sealed, with the digests of those that have no room for one."""
    digests = {name: digest_of(folder / name) for name in UNSEALED if (folder / name).is_file()}
    write_bytes(folder / RESULTS, sealed_json(_rounded({**content, FILES: digests}), indent=1))


def write_per_object(path: Path, objects: Sequence[Novel], n: int) -> None:
    """`per_object.csv`: a row an object; rates of every ranking and type, chance, ceiling."""
    rows = []
    for novel in objects:
        rates = object_rates(novel, n)
        row: dict[str, Any] = {"object": novel.name, "class": novel.category, "fold": novel.fold}
        blocks = {**rates.by_ranking, "random": rates.random}
        blocks |= {"random_collision_free": rates.random_collision_free, "ceiling": rates.ceiling}
        for block, values in blocks.items():
            row |= {f"{block}_{kind}": round(values[kind], DIGITS) for kind in TYPES}
        rows.append(row)
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def write_predictions(path: Path, objects: Sequence[Novel]) -> None:
    """`predictions.parquet`: a row a candidate grasp of every object, with its scores, outcome and pose."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sizes = [len(o.success) for o in objects]
    columns: dict[str, Any] = {
        "object": pa.array(np.repeat([o.name for o in objects], sizes)).dictionary_encode(),
        "class": pa.array(np.repeat([o.category for o in objects], sizes)).dictionary_encode(),
        "fold": np.repeat(np.array([o.fold for o in objects], dtype=np.int8), sizes),
        "type": pa.array(np.array(GRASP_TYPES)[np.concatenate([o.grasp_type for o in objects])]).dictionary_encode(),
    }
    for name in ("success", "collides"):
        columns[name] = np.concatenate([getattr(o, name) for o in objects])
    columns["votes"] = np.concatenate([o.votes for o in objects]).astype(np.int32)
    for name in (name for name in objects[0].scores if name != NESTED):  # that one is one of the others
        columns[f"score_{name}"] = np.concatenate([o.scores[name] for o in objects]).astype(np.float32)
    for name in ("probability_before", "probability"):
        columns[name] = np.concatenate([getattr(o, name) for o in objects]).astype(np.float32)
    poses = np.concatenate([o.pose for o in objects]).astype(np.float32)
    columns |= {name: poses[:, i] for i, name in enumerate(POSE)}
    sink = io.BytesIO()
    pq.write_table(pa.table(columns).replace_schema_metadata({KEY: BLANK}), sink, compression="zstd")
    write_bytes(path, sealed(sink.getvalue()))


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, Mapping):
        return {key: _rounded(entry) for key, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list) else value
