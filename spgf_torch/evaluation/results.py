"""The result files of an experiment, as other people's scripts read them (schema 1)."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.config import CLASSES, GRASP_TYPES, InputError, TrainConfig
from spgf_torch.evaluation.success import (
    TYPES,
    Rates,
    bootstrap_interval,
    ceiling,
    class_means,
    random_rate,
    top_n,
)

SCHEMA = 1
DIGITS = 6


@dataclass(frozen=True)
class Novel:
    """One object, predicted on by a model that had not seen it.

    Attributes:
        scores: ranking -> (G,) float score of each grasp.
        success (G,) bool, grasp_type (G,) int, collides (G,) bool: a sensed point lies inside the open hand.
    """

    name: str
    category: str
    fold: int
    scores: Mapping[str, np.ndarray]
    success: np.ndarray
    grasp_type: np.ndarray
    collides: np.ndarray


@dataclass(frozen=True)
class ObjectRates:
    """Success-rates on one object: of every ranking, and what they are compared with."""

    by_ranking: dict[str, Rates]
    random: Rates
    random_collision_free: Rates
    ceiling: Rates


def object_rates(novel: Novel, n: int) -> ObjectRates:
    """Top-n success-rates of every ranking on one object, chance and ceiling."""
    success, grasp_type = novel.success, novel.grasp_type
    return ObjectRates(
        {name: top_n(score, success, grasp_type, n) for name, score in novel.scores.items()},
        random_rate(success, grasp_type),
        random_rate(success, grasp_type, ~novel.collides),
        ceiling(success, grasp_type, n),
    )


def build_results(objects: Sequence[Novel], config: TrainConfig, seconds: Mapping[str, float]) -> dict[str, Any]:
    """The content of `results.json`: rates are fractions, `seconds` are wall times by stage."""
    classes, rates = [o.category for o in objects], [object_rates(o, config.N) for o in objects]
    rankings = {name: [r.by_ranking[name] for r in rates] for name in objects[0].scores}
    by_ranking = {name: class_means(classes, of_objects) for name, of_objects in rankings.items()}
    intervals = {
        name: bootstrap_interval(classes, of_objects, config.bootstrap, config.seed)
        for name, of_objects in rankings.items()
    }
    random = class_means(classes, [{kind: r.random[kind] for kind in GRASP_TYPES} for r in rates])
    return {
        "schema": SCHEMA,
        "K": config.K,
        "N": config.N,
        "seed": config.seed,
        "folds": config.folds,
        "ranking": config.ranking,
        "success_rate": by_ranking[config.ranking],
        "interval95": intervals[config.ranking],
        "by_ranking": by_ranking,
        "interval95_by_ranking": intervals,
        "random": random,
        "random_collision_free": class_means(classes, [r.random_collision_free for r in rates]),
        "ceiling": class_means(classes, [r.ceiling for r in rates]),
        "seconds": dict(seconds),
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with rates rounded to a millionth, at once or not at all."""
    write_text(path, json.dumps(_rounded(content), indent=1) + "\n")


def write_text(path: Path, content: str) -> None:
    """Write to a temporary name, flush to disk, rename."""
    part = path.with_name(path.name + ".part")
    with part.open("w", newline="") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


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


def read_results(path: Path) -> dict[str, Any]:
    """The content of a `results.json` of `train`. Raises InputError where it is missing or not one."""
    if not path.is_file():
        raise InputError(f"{path}: expected the results of a run of train, got no such file")
    try:
        content = json.loads(path.read_text())
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise InputError(f"{path}: expected JSON, got something else (an interrupted run?)") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SCHEMA or not set(CLASSES) & set(content.get("success_rate", {})):
        raise InputError(f"{path}: expected results of schema {SCHEMA}, got schema {schema}")
    return content


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, Mapping):
        return {key: _rounded(entry) for key, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list) else value
