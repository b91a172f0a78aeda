"""The result files of an experiment, as other people's scripts read them (schema 1)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spgf_torch.affordance.config import JUDGE, NESTED
from spgf_torch.errors import InputError
from spgf_torch.evaluation.reliability import brier, predicted, reliability
from spgf_torch.evaluation.success import (
    Rates,
    bootstrap_interval,
    ceiling,
    class_means,
    paired_difference,
    random_rate,
    top_n,
)
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.files.reading import json_values
from spgf_torch.objects.config import CLASSES

if TYPE_CHECKING:
    from spgf_torch.evaluation.predictions import Predictions

SCHEMA = 1
# Key of results without rates: why there are none. What is null there.
NO_RATES = "no_rates"
RATES = (
    *("success_rate", "interval95", "by_ranking", "interval95_by_ranking", "random", "random_collision_free"),
    *("ceiling", "chosen", "calibration", "calibration_free"),
)
# Said wherever the ranking `nested` stands beside the paper's.
KNOWS_MORE = (
    "Our ranking, nested, is chosen inside the training folds, and knows more than the paper's: which grasps begin in "
    "a sensed collision."
)


@dataclass(frozen=True)
class ObjectRates:
    """Success-rates on one object: of every ranking, and what they are compared with."""

    by_ranking: dict[str, Rates]
    random: Rates
    random_collision_free: Rates
    ceiling: Rates


def object_rates(predictions: Predictions, n: int) -> ObjectRates:
    """Top-n success-rates of every ranking on one object, chance and ceiling."""
    success, grasp_type, types = predictions.success, predictions.grasp_type, predictions.grasp_types
    return ObjectRates(
        {name: top_n(score, success, grasp_type, n, types) for name, score in predictions.scores.items()},
        random_rate(success, grasp_type, types),
        random_rate(success, grasp_type, types, ~predictions.collides),
        ceiling(success, grasp_type, n, types),
    )


def build_results(objects: Sequence[Predictions], config: TrainConfig, dataset: str) -> dict[str, Any]:
    """The content of `results.json` but for `seconds`: rates are fractions; `dataset` names objects and trials."""
    classes, rates = [o.category for o in objects], [object_rates(o, config.N) for o in objects]
    types = objects[0].grasp_types
    rankings = {name: [r.by_ranking[name] for r in rates] for name in objects[0].scores}
    by_ranking = {name: class_means(classes, of_objects) for name, of_objects in rankings.items()}
    intervals = {
        name: bootstrap_interval(classes, of_objects, config.bootstrap, config.seed)
        for name, of_objects in rankings.items()
    }
    random = class_means(classes, [{name: r.random[name] for name in types} for r in rates])
    return {
        **_head(config, types, folds=len({o.fold for o in objects})),
        "success_rate": by_ranking[config.ranking],
        "interval95": intervals[config.ranking],
        "by_ranking": by_ranking,
        "interval95_by_ranking": intervals,
        "random": random,
        "random_collision_free": class_means(classes, [r.random_collision_free for r in rates]),
        "ceiling": class_means(classes, [r.ceiling for r in rates]),
        "chosen": {str(o.fold): o.chosen for o in sorted(objects, key=lambda o: o.fold)},
        "calibration": calibration_block(objects, free=False),
        "calibration_free": calibration_block(objects, free=True),
        "dataset": dataset,
        **(judge_blocks(objects, rankings, config) if JUDGE in rankings else {}),
    }


def unmeasured_results(types: Sequence[str], config: TrainConfig, dataset: str, why: str) -> dict[str, Any]:
    """The same of a run that measured nothing on novel objects: null in the place of each rate, and why in words."""
    return {
        **_head(config, types, folds=0),
        **dict.fromkeys(RATES),
        NO_RATES: why,
        "dataset": dataset,
    }


def _head(config: TrainConfig, types: Sequence[str], folds: int) -> dict[str, Any]:
    """What a run was: `folds` may be fewer than asked for where there are fewer objects."""
    return {
        "schema": SCHEMA,
        "hand": config.hand.name,
        "grasp_types": list(types),
        "K": config.K,
        "N": config.N,
        "seed": config.seed,
        "classwise": config.classwise,
        "folds": folds,
        "ranking": config.ranking,
    }


def judge_blocks(
    objects: Sequence[Predictions], rates: Mapping[str, Sequence[Rates]], config: TrainConfig
) -> dict[str, dict[str, Any]]:
    """What `results.json` holds more where a judge ranked: its paired difference to the votes, and its calibration.

    Brier score and calibration error are of the candidates that it judged, those without a sensed collision, of which
    `candidates` tells how many; the block `calibration` is of the votes.
    """
    classes = [o.category for o in objects]
    draws = (config.bootstrap, config.seed)
    mean, interval = paired_difference(classes, rates[JUDGE], rates[NESTED], *draws)
    block = {}
    for code, name in enumerate(objects[0].grasp_types):
        judged = [(o.grasp_type == code) & (o.scores[JUDGE] >= 0) for o in objects]
        p = np.concatenate([o.scores[JUDGE][mask] for o, mask in zip(objects, judged, strict=True)])
        success = np.concatenate([o.success[mask] for o, mask in zip(objects, judged, strict=True)])
        block[name] = {"candidates": len(p), "brier": brier(p, success), "ece": reliability(p, success).ece}
    return {
        "judge_minus_nested": {"mean": mean, "interval95": interval},
        "calibration_by_ranking": {JUDGE: block},
    }


def chosen_words(chosen: Mapping[str, str]) -> str:
    """How often each ranking was chosen: `log_odds in 4 of 5 folds, paper in 1 of 5 folds`."""
    counts = Counter(chosen.values()).most_common()
    return ", ".join(f"{name} in {count} of {len(chosen)} folds" for name, count in counts)


def calibration_block(objects: Sequence[Predictions], free: bool) -> dict[str, dict[str, float]]:
    """Of each grasp type: Brier score and expected calibration error of `PREDICTORS` on grasps of novel objects.

    Args:
        free: only on grasps without a sensed collision.
    """
    block: dict[str, dict[str, float]] = {}
    for code, grasp_type in enumerate(objects[0].grasp_types):
        of_predictor, success = predicted(objects, code, free)
        block[grasp_type] = {"candidates": len(success)}
        for end, probability in of_predictor.items():
            diagram = reliability(probability, success)
            block[grasp_type] |= {f"brier{end}": brier(probability, success), f"ece{end}": diagram.ece}
    return block


def read_results(path: Path) -> dict[str, Any]:
    """The content of a `results.json` of `train`. Raises InputError where it is missing, not one, or without rates."""
    if not path.is_file():
        raise InputError(f"{path}: expected the results of a run of train, got no such file")
    content = json_values(path, "the results of a run of train (interrupted?) as JSON", sealed=True)
    schema = content.get("schema") if isinstance(content, dict) else None
    rates = content.get("success_rate") if isinstance(content, dict) else None
    if schema != SCHEMA or isinstance(schema, bool):
        raise InputError(f"{path}: expected results of schema {SCHEMA}, got schema {str(schema)[:40]}")
    if rates is None and isinstance(why := content.get(NO_RATES), str):
        raise InputError(f"{path}: success_rate: expected rates on novel objects, got none: {why}")
    if not isinstance(rates, dict) or not set(CLASSES) & set(rates):
        raise InputError(f"{path}: success_rate: expected rates of {', '.join(CLASSES)}; got {str(rates)[:40]}")
    return content
