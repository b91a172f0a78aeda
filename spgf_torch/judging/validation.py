"""How far a judge can be trusted, on objects that it had not seen: by its own best grasps, and by cross-validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from rich import box
from rich.table import Table
from torch import Tensor

from spgf_torch.evaluation.reliability import auc, brier, reliability
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.learning import calibration_of
from spgf_torch.judging.training_rows import PICKED, SAMPLED, Bench, Rows
from spgf_torch.proposing.judge import KNOWN, Judge, calibrated
from spgf_torch.proposing.judge_features import NAMES


def executed(
    rows: Rows, benches: Sequence[Bench], fold: np.ndarray, fit: Mapping[int, Mapping[bool, bool]], config: JudgeConfig
) -> dict[str, dict[str, Any]]:
    """Of the best hypotheses in each kind of cloud, by judges of all rounds that had not seen the object: rates.

    Rates are means over objects, each with its interval, over all objects and ("fit") over those that fit the hand. A
    hypothesis that a cloud lacks to `config.best` counts as a failure. What is said of a grasp is calibrated with the
    executed best of the other folds.

    Args:
        fold: (objects,) int, of each object. fit: of each object, by its index, `objects_that_fit.fits`.
    """
    best = validation_rows(rows, config)
    chance = rows.at(rows.home & (rows.round == config.rounds) & (rows.rank == PICKED))
    said = calibrated_elsewhere(best, fold, config)
    on_table = {bench.index: [cloud.on_table for cloud in bench.clouds] for bench in benches}
    found = {}
    for name, clouds in kinds(benches).items():
        inside = _in(best, clouds)
        if not inside.any():
            continue
        fitting = {o: its for o, its in clouds.items() if fit[o][on_table[o][its[0]]]}
        of_kind, p, success = best.at(inside), said[inside].numpy(), best.success[inside].numpy()
        picked = chance.success[_in(chance, clouds)]
        found[name] = {
            **_rates(of_kind, clouds, config),
            "random": float(picked.double().mean()) if len(picked) else 0.0,
            "predicted": float(p.mean()),
            "ece": reliability(p, success).ece,
            "ece_uncalibrated": reliability(of_kind.probability.double().numpy(), success).ece,
            "brier": brier(p, success),
            "sure": int((p >= config.sure).sum()),
            "sure_held": int(success[p >= config.sure].sum()),
            "fit": _rates(of_kind.at(_in(of_kind, fitting)), fitting, config) if fitting else None,
        }
    return found


def validation_rows(rows: Rows, config: JudgeConfig) -> Rows:
    """The executed best of judges that all rounds had taught but for the object's fold."""
    return rows.at(rows.home & (rows.round == config.rounds + 1) & (rows.rank >= 0))


def calibrated_elsewhere(best: Rows, fold: np.ndarray, config: JudgeConfig) -> Tensor:
    """(R,) f64: what is said of executed grasps, calibrated with those on objects of the other folds."""
    folds, views = torch.from_numpy(fold)[best.obj], best.numbers[:, NAMES.index("views")]
    said = best.probability.double()
    for held_out in range(config.folds):
        of = folds == held_out
        said[of] = calibrated(best.probability[of], views[of], calibration_of(best.at(~of)))
    return said


def _rates(best: Rows, clouds: dict[int, list[int]], config: JudgeConfig) -> dict[str, Any]:
    top = _by_object(best, clouds, config.best)
    first = _by_object(best.at(best.rank == 0), clouds, 1)
    return {
        "clouds": sum(map(len, clouds.values())),
        "objects": len(clouds),
        f"top{config.best}": float(top.mean()),
        f"top{config.best}_interval95": _interval(top, config),
        "top1": float(first.mean()),
        "top1_interval95": _interval(first, config),
        "collided": float((~best.free).double().mean()) if len(best) else 0.0,
    }


