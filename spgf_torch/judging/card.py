"""The card of a judge: what it learned from, how it did, what its numbers are good for."""

from __future__ import annotations

from spgf_torch.config import JudgeConfig
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
    rows = "\n".join(
        f"| {name} | {100 * row[f'top{best}']:.1f} ({100 * row[f'top{best}_interval95'][0]:.0f} to "
        f"{100 * row[f'top{best}_interval95'][1]:.0f}) | {100 * row['top1']:.1f} | {100 * row['random']:.1f} | "
        f"{100 * row['collided']:.1f} | {100 * row['predicted']:.1f} | {row['ece']:.3f} | {row['brier']:.3f} |"
        for name, row in results["executed"].items()
    )
    validated = "\n".join(
        f"| {name} | {known} | {row['trials']} | {row['auc']:.3f} | {row['brier']:.3f} | {row['ece']:.3f} |"
        for name, block in results["cross_validated"].items()
        for known, row in block.items()
    )
    return f"""\
# Judge of grasp hypotheses, {config.hand.name}

Written by `python -m spgf_torch.judge`; every setting is in `config.yaml`. P(free) x P(holds | free), each as
{config.form}, {size / 1e6:.2f} MB. Use: `predict judge=THIS_FOLDER`, `evaluate judge=THIS_FOLDER`.

## Learned from
{len(judge.taught)} objects (`{config.objects}`): {config.candidates} random trials of each type on each, and
{results["trials"]["own"]:,} of its own choosing in {config.rounds} rounds, of which {results["trials"]["own_held"]:,}
held; {results["rows"]:,} rows.

## On objects that it had not seen
Hypotheses chosen in the last round by judges of the other folds ({config.folds} over objects), executed; percent, means
over objects with 95 % intervals:

| cloud | top {best} | top 1 | random hypotheses | collided | predicted | ECE | Brier |
|---|---|---|---|---|---|---|---|
{rows}

All tried hypotheses, judged by cross-validation over objects with all rounds:

| cloud | known | trials | AUC | Brier | ECE |
|---|---|---|---|---|---|
{validated}

## Limits
{LIMITS}
"""
