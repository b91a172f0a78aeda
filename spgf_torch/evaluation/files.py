"""Writing an experiment's files: each is written atomically, and what is read again carries a digest."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.evaluation.results import object_rates
from spgf_torch.evaluation.success import ALL
from spgf_torch.files.digests import digest_of, sealed_json
from spgf_torch.files.writing import write_bytes, write_text

if TYPE_CHECKING:
    from spgf_torch.evaluation.predictions import Predictions

DIGITS = 6
RESULTS, FILES = "results.json", "files"
UNSEALED = ("config.yaml", "per_object.csv")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with rates rounded to a millionth, atomically."""
    write_text(path, json.dumps(rounded(content), indent=1) + "\n")


def write_results(folder: Path, content: Mapping[str, Any]) -> None:
    """`results.json` of a run, the last of its files: sealed, with the digests of those that have no room for one."""
    digests = {name: digest_of(folder / name) for name in UNSEALED if (folder / name).is_file()}
    write_bytes(folder / RESULTS, sealed_json(rounded({**content, FILES: digests}), indent=1))


def write_per_object(path: Path, objects: Sequence[Predictions], n: int) -> None:
    """`per_object.csv`: a row an object; rates of every ranking and type, chance, ceiling."""
    rows = []
    for obj in objects:
        rates = object_rates(obj, n)
        row: dict[str, Any] = {"object": obj.name, "class": obj.category, "fold": obj.fold}
        blocks = {**rates.by_ranking, "random": rates.random}
        blocks |= {"random_collision_free": rates.random_collision_free, "ceiling": rates.ceiling}
        for block, values in blocks.items():
            row |= {f"{block}_{name}": round(values[name], DIGITS) for name in (*obj.grasp_types, ALL)}
        rows.append(row)
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def rounded(value: Any) -> Any:
    """Plain values with every number rounded to `DIGITS`."""
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, Mapping):
        return {key: rounded(entry) for key, entry in value.items()}
    return [rounded(entry) for entry in value] if isinstance(value, list) else value