def kinds(benches: Sequence[Bench]) -> dict[str, dict[int, list[int]]]:
    """Kind of cloud, such as "1 view, on a table" -> object -> which of its clouds."""
    found: dict[str, dict[int, list[int]]] = {}
    for bench in benches:
        for number, cloud in enumerate(bench.clouds):
            views = f"{cloud.views} view{'s' * (cloud.views > 1)}"
            name = f"{views}, {'on a table' if cloud.on_table else 'alone'}"
            found.setdefault(name, {}).setdefault(bench.index, []).append(number)
    return dict(sorted(found.items()))


def cross_validated(
    rows: Rows, benches: Sequence[Bench], fold: np.ndarray, judges: Mapping[int, Judge]
) -> dict[str, Any]:
    """AUC, Brier score and ECE over all hypotheses that were tried, by judges that had not seen their object.

    Of each kind of cloud; with images and, of the same clouds, without. Probabilities are those before calibration.

    Args:
        fold: (objects,) int, of each object. judges: fold -> one that has not seen its objects.
    """
    folds = torch.from_numpy(fold)[rows.obj]
    said = {known: torch.zeros(len(rows), dtype=torch.float64) for known in KNOWN}
    for held_out, judge in judges.items():
        asked, bare = folds == held_out, replace(judge, calibration={})
        for known in KNOWN:
            said[known][asked] = bare.probability(rows.numbers[asked], known == "images").double()
    found: dict[str, Any] = {}
    for name, clouds in kinds(benches).items():
        of_kind = rows.home & (rows.rank > SAMPLED) & _in(rows, clouds)
        success = rows.success[of_kind].numpy()
        for known, p in said.items():
            p_kind = p[of_kind].numpy()
            found.setdefault(name, {})[known] = {
                "trials": len(success),
                "auc": auc(p_kind, success),
                "brier": brier(p_kind, success),
                "ece": reliability(p_kind, success).ece,
            }
    return found


def executed_table(results: dict[str, dict[str, Any]], best: int) -> Table:
    """`executed` for people, in percent."""
    table = Table(
        title="Held in SAPIEN (%): the best of judges who had not seen the object",
        caption="(low-high): 95 % interval over objects. fit: objects that fit the hand by their shape alone. random:\n"
        "hypotheses picked at random. predicted, ECE, Brier: calibrated on other objects.",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("")
    for heading in ("objects", f"top {best}", "top 1", "collided", "random", "predicted", "ECE", "Brier"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, row in results.items():
        shares = [f"{100 * row[key]:.1f}" for key in ("random", "predicted")]
        table.add_row(name, *_told(row, "", best), *shares, f"{row['ece']:.3f}", f"{row['brier']:.3f}")
        if row["fit"]:
            table.add_row("", *_told(row["fit"], " fit", best))
    return table


def _told(rates: dict[str, Any], which: str, best: int) -> list[str]:
    """How many objects, top `best` and top 1 with their intervals, collided."""
    tops = [
        f"{100 * rates[key]:.1f} ({100 * rates[f'{key}_interval95'][0]:.0f}-{100 * rates[f'{key}_interval95'][1]:.0f})"
        for key in (f"top{best}", "top1")
    ]
    return [f"{rates['objects']}{which}", *tops, f"{100 * rates['collided']:.1f}"]


def _in(rows: Rows, clouds: dict[int, list[int]]) -> Tensor:
    """(R,) bool: rows of these clouds of these objects."""
    inside = torch.zeros(len(rows), dtype=torch.bool)
    for obj, numbers in clouds.items():
        inside |= (rows.obj == obj) & torch.isin(rows.cloud, torch.tensor(numbers))
    return inside


def _by_object(rows: Rows, clouds: dict[int, list[int]], count: int) -> np.ndarray:
    """(objects,) share of successes among `count` grasps of each of its clouds."""
    successes = torch.bincount(rows.obj[rows.success], minlength=max(clouds) + 1)
    return np.array([float(successes[obj]) / (count * len(numbers)) for obj, numbers in clouds.items()])


def _interval(rates: np.ndarray, config: JudgeConfig) -> list[float]:
    """95 % percentile interval of the mean over objects drawn with replacement."""
    drawn = np.random.default_rng(config.seed).choice(rates, size=(config.bootstrap, len(rates)))
    return np.quantile(drawn.mean(axis=1), (0.025, 0.975)).tolist()
