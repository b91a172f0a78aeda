"""Flat charts: success-rate over K (Fig. 9), reliability, precision at N. Numbers in, matplotlib figures out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from spgf_torch.drawing.style import CEILING, CHANCE, LETTERS, PAPER, scale, type_colours
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.reliability import PREDICTORS, Reliability
from spgf_torch.evaluation.success import ALL
from spgf_torch.reporting.data.seeds import Repeats
from spgf_torch.reporting.pages.table1 import HEADINGS, NAMES

SHOWN_CLASSES = ("all", "containers")  # of K and reach: where the paper's rates depend on K, and all together
REACH_SCALE = [(0.0, "#E69F00"), (0.5, "#56B4E9"), (1.0, "#00416b")]  # near to far, also by lightness
BESIDE: Any = {
    "linestyle": (0, (1, 1)),
    "marker": "s",
    "markersize": 5.5,
    "markerfacecolor": "none",
    "linewidth": 1.2,
}  # another ranking of ours
PRINTED: Any = {"color": PAPER, "marker": "o", "markersize": 3.5, "markerfacecolor": "white", "linewidth": 1.2}
UNIT = (-0.025, 1.025)  # shares with room for the points at 0 and 1
FEW = 20  # grasps; a bin with fewer says little and is drawn hollow

Curves = Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]  # class -> mean, low, high: each (types, N)


@dataclass(frozen=True)
class Precision:
    """Precision at N of one run: the `shown` ranking with its bounds, another and the ceiling beside it.

    Attributes:
        names: of the two rankings. types: the grasp types and CG. beside: None where there is no other.
    """

    names: tuple[str, str]
    types: tuple[str, ...]
    shown: Curves
    beside: Mapping[str, np.ndarray] | None
    ceiling: Mapping[str, np.ndarray]


def success_over_k(rows: Sequence[Repeats], ranking: str, beside: str | None = None) -> Figure:
    """Fig. 9: a panel a type and class; ours with 95 % band, the paper's lighter, chance dashed, ceiling dotted.

    The paper's rates are drawn beside those of its own hand alone.

    Args:
        beside: another ranking of ours, drawn as a thin line without its band.
    """
    rows = [row for row in rows if ranking in row.by_ranking]
    other = [row for row in rows if beside in row.by_ranking]
    K, last = [row.K for row in rows], rows[-1]
    names = [name for name in NAMES if name in last.by_ranking[ranking]]
    colours = type_colours(last.types)
    printed = sorted(paper.SUCCESS_RATE) if last.of_papers_hand else []

    def draw(axis: Axes, name: str, kind: str) -> None:
        colour = colours[kind]
        axis.plot(printed, [paper.SUCCESS_RATE[k][name][kind] for k in printed], **PRINTED)
        _banded(axis, rows, ranking, name, kind, colour)
        if beside is not None:
            rates = [100 * row.rate(beside, name, kind) for row in other]
            axis.plot([row.K for row in other], rates, **BESIDE, color=colour)
        if kind != ALL:
            axis.axhline(100 * last.random[name][kind], color=CHANCE, linestyle=(0, (4, 3)), linewidth=1)
        axis.axhline(100 * last.ceiling[name][kind], color=CEILING, linestyle=":", linewidth=1.2)
        axis.set_xticks(sorted({*K, *printed}))

    legend = [
        *_ours(f"here: {HEADINGS.get(ranking, ranking)}, 95 % {'band' if len(K) > 1 else 'bars'}"),
        *(
            [Line2D([], [], **BESIDE, color="#202020", label=f"here: {HEADINGS.get(beside, beside)}")]
            if beside and other
            else []
        ),
        *([Line2D([], [], **PRINTED, label="the paper")] if printed else []),
        Line2D([], [], color=CHANCE, linestyle=(0, (4, 3)), label="random"),
        Line2D([], [], color=CEILING, linestyle=":", label="ceiling"),
    ]
    return _grid(draw, "number of prototypes K", legend, names, last.types)


def success_over_reach(curves: Mapping[float, Sequence[Repeats]], rankings: Sequence[str]) -> Figure:
    """CG over K, a line a reach (m) with its 95 % band: a row of all objects and one of containers, a column a ranking.

    The paper's rates, of which it does not say the reach, are grey, beside the first ranking of its own hand alone.
    """
    colours = dict(zip(curves, scale(REACH_SCALE)(np.linspace(0, 1, len(curves))), strict=True))
    ks = sorted({row.K for rows in curves.values() for row in rows})
    papers = all(row.of_papers_hand for rows in curves.values() for row in rows)
    printed = [k for k in paper.SUCCESS_RATE if k <= max(ks) and papers]
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(1 + 3.3 * len(rankings), 5.6))
        figure.subplots_adjust(0.09, 0.09, 0.985, 0.89, wspace=0.08, hspace=0.1)
        axes = figure.subplots(len(SHOWN_CLASSES), len(rankings), sharex=True, sharey=True, squeeze=False)
        for (i, name), (j, ranking) in product(enumerate(SHOWN_CLASSES), enumerate(rankings)):
            axis, theirs = axes[i, j], [paper.SUCCESS_RATE[k][name][ALL] for k in printed]
            if j == 0 and printed:
                axis.plot(printed, theirs, **PRINTED)
            for reach, rows in curves.items():
                _banded(axis, [row for row in rows if ranking in row.by_ranking], ranking, name, ALL, colours[reach])
            axis.set(ylim=(0, 103), xticks=ks)
            if i == 0:
                axis.set_title(HEADINGS.get(ranking, ranking), fontweight="bold")
        for i, name in enumerate(SHOWN_CLASSES):
            axes[i, 0].set_ylabel(f"{name}: CG success-rate (%)")
        figure.supxlabel("number of prototypes K", fontsize=9, y=0.015)
        legend = [
            Line2D([], [], color=colour, marker="o", markersize=4, label=f"votes within {1000 * reach:g} mm")
            for reach, colour in colours.items()
        ]
        if printed:
            legend.append(Line2D([], [], **PRINTED, label="the paper"))
        figure.legend(handles=legend, loc="upper center", ncols=len(legend))
    return figure


def _banded(axis: Axes, rows: Sequence[Repeats], ranking: str, name: str, kind: str, colour: Any) -> None:
    """A line over K with its 95 % band; of a single K with bars."""
    having = [row for row in rows if name in row.by_ranking[ranking]]
    K, rates = [row.K for row in having], np.array([row.rate(ranking, name, kind) for row in having])
    bounds = np.array([row.interval95[ranking][name][kind] for row in having])
    if len(K) > 1:
        axis.fill_between(K, *(100 * bounds.T), color=colour, alpha=0.15, linewidth=0)
    else:
        axis.errorbar(K, 100 * rates, 100 * np.abs(bounds.T - rates), color=colour, capsize=2.5, linewidth=1.2)
    axis.plot(K, 100 * rates, color=colour, marker="o", markersize=4, linewidth=1.8)


def precision_at_n(curves: Precision, n: int, random: Mapping[str, Mapping[str, float]]) -> Figure:
    """Share of successes among the N highest-ranked grasps over N; a thin line marks the N of the table."""
    most = next(iter(curves.shown.values()))[0].shape[-1]
    shown, beside = (HEADINGS.get(name, name) for name in curves.names)
    N, colours = np.arange(1, most + 1), type_colours(curves.types)

    def draw(axis: Axes, name: str, kind: str) -> None:
        j, colour = curves.types.index(kind), colours[kind]
        mean, low, high = (100 * values[j] for values in curves.shown[name])
        axis.axvline(n, color="#d0d0d0", linewidth=0.8)
        axis.plot(N, 100 * curves.ceiling[name][j], color=CEILING, linestyle=":", linewidth=1.2)
        if curves.beside:
            axis.plot(N, 100 * curves.beside[name][j], color=colour, linestyle=(0, (1, 1)), linewidth=1.4)
        axis.fill_between(N, low, high, color=colour, alpha=0.18, linewidth=0)
        axis.plot(N, mean, color=colour, linewidth=1.8)
        if kind != ALL:
            axis.axhline(100 * random[name][kind], color=CHANCE, linestyle=(0, (4, 3)), linewidth=1)
        axis.set_xlim(1, most)
        axis.set_xticks([n, most // 2, most] if most > 2 * n else [1, most])

    legend = [
        *_ours(f"{shown}, 95 % band"),
        *([Line2D([], [], color="#202020", linestyle=(0, (1, 1)), label=beside)] if curves.beside else []),
        Line2D([], [], color=CHANCE, linestyle=(0, (4, 3)), label="random candidate"),
        Line2D([], [], color=CEILING, linestyle=":", label="ceiling"),
    ]
    return _grid(draw, "number of highest-ranked grasps N", legend, tuple(curves.shown), curves.types)


def reliability_diagram(curves: Mapping[str, Mapping[str, Reliability]]) -> Figure:
    """A column a grasp type: observed over predicted success, and counts below.

    Args:
        curves: grasp type -> end of `evaluation.reliability.PREDICTORS` -> its diagram.
    """
    colours = type_colours(list(curves))
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(3.8 * max(len(curves), 2), 5.2))
        figure.subplots_adjust(0.085, 0.09, 0.985, 0.945, wspace=0.1, hspace=0.1)
        axes = figure.subplots(2, len(curves), sharex=True, sharey="row", height_ratios=(3, 1), squeeze=False)
        for j, kind in enumerate(curves):
            upper, lower = axes[0, j], axes[1, j]
            upper.plot([0, 1], [0, 1], color=CHANCE, linestyle=(0, (4, 3)), linewidth=1, label="as predicted")
            for shift, (end, colour) in enumerate((("_before", PAPER), ("", colours[kind]))):
                curve = curves[kind][end]
                _reliability(upper, curve, colour, PREDICTORS[end])
                bins = len(curve.count)
                at = (np.arange(bins) + 0.3 + 0.4 * shift) / bins
                lower.bar(at, curve.count, width=0.36 / bins, color=colour)
            flag = curves[kind]["_flag"]
            upper.plot(flag.predicted, flag.observed, "D", color="#202020", markersize=5, label=PREDICTORS["_flag"])
            upper.plot(
                [], [], "o", color=PAPER, markersize=5, markerfacecolor="white", label=f"of fewer than {FEW} grasps"
            )
            upper.set(title=f"{kind}: grasps without a sensed collision", xlim=UNIT, ylim=UNIT)
            upper.legend(loc="lower right")
            lower.set(xlabel="predicted probability of success", yscale="log")
            lower.yaxis.set_major_locator(LogLocator(base=10, numticks=7))
            lower.yaxis.set_minor_locator(NullLocator())
        axes[0, 0].set_ylabel("share that succeeded")
        axes[1, 0].set(ylabel="grasps", ylim=(1, None))  # once all bars are there: the axes share it
    return figure


def _reliability(axis: Axes, curve: Reliability, colour: str, label: str) -> None:
    many, some = curve.count >= FEW, curve.count > 0
    axis.plot(curve.predicted[some], curve.observed[some], color=colour, linewidth=1.5, zorder=2)
    axis.plot(curve.predicted[many], curve.observed[many], "o", color=colour, markersize=5, label=label, zorder=3)
    few = some & ~many
    axis.plot(
        curve.predicted[few], curve.observed[few], "o", color=colour, markersize=5, markerfacecolor="white", zorder=3
    )


def _ours(words: str) -> list[Line2D]:
    return [Line2D([], [], color="#202020", linewidth=2, label=f"{words} (colour of the row)")]


def _grid(
    draw: Callable[[Axes, str, str], None],
    xlabel: str,
    legend: Sequence[Line2D],
    names: Sequence[str],
    types: Sequence[str],
) -> Figure:
    """A row a type, a column a class, percent upwards; `draw(axis, class, type)` fills a panel."""
    with mpl.rc_context(LETTERS):
        colours, width, height = type_colours(types), 0.95 + 2.05 * len(names), 0.2 + 1.9 * len(types)
        figure = Figure(figsize=(width, height))
        figure.subplots_adjust(0.8 / width, 0.55 / height, 1 - 0.15 / width, 1 - 0.6 / height, wspace=0.08, hspace=0.1)
        axes = figure.subplots(len(types), len(names), sharex=True, sharey=True, squeeze=False)
        for i, kind in enumerate(types):
            for j, name in enumerate(names):
                draw(axes[i, j], name, kind)
                if i == 0:
                    axes[i, j].set_title(name, fontweight="bold")
            axes[i, 0].set_ylabel(f"{kind}\nsuccess-rate (%)", color=colours[kind])
            axes[i, 0].set_ylim(-3, 103)
        figure.supxlabel(xlabel, fontsize=9, y=0.015)
        figure.legend(handles=list(legend), loc="upper center", ncols=len(legend))
    return figure
