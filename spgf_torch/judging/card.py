"""The card of a judge: what it learned from, how it did, what its numbers are good for."""

from __future__ import annotations

from typing import Any

from spgf_torch.files.card_header import card_header
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.scene_validation import scene_lines
from spgf_torch.proposing.judge import Judge

LIMITS = """\
- Held means held in simulation (SAPIEN): rigid bodies, one friction value, no arm; the table takes part through the
  open hand, which stays above it.
- Of this hand and these openings alone, and of clouds as these simulated cameras give them.
- Unseen space wants depth images. A bare cloud is judged by geometry alone, which with one view is less.
- A depth camera's missing returns count as seen through: dark, shiny and transparent things are not known to be there.
- The objects that it was measured on are of the same make as those that it learned from, though not the same ones."""


def judge_card(judge: Judge, config: JudgeConfig, size: int) -> str:
    """The text of the folder's README.md; `size`: bytes of the arrays."""
    results, best = judge.results, config.best
    rows = "\n".join(_row(name, row, best) for name, row in results["executed"].items())
    unfit = {place: ", ".join(names) or "nothing" for place, names in results["unfit"].items()}
    validated = "\n".join(
        f"| {name} | {known} | {row['trials']} | {row['auc']:.3f} | {row['brier']:.3f} | {row['ece']:.3f} |"
        for name, block in results["cross_validated"].items()
        for known, row in block.items()
    )
    return f"""\
{card_header(config.hand.name, library_name="spgf_torch", pipeline_tag="robotics")}
# Judge of grasp hypotheses, {config.hand.name}

Written by `python -m spgf_torch.judge`; every setting is in `config.yaml`. P(free) x P(holds | free), each as
{config.form}, {size / 1e6:.2f} MB. Use: `predict judge=THIS_FOLDER`, `evaluate judge=THIS_FOLDER`.

## Learned from
{len(judge.taught)} objects (`{config.objects}`): {config.candidates} random trials of each type on each, and
{results["trials"]["own"]:,} of its own choosing in {config.rounds} rounds, of which {results["trials"]["own_held"]:,}
held; {results["rows"]:,} rows, of which {results["trials"]["surveyed_rows"]:,} say by the mesh alone whether a
hypothesis is free.

## On objects that it had not seen
The {best} best of judges of all rounds that the other folds taught ({config.folds} over objects), executed; percent,
means over objects with 95 % intervals. Probabilities are calibrated with what was executed on the other folds, of one
view and of several.

| cloud | objects | top {best} | top 1 | collided | random hypotheses | predicted | ECE | Brier |
|---|---|---|---|---|---|---|---|---|
{rows}

"That fit": with at least {best} grasps, no two the same, between opposite places of the true surface within the
friction cone, that leave {1000 * config.hypotheses.play:g} mm of play on either side and the open hand clear of the
object and of the table. Trials and judges take no part in that. What does not fit, on a table: {unfit["on a table"]};
alone: {unfit["alone"]}.

All tried hypotheses, judged by cross-validation over objects with all rounds:

| cloud | known | trials | AUC | Brier | ECE |
|---|---|---|---|---|---|
{validated}

{scenes_card(results.get("in_scenes", {}))}## Limits
{LIMITS}
"""


def scenes_card(results: dict[str, Any]) -> str:
    """How a judge that learned in scenes did there beside one that did not; nothing of another."""
    if not results:
        return ""
    rows = "\n".join(f"| {' | '.join(line)} |" for line in scene_lines(results))
    return f"""\
## In scenes of objects that it had not seen
Tables full of things, other than those that it learned in: what the judge of single objects and what the judge that
learned in scenes chose in the same clouds, executed; percent. Gain: of the share of the best that succeed, paired by
scene, with 95 % intervals over scenes.

| cloud | ranked by | best | first | predicted | AUC | ECE | Brier | gain |
|---|---|---|---|---|---|---|---|---|
{rows}

"""


def _row(name: str, row: dict[str, Any], best: int) -> str:
    """One kind of cloud: all objects, and below those that fit the hand."""
    shares = [f"{100 * row[key]:.1f}" for key in ("collided", "random", "predicted")]
    lines = [[name, f"all {row['objects']}", *_rates(row, best), *shares, f"{row['ece']:.3f}", f"{row['brier']:.3f}"]]
    if fit := row["fit"]:
        lines.append(
            [name, f"{fit['objects']} that fit", *_rates(fit, best), f"{100 * fit['collided']:.1f}", *[""] * 4]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _rates(rates: dict[str, Any], best: int) -> list[str]:
    return [
        f"{100 * rates[key]:.1f} ({100 * rates[f'{key}_interval95'][0]:.0f} to "
        f"{100 * rates[f'{key}_interval95'][1]:.0f})"
        for key in (f"top{best}", "top1")
    ]
