"""The learning curve of every row of a comparison. Numbers in, a matplotlib figure out."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from spgf_torch.drawing.style import CEILING, CHANCE, LETTERS, METHOD_COLOURS
from spgf_torch.reporting.data.comparison import Comparison
from spgf_torch.reporting.pages.table1 import NAMES

MARKERS = "osD^vPX"
KIND = "CG"


def learning_curves(comparison: Comparison) -> Figure:
    """CG over the trials of each type that a training object teaches: a panel for all objects and for each class.

    The band is the 95 % interval of the reference.
    """
    names = ["all", *(name for name in NAMES if name != "all" and name in comparison.random)]
    known = {entry.name for entry in comparison.entries}  # in an order that does not change with the rates
    rows = sorted(known, key=lambda name: (name != comparison.reference, name))
    looks = {
        row: {"color": METHOD_COLOURS[i % len(METHOD_COLOURS)], "marker": MARKERS[i % len(MARKERS)], "markersize": 4}
        for i, row in enumerate(rows)
    }
    with mpl.rc_context(LETTERS):
        width, height = 0.95 + 2.35 * len(names), 3.4
        figure = Figure(figsize=(width, height))
        figure.subplots_adjust(0.75 / width, 0.55 / height, 1 - 0.1 / width, 1 - 0.7 / height, wspace=0.08)
        axes = figure.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
        for axis, name in zip(axes, names, strict=True):
            _panel(axis, comparison, name, looks)
        axes[0].set_ylabel(f"{KIND} success-rate (%)\nranking {comparison.ranking}")
        axes[0].set_ylim(-3, 103)
        figure.supxlabel("trials of each type on each training object", fontsize=9, y=0.02)
        handles = [Line2D([], [], linewidth=1.6, label=row, **look) for row, look in looks.items()]  # type: ignore[arg-type]
        handles += [
            Line2D([], [], color=CHANCE, linestyle=(0, (4, 3)), label="random candidate"),
            Line2D([], [], color=CEILING, linestyle=":", label="ceiling"),
        ]
        figure.legend(handles=handles, loc="upper center", ncols=len(handles))
    return figure


def _panel(axis: Axes, comparison: Comparison, name: str, looks: dict[str, dict]) -> None:
    for row, look in looks.items():
        curve = [entry for entry in comparison.curve(row) if name in entry.rates]
        trials = [entry.trials for entry in curve]
        if row == comparison.reference:
            bounds = np.array([entry.bounds[name][KIND] for entry in curve])
            axis.fill_between(trials, *(100 * bounds.T), color=look["color"], alpha=0.15, linewidth=0)
        axis.plot(trials, [100 * entry.rates[name][KIND] for entry in curve], linewidth=1.6, **look)
    axis.axhline(100 * comparison.random[name][KIND], color=CHANCE, linestyle=(0, (4, 3)), linewidth=1)
    axis.axhline(100 * comparison.ceiling[name][KIND], color=CEILING, linestyle=":", linewidth=1.2)
    ticks = sorted({entry.trials for entry in comparison.entries})
    axis.set(xscale="log", title=name)
    axis.set_xticks(ticks, [str(n) for n in ticks])
    axis.xaxis.set_minor_locator(NullLocator())
