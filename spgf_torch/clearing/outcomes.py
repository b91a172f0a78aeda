"""What rounds came to: success a grasp (GSR), objects cleared (DR), causes, probabilities and seconds.

A grasp succeeds when exactly one object is lifted and held; GSR is the share of attempts that do, DR the share of the
objects that scenes began with which were so taken away: what rolled off the table counts against it.
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from spgf_torch.clearing.config import NETWORK, OURS, ClutterConfig
from spgf_torch.clearing.rounds import ClearedScene
from spgf_torch.drawing.clutter_records import MethodRates, Share
from spgf_torch.evaluation.reliability import auc, brier, reliability

SCHEMA = 1
RESULTS = "results.json"
# Of every attempt and of every scene, a column each in CSV.
Row = dict[str, Any]


@dataclass(frozen=True)
class Counts:
    """(S,) int64 each: of every scene the grasps that succeeded, the attempts, and the objects that it began with."""

    taken: np.ndarray
    tried: np.ndarray
    there: np.ndarray

    @staticmethod
    def of(scenes: Sequence[ClearedScene]) -> Counts:
        rows = [(s.round.cleared, len(s.round.attempts), len(s.round.objects)) for s in scenes]
        return Counts(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)

    def gsr(self) -> tuple[np.ndarray, np.ndarray]:
        return self.taken, self.tried

    def dr(self) -> tuple[np.ndarray, np.ndarray]:
        return self.taken, self.there


# What a rate is the sum of, over the sum of what, of every scene.
Parts = Callable[[Counts], tuple[np.ndarray, np.ndarray]]


def resampled(counts: Counts, parts: Parts, config: ClutterConfig) -> np.ndarray:
    """(B,) the rate of B draws of as many scenes with replacement, the same draws for all runs; NaN of no attempts."""
    part, whole = parts(counts)
    drawn = np.random.default_rng(config.seed).integers(len(whole), size=(config.bootstrap, len(whole)))
    sums = part[drawn].sum(axis=1), whole[drawn].sum(axis=1)
    return np.divide(*sums, out=np.full(len(drawn), np.nan), where=sums[1] > 0)


def share(counts: Counts, parts: Parts, config: ClutterConfig) -> Share:
    """A rate over all scenes and its 95 % percentile interval; NaN where there is nothing."""
    part, whole = parts(counts)
    if not whole.sum():
        return Share(np.nan, np.nan, np.nan)
    low, high = np.nanquantile(resampled(counts, parts, config), (0.025, 0.975))
    return Share(float(part.sum() / whole.sum()), float(low), float(high))


def clutter_results(scenes: Sequence[ClearedScene], config: ClutterConfig) -> dict[str, Any]:
    """The content of `results.json`: rates are fractions, each with its 95 % interval over scenes, seconds medians."""
    counts = Counts.of(scenes)
    gsr, dr = share(counts, Counts.gsr, config), share(counts, Counts.dr, config)
    return {
        "schema": SCHEMA,
        "method": config.method,
        "hand": config.hand.name,
        "arrangement": config.arrangement.kind,
        "views": config.views,
        "table": config.table,
        "held_out": config.held_out,
        "seed": config.seed,
        "scenes": len(scenes),
        "objects": int(counts.there.sum()),
        "attempts": int(counts.tried.sum()),
        **stated("gsr", gsr),
        **stated("dr", dr),
        "ended": dict(Counter(scene.round.ended for scene in scenes).most_common()),
        "causes": causes(scenes),
        "probability": foretold(scenes, config),
        "seconds": median_seconds(scenes),
        "per_scene": [scene_row(scene) for scene in scenes],
    }


def stated(key: str, its: Share) -> dict[str, Any]:
    """A rate in `results.json`, where none is null."""
    value, low, high = (None if np.isnan(number) else number for number in (its.value, its.low, its.high))
    return {key: value, f"{key}_interval95": [low, high]}


def share_in(results: Mapping[str, Any], key: str) -> Share:
    """A rate of `results.json`; NaN where there is none."""
    return Share(*(np.nan if number is None else number for number in (results[key], *results[f"{key}_interval95"])))


def causes(scenes: Sequence[ClearedScene]) -> dict[str, int]:
    """Why attempts failed -> how many, the most frequent first."""
    failed = Counter(each.cause for scene in scenes for each in scene.round.attempts if not each.success)
    return dict(sorted(failed.items(), key=lambda item: (-item[1], item[0])))


def foretold(scenes: Sequence[ClearedScene], config: ClutterConfig) -> dict[str, float | None] | None:
    """How far the probability of executed grasps can be trusted; None of a method that foretells none.

    AUC: how often of two grasps the one that held had the higher, None where all or none held; ECE: expected
    calibration error.
    """
    if config.method not in (OURS, NETWORK):
        return None
    each = [tried for scene in scenes for tried in scene.round.attempts]
    p, success = np.array([tried.probability for tried in each]), np.array([tried.success for tried in each], bool)
    if not len(p):
        return dict.fromkeys(("mean", "auc", "brier", "ece"))
    order = auc(p, success) if 0 < success.sum() < len(success) else None
    return {"mean": float(p.mean()), "auc": order, "brier": brier(p, success), "ece": reliability(p, success).ece}


def median_seconds(scenes: Sequence[ClearedScene]) -> dict[str, float]:
    """Of the processor, of an attempt."""
    each = [[its.sensing, its.planning, its.execution] for scene in scenes for its in scene.measured]
    medians = np.median(each, axis=0) if each else np.zeros(3)
    return dict(zip(("sensing", "planning", "execution"), map(float, medians), strict=True))


def rates(results: Mapping[str, Any], name: str) -> MethodRates:
    """Of `results.json`, for the page; `name`: as it is shown."""
    numbers = results["scenes"], results["objects"], results["attempts"]
    shares = share_in(results, "gsr"), share_in(results, "dr")
    return MethodRates(name, *numbers, *shares, results["causes"], results["seconds"]["planning"])


def scene_row(scene: ClearedScene) -> Row:
    """A row of `scenes.csv`; `names`: of the objects that it began with."""
    its = scene.round
    return {
        "scene": scene.number,
        "seed": scene.seed,
        "fold": scene.fold,
        "objects": len(its.objects),
        "cleared": its.cleared,
        "attempts": len(its.attempts),
        "ended": its.ended,
        "names": [obj.name for obj in its.objects],
    }


def attempt_rows(scene: ClearedScene) -> list[Row]:
    """Rows of `attempts.csv`: `x`, `y`, `z`: the TCP, m; `down`: 1 where the hand comes from straight above."""
    rows = []
    for k, (tried, measured) in enumerate(zip(scene.round.attempts, scene.measured, strict=True)):
        x, y, z = tried.T_world_tcp[:3, 3].tolist()
        rows.append(
            {
                "scene": scene.number,
                "seed": scene.seed,
                "fold": scene.fold,
                "attempt": k,
                "left": len(tried.view.present),
                "grasp_type": tried.grasp_type,
                "probability": tried.probability,
                "success": int(tried.success),
                "cause": tried.cause,
                "object": "" if tried.taken is None else scene.round.objects[tried.taken].name,
                "touched": tried.touched,
                **{"x": x, "y": y, "z": z, "down": -float(tried.T_world_tcp[2, 2])},
                **asdict(measured),
            }
        )
    return rows


def csv_text(rows: Sequence[Mapping[str, Any]], digits: int = 6) -> str:
    """A line each below the names of the columns; nothing of no rows. NaN and None are empty, lists are JSON."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value, digits) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: Any, digits: int) -> Any:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    if isinstance(value, list):
        return json.dumps(value)
    return round(value, digits) if isinstance(value, float) else value
