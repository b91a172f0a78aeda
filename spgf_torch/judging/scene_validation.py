"""How judges that learned in scenes do there beside judges that did not: what they chose in the same clouds, tried."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from spgf_torch.evaluation.reliability import brier, reliability
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.scene_benches import KINDS
from spgf_torch.judging.scene_rounds import OBJECT, SCENE
from spgf_torch.judging.scene_trials import PROPOSERS, SceneTrials
from spgf_torch.judging.validation import auc


def compared(trials: SceneTrials, config: JudgeConfig) -> dict[str, Any]:
    """Of what judges of either sort chose in the same clouds: rates, and their difference, paired by scene.

    Of each number of views in scenes of each kind and in all.
    """
    assert config.context is not None  # there are trials in scenes
    found: dict[str, Any] = {}
    for index, views in enumerate(config.context.views):
        of_views = trials.at(trials.cloud == index)
        for kind, name in enumerate((*KINDS, "all")):
            its = of_views if name == "all" else of_views.at(of_views.kind == kind)
            if len(its):
                found[f"{views} view{'s' * (views > 1)}, {name}"] = _paired(its, config)
    return found


def _paired(trials: SceneTrials, config: JudgeConfig) -> dict[str, Any]:
    each = {who: trials.at(trials.by == who) for who in (OBJECT, SCENE)}
    rates = {who: _by_scene(chosen) for who, chosen in each.items()}
    both = sorted(set(rates[OBJECT]) & set(rates[SCENE]))
    gain = np.array([rates[SCENE][scene] - rates[OBJECT][scene] for scene in both])
    return {
        "scenes": len(both),
        **{PROPOSERS[who]: _rates(chosen, rates[who]) for who, chosen in each.items()},
        "gain": float(gain.mean()),
        "gain_interval95": _interval(gain, config),
    }


def scenes_table(results: Mapping[str, Any]) -> Table:
    """`compared` for people, in percent."""
    table = Table(
        title="Held in SAPIEN (%): the best of judges who had not seen the objects of the scenes",
        caption="gain: of the share of the best that succeed, paired by scene, with its 95 % interval over scenes.",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("")
    for heading in ("ranked by", "best", "first", "predicted", "AUC", "ECE", "Brier", "gain"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in scene_lines(results):
        table.add_row(*row)
    return table


def scene_lines(results: Mapping[str, Any]) -> list[list[str]]:
    """Of each kind of cloud a line for each sort of judge, as words."""
    lines = []
    for name, block in results.items():
        low, high = block["gain_interval95"]
        gain = f"{100 * block['gain']:+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"
        for who in (OBJECT, SCENE):
            its = block[PROPOSERS[who]]
            shares = [f"{100 * its[key]:.1f}" for key in ("best", "first", "predicted")]
            quality = [f"{its[key]:.3f}" for key in ("auc", "ece", "brier")]
            lines.append([name, PROPOSERS[who], *shares, *quality, gain if who == SCENE else ""])
    return lines


def _by_scene(trials: SceneTrials) -> dict[int, float]:
    """Of each scene, by a number of its own, the share that succeeded."""
    number = trials.scene * len(KINDS) + trials.kind
    return {scene: float(trials.success[number == scene].double().mean()) for scene in number.unique().tolist()}


def _rates(trials: SceneTrials, by_scene: Mapping[int, float]) -> dict[str, float]:
    p, success = trials.probability.double().numpy(), trials.success.numpy()
    return {
        "best": float(np.mean(list(by_scene.values()))),
        "first": float(trials.success[trials.rank == 0].double().mean()),
        "predicted": float(p.mean()),
        "auc": auc(p, success),
        "ece": reliability(p, success).ece,
        "brier": brier(p, success),
        "trials": len(trials),
    }


def _interval(values: np.ndarray, config: JudgeConfig) -> list[float]:
    drawn = np.random.default_rng(config.seed).choice(values, size=(config.bootstrap, len(values)))
    return np.quantile(drawn.mean(axis=1), (0.025, 0.975)).tolist()
