"""Trainings that take a second or two, of a few of the objects in data/."""

import csv
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import torch
from commands import ROOT

import spgf_torch
from spgf_torch.simulation.table import read_table

SMALL: dict[str, Any] = {
    "K": 3,
    "sensing": {"width": 160, "height": 120, "focal": 144},
    "prototypes": {"restarts": 1, "subsample": 1000},
    "affordance": {"features_per_object": 40},
    "bootstrap": 100,
    "inner_grasps": 100,
    "trials_per_object": 200,
    "cache": "off",
}
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def objects_in(folder: Path, *names: str) -> Path:
    """A folder with these of the described objects."""
    folder.mkdir(parents=True)
    for name in names:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", folder)
    return folder


def trained(objects: Any, out: Path | None, **changes: Any) -> "spgf_torch.Predictor":
    return spgf_torch.train(objects, out=out, **{"trials": ROOT / "data/trials", **SMALL, **changes})


def rows_of(name: str, wanted: Iterable[int] | None = None) -> list[dict[str, Any]]:
    """Trials of data/trials as rows of a table of one's own."""
    table = read_table(ROOT / f"data/trials/{name}.parquet")
    rows = []
    for i in range(len(table)) if wanted is None else wanted:
        pose = torch.cat([table.position[i], table.quaternion[i]]).tolist()
        kind = table.grasp_types[int(table.grasp_type[i])]
        rows.append(
            {"object": name, "type": kind, **dict(zip(POSE, pose, strict=True)), "success": int(table.success[i])}
        )
    return rows


def written(path: Path, rows: Sequence[dict[str, Any]]) -> Path:
    """A CSV file of these rows, with the columns of the first."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path
