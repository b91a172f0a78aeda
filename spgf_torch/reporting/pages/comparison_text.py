"""The comparison in words and tables: Markdown, CSV (long form) and the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from rich import box
from rich.table import Table

from spgf_torch.evaluation.success import ALL
from spgf_torch.reporting.data.comparison import Comparison, Entry
from spgf_torch.reporting.data.costs import Costs
from spgf_torch.reporting.pages.ablations import points
from spgf_torch.reporting.pages.table1 import NAMES, columns

# Rates are sums of tenths: a bound of 0 may come out as the rounding of floats.
ROUNDING = 1e-9

CAUTION = (
    "Intervals are 95 % bootstraps, not corrected for their number. Training: features, particles, prototypes and "
    "voting of all folds with their inner cross-validation and of the model of all objects (sensing and sensed "
    "collisions, which all share, left out), or the network's; > where a part was read from the cache. Prediction: an "
    "object, from its texlets to the scores of its candidates."
)
PRINTED = (
    "Thomsen et al. (2015) printed for pairs of patches, on the paper's objects and learned class by class: containers "
    "NPG 68, boxes WPG 84, curved WPG 84 %."
)


def verdict(entries: Sequence[Entry], reference: str, name: str, kind: str) -> str:
    """Who is ahead of whom, from the paired intervals of entries with equal trials: one line for a class and type."""
    ahead: list[str] = []
    behind: list[str] = []
    open_: list[str] = []
    for entry in entries:
        if entry.change is None or name not in entry.change.mean:
            continue
        low, high = entry.change.interval95[name][kind]
        words = f"{entry.name} ({_change(entry, name, kind)})"
        (ahead if low > ROUNDING else behind if high < -ROUNDING else open_).append(words)
    told = [
        f"better than {reference}: {', '.join(ahead)}" if ahead else "",
        f"worse: {', '.join(behind)}" if behind else "",
        f"not told apart: {', '.join(open_)}" if open_ else "",
    ]
    return f"{name} {kind}: " + ("; ".join(filter(None, told)) or f"nothing to compare {reference} with")


def verdicts(comparison: Comparison) -> list[str]:
    """The verdict on CG of all objects and of each class and on each type, then for all objects by trials."""
    table = comparison.table
    wanted = [("all", ALL), *((name, ALL) for name in NAMES if name != "all")]
    wanted += [("all", kind) for kind in comparison.types if kind != ALL]
    lines = [verdict(table, comparison.reference, *column) for column in wanted if column[0] in table[0].rates]
    for trials in sorted({entry.trials for entry in comparison.entries} - {comparison.trials}):
        entries = [entry for entry in comparison.entries if entry.trials == trials]
        lines.append(f"{trials} trials: {verdict(entries, comparison.reference, 'all', 'CG')}")
    return lines


def markdown(comparisons: Sequence[Comparison]) -> str:
    """All tables, of the shown ranking first."""
    shown = comparisons[0]
    parts = [
        f"# Side by side, {shown.trials} trials of each type an object, K = {shown.entries[0].runs.K}",
        f"{seeds_told(shown)} {CAUTION}",
        *([PRINTED] if shown.entries[0].runs.of_papers_hand else []),
    ]
    for comparison in comparisons:
        parts += [f"## Success-rate (%), ranking {comparison.ranking}", _rates_table(comparison)]
        parts += ["\n".join(f"- {line}" for line in verdicts(comparison))]
        parts += [f"## CG, all objects, over trials, ranking {comparison.ranking}", _curve_table(comparison)]
    parts += ["## Costs", _grid(["", *COSTS], [[entry.name, *costs(entry.costs)] for entry in shown.table])]
    return "\n\n".join(parts) + "\n"


def seeds_told(comparison: Comparison) -> str:
    """In a sentence, how many seeds the entries are of, and what the intervals are over."""
    counts = sorted({len(entry.runs.seeds[comparison.ranking]) for entry in comparison.entries})
    if counts == [1]:
        return "One seed: folds, noise of sensing and draws are not in the intervals, which are over objects alone."
    told = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else f"{counts[0]}"
    return f"Means over {told} seeds, intervals over seeds and objects together, differences paired by both."


COSTS = ("training, s", "prediction, ms", "model, MB")


def costs(found: Costs) -> list[str]:
    """Training seconds, milliseconds of a prediction and megabytes of the model; - where a run does not say."""
    seconds = "-" if found.training_s is None else f"{'> ' * found.at_least}{found.training_s:.1f}"
    return [
        seconds,
        "-" if found.prediction_ms is None else f"{found.prediction_ms:.0f}",
        "-" if found.model_bytes is None else f"{found.model_bytes / 1e6:.1f}",
    ]


def long_csv(comparisons: Sequence[Comparison]) -> str:
    """A line a ranking, row, number of trials, class and type: rate and difference with bounds, as fractions; costs."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ["ranking", "row", "trials", "K", "class", "type", "rate", "low", "high", "difference", "difference_low"]
    writer.writerow([*head, "difference_high", "training_s", "prediction_ms", "model_bytes", "run", "seeds"])
    for comparison in comparisons:
        across = columns(comparison.types)
        for name, kind in across:
            if name in comparison.random:
                rate, bounds = comparison.random[name][kind], comparison.random_bounds[name][kind]
                cells = [f"{value:.6g}" for value in (rate, *bounds)]
                writer.writerow([comparison.ranking, "random", "", "", name, kind, *cells, *[""] * 8])
        for entry in comparison.entries:
            for name, kind in across:
                if name in entry.rates:
                    seeds = len(entry.runs.seeds[comparison.ranking])
                    writer.writerow([comparison.ranking, *_line(entry, name, kind), seeds])
    return text.getvalue()


