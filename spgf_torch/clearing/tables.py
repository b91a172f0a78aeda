"""What people see of rounds: a short table in the terminal, and a picture of why grasps failed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure
from rich import box
from rich.table import Table

from spgf_torch.clearing.outcomes import share_in
from spgf_torch.drawing.clutter_records import Share
from spgf_torch.drawing.page import drawn, png
from spgf_torch.drawing.style import FAILED


def clutter_table(results: Mapping[str, Any]) -> Table:
    """Of `results.json`, in percent."""
    views = f"{results['views']} view{'s' * (results['views'] > 1)}"
    table = Table(
        title=f"Clutter: {results['arrangement']}, {views}, {results['hand']}, {results['method']}",
        caption="(low-high): 95 % interval over scenes. GSR: grasps that held, of those tried. DR: objects taken away.",
        box=box.SIMPLE_HEAD,
    )
    for heading in ("scenes", "objects", "grasps", "GSR %", "DR %", "AUC", "ECE", "plan s"):
        table.add_column(heading, justify="right", no_wrap=True)
    said = results["probability"] or {}
    foretold = ("-" if said.get(key) is None else f"{said[key]:.2f}" for key in ("auc", "ece"))
    numbers = (str(results[key]) for key in ("scenes", "objects", "attempts"))
    shares = (percent(share_in(results, key)) for key in ("gsr", "dr"))
    table.add_row(*numbers, *shares, *foretold, f"{results['seconds']['planning']:.2f}")
    return table


def percent(share: Share) -> str:
    """`92 (84-98)`."""
    if share.value != share.value:
        return "-"
    return f"{100 * share.value:.1f} ({100 * share.low:.0f}-{100 * share.high:.0f})"


def cause_lines(results: Mapping[str, Any]) -> list[str]:
    """Why grasps failed and rounds ended."""
    lines = []
    if results["causes"]:
        told = ", ".join(f"{count} {cause}" for cause, count in results["causes"].items())
        lines.append(f"why {sum(results['causes'].values())} of {results['attempts']} grasps failed: {told}")
    ended = ", ".join(f"{count} {words}" for words, count in results["ended"].items())
    return [*lines, f"how {results['scenes']} rounds ended: {ended}"]


def causes_picture(causes: Mapping[str, int], attempts: int) -> bytes:
    """A PNG: a bar a cause, how many of all attempts failed of it."""
    figure = Figure(figsize=(5.0, 0.8 + 0.3 * max(1, len(causes))), layout="constrained")
    axes = figure.add_subplot()
    names, counts = list(causes), list(causes.values())
    bars = axes.barh(names, counts, color=FAILED)
    axes.bar_label(bars, [f"{count} ({count / attempts:.0%})" for count in counts], padding=3, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel(f"grasps that failed, of {attempts}")
    axes.set_xlim(0, 1.2 * max(counts, default=1))
    axes.grid(visible=False, axis="y")
    return png(drawn(figure))
