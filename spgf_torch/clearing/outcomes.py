"""What rounds came to: success a grasp (GSR), objects cleared (DR), causes, probabilities and seconds.

A grasp succeeds when exactly one object is lifted and held; GSR is the share of attempts that do, DR the share of the
objects that scenes began with which were so taken away: what rolled off the table counts against it.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spgf_torch.clearing.config import NETWORK, OURS, ClutterConfig
from spgf_torch.clearing.rounds import ClearedScene
from spgf_torch.drawing.clutter_records import MethodRates, Share
from spgf_torch.evaluation.reliability import auc, brier, reliability

SCHEMA = 1
# Of every attempt and of every scene, a column each in CSV.
Row = dict[str, Any]


def clutter_results(scenes: Sequence[ClearedScene], config: ClutterConfig) -> dict[str, Any]:
    """The content of `results.json`: rates are fractions, each with its 95 % interval over scenes, seconds means."""
    taken, tried, there = counts(scenes)
    gsr, dr = share(taken, tried, config), share(taken, there, config)
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
        "objects": int(there.sum()),
        "attempts": int(tried.sum()),
        "gsr": gsr.value,
        "gsr_interval95": [gsr.low, gsr.high],
        "dr": dr.value,
        "dr_interval95": [dr.low, dr.high],
        "ended": dict(Counter(scene.round.ended for scene in scenes).most_common()),
        "causes": causes(scenes),
        "probability": foretold(scenes, config),
        "seconds": mean_seconds(scenes),
        "per_scene": [scene_row(scene) for scene in scenes],
    }


def counts(scenes: Sequence[ClearedScene]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(S,) int each: of every scene the grasps that succeeded, the attempts, and the objects that it began with."""
    rows = [(s.round.cleared, len(s.round.attempts), len(s.round.objects)) for s in scenes]
    taken, tried, there = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return taken, tried, there


def share(part: np.ndarray, whole: np.ndarray, config: ClutterConfig) -> Share:
    """Sum of part (S,) over sum of whole (S,), and its 95 % percentile interval over scenes drawn with replacement.

    NaN where there is nothing.
    """
    if not whole.sum():
        return Share(np.nan, np.nan, np.nan)
    rng = np.random.default_rng(config.seed)
    drawn = rng.integers(len(whole), size=(config.bootstrap, len(whole)))
    sums = part[drawn].sum(axis=1), whole[drawn].sum(axis=1)
    rates = sums[0][sums[1] > 0] / sums[1][sums[1] > 0]
    low, high = np.quantile(rates, (0.025, 0.975))
    return Share(float(part.sum() / whole.sum()), float(low), float(high))


def causes(scenes: Sequence[ClearedScene]) -> dict[str, int]:
    """Why attempts failed -> how many, the most frequent first."""
    failed = Counter(each.cause for scene in scenes for each in scene.round.attempts if not each.success)
    return dict(sorted(failed.items(), key=lambda item: (-item[1], item[0])))


def foretold(scenes: Sequence[ClearedScene], config: ClutterConfig) -> dict[str, float] | None:
    """How far the probability of executed grasps can be trusted; None of a method that foretells none.

    AUC: how often of two grasps the one that held had the higher; ECE: expected calibration error.
    """
    if config.method not in (OURS, NETWORK):
        return None
    each = [tried for scene in scenes for tried in scene.round.attempts]
    p, success = np.array([tried.probability for tried in each]), np.array([tried.success for tried in each], bool)
    found = {"mean": float(p.mean()) if len(p) else 0.0, "auc": auc(p, success), "brier": brier(p, success)}
    return {**found, "ece": reliability(p, success).ece}


def mean_seconds(scenes: Sequence[ClearedScene]) -> dict[str, float]:
    """Of the processor, of an attempt."""
    each = [[its.sensing, its.planning, its.execution] for scene in scenes for its in scene.seconds]
    means = np.array(each).mean(axis=0) if each else np.zeros(3)
    return dict(zip(("sensing", "planning", "execution"), map(float, means), strict=True))


def rates(scenes: Sequence[ClearedScene], config: ClutterConfig) -> MethodRates:
    """The same for the page."""
    taken, tried, there = counts(scenes)
    planning = [its.planning for scene in scenes for its in scene.seconds]
    return MethodRates(
        name=config.method,
        scenes=len(scenes),
        objects=int(there.sum()),
        attempts=int(tried.sum()),
        success=share(taken, tried, config),
        cleared=share(taken, there, config),
        causes=causes(scenes),
        seconds=float(np.median(planning)) if planning else np.nan,
    )


def scene_row(scene: ClearedScene) -> Row:
    """A row of `scenes.csv`."""
    its = scene.round
    return {
        "scene": scene.number,
        "seed": scene.seed,
        "fold": scene.fold,
        "objects": len(its.objects),
        "cleared": its.cleared,
        "attempts": len(its.attempts),
        "ended": its.ended,
        "names": " ".join(obj.name for obj in its.objects),
    }


def attempt_rows(scene: ClearedScene) -> list[Row]:
    """Rows of `attempts.csv`: `x`, `y`, `z`: the TCP, m; `down`: 1 where the hand comes from straight above."""
    rows = []
    for k, (tried, seconds, texlets) in enumerate(zip(scene.round.attempts, scene.seconds, scene.texlets, strict=True)):
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
                **{"x": x, "y": y, "z": z, "down": -float(tried.T_world_tcp[2, 2]), "texlets": texlets},
                **{"sensing": seconds.sensing, "planning": seconds.planning, "execution": seconds.execution},
            }
        )
    return rows


def csv_text(rows: Sequence[Mapping[str, Any]], digits: int = 6) -> str:
    """A line each below the names of the columns; nothing of no rows. NaN and None are empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value, digits) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: Any, digits: int) -> Any:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return round(value, digits) if isinstance(value, float) else value