def terminal(comparisons: Sequence[Comparison]) -> list[Table | str]:
    """The first ranking's rates, costs and verdicts, in 100 columns, and what the others say of all objects."""
    comparison = comparisons[0]
    rates = _terminal_table(
        f"Success-rate (%) by {comparison.ranking}, {comparison.trials} trials of each type an object"
    )
    names = [name for name in NAMES if name in comparison.table[0].rates]
    singles = [kind for kind in comparison.types if kind != ALL]
    for head in [
        "",
        *(f"{name}\nCG" for name in names),
        *(f"all\n{kind}" for kind in singles),
        f"all CG minus\n{comparison.reference}",
    ]:
        rates.add_column(head, justify="right" if head else "left", no_wrap=True)
    for entry in comparison.table:
        cells = [_rate(entry, name, ALL, bounds=name == "all") for name in names]
        cells += [_rate(entry, "all", kind, bounds=False) for kind in singles]
        rates.add_row(entry.name, *cells, _change(entry, "all", ALL))
    for label, block in (("random", comparison.random), ("ceiling", comparison.ceiling)):
        cells = [f"{100 * block[name][ALL]:.1f}" for name in names]
        rates.add_row(label, *cells, *(f"{100 * block['all'][kind]:.1f}" for kind in singles), "")
    spent = _terminal_table("Costs")
    for head in ("", *COSTS):
        spent.add_column(head, justify="right" if head else "left", no_wrap=True)
    for entry in comparison.table:
        spent.add_row(entry.name, *costs(entry.costs))
    others = [f"by {c.ranking}: {verdict(c.table, c.reference, 'all', 'CG')}" for c in comparisons[1:]]
    return [rates, spent, seeds_told(comparison), *verdicts(comparison), *others]


def _line(entry: Entry, name: str, kind: str) -> list[str]:
    change: list[str] = ["", "", ""]
    if entry.change is not None and name in entry.change.mean:
        values = (entry.change.mean[name][kind], *entry.change.interval95[name][kind])
        change = [f"{value:.6g}" for value in values]
    rate = [f"{value:.6g}" for value in (entry.rates[name][kind], *entry.bounds[name][kind])]
    found = (entry.costs.training_s, entry.costs.prediction_ms, entry.costs.model_bytes)
    spent = ["" if value is None else f"{value:.9g}" for value in found]
    first = entry.runs.runs[0]
    return [entry.name, str(entry.trials), str(first.K), name, kind, *rate, *change, *spent, first.folder.name]


def _rates_table(comparison: Comparison) -> str:
    across = [(name, kind) for name, kind in columns(comparison.types) if name in comparison.table[0].rates]
    head = ["", *(f"{name} {kind}" for name, kind in across), f"all CG minus {comparison.reference}"]
    rows = [
        [entry.name, *(_rate(entry, *column) for column in across), _change(entry, "all", ALL)]
        for entry in comparison.table
    ]
    for label, block in (("random candidate", comparison.random), ("ceiling", comparison.ceiling)):
        rows.append([label, *(f"{100 * block[name][kind]:.1f}" for name, kind in across), ""])
    return _grid(head, rows)


def _curve_table(comparison: Comparison) -> str:
    trials = sorted({entry.trials for entry in comparison.entries})
    rows = []
    for name in dict.fromkeys(entry.name for entry in comparison.entries):
        found = {entry.trials: entry for entry in comparison.curve(name)}
        cells = [_rate(found[n], "all", ALL) if n in found else "-" for n in trials]
        changes = [_change(found[n], "all", ALL) if n in found else "-" for n in trials]
        rows.append([name, *cells])
        if any(change for change in changes):
            rows.append([f"{name} minus {comparison.reference}", *changes])
    return _grid(["trials of each type an object", *map(str, trials)], rows)


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _terminal_table(title: str) -> Table:
    return Table(title=title, box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1), pad_edge=False)


def _rate(entry: Entry, name: str, kind: str, bounds: bool = True) -> str:
    low, high = entry.bounds[name][kind]
    return f"{100 * entry.rates[name][kind]:.1f}" + (f" ({100 * low:.0f}-{100 * high:.0f})" if bounds else "")


def _change(entry: Entry, name: str, kind: str) -> str:
    """The paired difference in points with its interval, digits enough to see which side of 0 a bound is on."""
    if entry.change is None or name not in entry.change.mean:
        return ""
    low, high = entry.change.interval95[name][kind]
    return f"{points(entry.change.mean[name][kind], 1)}, {points(low, 1)} to {points(high, 1)}"
