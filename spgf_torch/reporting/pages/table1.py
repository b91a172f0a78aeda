"""Table 1 of the paper with ours beside it: Markdown, CSV (long form), LaTeX, HTML and the terminal."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.table import Table
from rich.text import Text

from spgf_torch.affordance.config import NESTED
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.results import KNOWS_MORE
from spgf_torch.evaluation.success import ALL
from spgf_torch.objects.config import CLASSES
from spgf_torch.reporting.data.runs import Block, Bounds
from spgf_torch.reporting.data.seeds import Repeats, seed_words
from spgf_torch.reporting.data.sweep import NOMINAL_K

NAMES = (*CLASSES, "all")
HEADINGS = {"paper": "the paper's ranking", NESTED: "our ranking, nested"}


@dataclass(frozen=True)
class Row:
    """A row of the table; rates and bounds are fractions.

    Attributes:
        row: what the row is to a script: paper, ours:<ranking>, classwise_paper, classwise_ours:<ranking>,
            random_paper, random, random_collision_free, ceiling.
        label: what it is to a reader.
        K: None where the row does not depend on it.
        seeds: of how many the rates are means; None of printed ones.
    """

    row: str
    label: str
    K: int | None
    rates: Mapping[str, Mapping[str, float]]
    bounds: Bounds | None = None
    seeds: int | None = None

    def rate(self, name: str, kind: str) -> float | None:
        return self.rates.get(name, {}).get(kind)

    def bound(self, name: str, kind: str) -> tuple[float, float] | None:
        return (self.bounds or {}).get(name, {}).get(kind)


@dataclass(frozen=True)
class Group:
    """Rows under one heading."""

    heading: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Table1:
    """The table.

    Attributes:
        types: the grasp types, and CG. other_data: what is to be said where the paper's rates stand beside ours.
    """

    groups: tuple[Group, ...]
    types: tuple[str, ...]
    other_data: str = ""

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Class and type of each column."""
        return columns(self.types)

    @property
    def short(self) -> list[tuple[str, str]]:
        """The same of the short form."""
        return [*((name, ALL) for name in CLASSES), *(("all", kind) for kind in self.types)]

    @property
    def rankings(self) -> tuple[Group, ...]:
        """The groups of a ranking each, which stand first."""
        return tuple(group for group in self.groups if any(row.row.startswith("ours") for row in group.rows))


def columns(types: Sequence[str]) -> list[tuple[str, str]]:
    """Each class, and all, with each type."""
    return [(name, kind) for name in NAMES for kind in types]


def table1(rows: Sequence[Repeats], classwise: Sequence[Repeats], rankings: Sequence[str], baseline: Repeats) -> Table1:
    """The table: for each ranking ours for each K, then each class by itself, chance and ceiling.

    Beside ours by the first ranking stand the paper's rates, where ours are of its hand.

    Args:
        rows: the sweep, by K; one without a ranking is left out of that ranking's rows.
        classwise: the same with each class learned by itself; only the first two rankings are shown of them.
        rankings: the one that the report shows, then others; one that no run has makes no group.
        baseline: the experiment whose chance and ceiling are shown.
    """
    groups: list[Group] = []
    papers = baseline.of_papers_hand
    for ranking in rankings:
        having = [each for each in rows if ranking in each.by_ranking]
        ours = [(each.K, _ours(each, ranking, f"K = {each.K}, ours", "ours")) for each in having]
        found = [row for K, mine in ours for row in (*(_printed(K) if papers and not groups else []), mine)]
        if found:
            groups.append(Group(HEADINGS.get(ranking, f"ranking: {ranking}"), tuple(found)))
    alone = [
        _ours(each, ranking, f"K = {each.K}, by {ranking}", "classwise_ours")
        for ranking in rankings[:2]
        for each in classwise
        if ranking in each.by_ranking
    ]
    printed = [Row("classwise_paper", "[*] Thomsen et al. (2015)", None, _fractions(paper.CLASSWISE))]
    printed_chance = [Row("random_paper", "random, the paper", None, _fractions(paper.RANDOM))]
    chance = (
        *(printed_chance if papers else []),
        Row("random", "random", None, _without_cg(baseline.random)),
        Row("random_collision_free", "random, collision-free", None, baseline.random_collision_free),
        Row("ceiling", "ceiling: best by outcome", None, baseline.ceiling),
    )
    by_class = [*(printed if papers else []), *alone]
    groups += [Group("each class by itself", tuple(by_class))] if by_class else []
    groups.append(Group("chance and ceiling", chance))
    return Table1(tuple(groups), baseline.types, paper.OTHER_DATA if papers else "")


def about_seeds(table: Table1) -> str:
    """In a sentence, how many seeds ours are of, and what the intervals are over."""
    counts = sorted({row.seeds for group in table.groups for row in group.rows if row.seeds is not None})
    if counts == [1]:
        return "Ours: one seed; 95 % intervals over objects alone, without the chance of folds, noise and draws."
    told = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else str(counts[0])
    alone = "; of one seed over objects alone" if counts[0] == 1 else ""
    return f"Ours: means over {told} seeds, 95 % intervals over seeds and objects together{alone}."


def markdown(table: Table1, caption: str) -> str:
    """A Markdown table: percent, ours with 95 % intervals."""
    across = table.columns
    lines = [caption, "", _line(["", *map(" ".join, across)]), _line(["---", *["---:"] * len(across)])]
    for group in table.groups:
        lines.append(_line([f"**{group.heading}**", *[""] * len(across)]))
        lines += [_line([row.label, *(_cell(row, *column) for column in across)]) for row in group.rows]
    return "\n".join(lines) + "\n"


def long_csv(table: Table1) -> str:
    """A line a rate: class,type,K,row,rate,low,high,seeds; rates are fractions, bounds where there are some."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["class", "type", "K", "row", "rate", "low", "high", "seeds"])
    for row in (row for group in table.groups for row in group.rows):
        for name, kind in table.columns:
            if (rate := row.rate(name, kind)) is not None:
                low, high = (
                    (f"{bound:.6g}" for bound in row.bound(name, kind) or ()) if row.bound(name, kind) else ("", "")
                )
                K, seeds = ("" if value is None else value for value in (row.K, row.seeds))
                writer.writerow([name, kind, K, row.row, f"{rate:.6g}", low, high, seeds])
    return text.getvalue()


def latex(table: Table1, caption: str) -> str:
    """A `tabular` for the package booktabs: intervals stand in small type below the rates."""
    across, each = table.columns, len(table.types)
    classes = " & ".join(rf"\multicolumn{{{each}}}{{c}}{{{escape(name)}}}" for name in NAMES)
    rules = "".join(rf"\cmidrule(lr){{{2 + each * i}-{1 + each * (i + 1)}}}" for i in range(len(NAMES)))
    lines = [
        f"% {caption}",
        "% needs \\usepackage{booktabs}",
        r"\begin{tabular}{l" + "r" * len(across) + "}",
        r"\toprule",
        rf" & {classes} \\",
        rules,
        " & " + " & ".join(escape(kind) for _, kind in across) + r" \\",
    ]
    for group in table.groups:
        lines += [r"\midrule", rf"\multicolumn{{{1 + len(across)}}}{{l}}{{\emph{{{escape(group.heading)}}}}} \\"]
        for row in group.rows:
            rates = (row.rate(*column) for column in across)
            lines.append(
                " & ".join([escape(row.label), *("--" if r is None else f"{100 * r:.1f}" for r in rates)]) + r" \\"
            )
            if row.bounds:
                bounds = (row.bound(*column) for column in across)
                small = (rf"{{\scriptsize {100 * b[0]:.0f}--{100 * b[1]:.0f}}}" if b else "" for b in bounds)
                lines.append(" & ".join(["", *small]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def escape(text: str) -> str:
    """Text for LaTeX."""
    special = {c: rf"\{c}" for c in "&%$#_{}"} | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\^{}"}
    return "".join(special.get(c, c) for c in text)


def page_table(groups: Sequence[Group], types: Sequence[str]) -> str:
    """Some groups of the table for a page; the rows of the K that is the paper's best stand out."""
    marks = [' class="first"', *[""] * (len(types) - 1)] * len(NAMES)  # of the first type of each class
    across = list(zip(marks, columns(types), strict=True))
    classes = "".join(f'<th colspan="{len(types)}" class="first">{name}</th>' for name in NAMES)
    kinds = "".join(f"<th{mark}>{html.escape(kind)}</th>" for mark, (_, kind) in across)
    lines = [f'<table class="rates"><thead><tr><th></th>{classes}</tr><tr><th></th>{kinds}</tr></thead>']
    for group in groups:
        lines.append(f'<tbody><tr class="group"><th colspan="{1 + len(across)}">{html.escape(group.heading)}</th></tr>')
        for row in group.rows:
            cells = "".join(f"<td{mark}>{_page_cell(row, *column)}</td>" for mark, column in across)
            looks = f"{row.row.split(':')[0].split('_')[-1]} {'best' if row.K == NOMINAL_K else ''}"
            lines.append(f'<tr class="{looks}"><th>{html.escape(row.label)}</th>{cells}</tr>')
        lines.append("</tbody>")
    return "\n".join([*lines, "</table>"])


def terminal(found: Table1) -> Table:
    """The short form, of two types 80 columns wide: CG of each class, and each type over all objects."""
    table = Table(
        title="Success-rate (%) on novel objects",
        caption=" ".join(filter(None, [about_seeds(found), found.other_data, KNOWS_MORE])),
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 0, 0, 1),
        pad_edge=False,
    )
    table.add_column("", no_wrap=True)
    for name, kind in found.short:
        table.add_column(f"{name}\n{kind}", justify="right", no_wrap=True)
    for heading, rows in _short(found):
        table.add_row(Text(heading, "bold"))
        for label, cells in rows:
            table.add_row(label, *cells, end_section=label is rows[-1][0])
    return table


def short_markdown(table: Table1) -> str:
    """The short form as a Markdown table."""
    across = table.short
    lines = [_line(["", *map(" ".join, across)]), _line(["---", *["---:"] * len(across)])]
    for heading, rows in _short(table):
        lines.append(_line([f"**{heading}**", *[""] * len(across)]))
        lines += [_line([label, *cells]) for label, cells in rows]
    return "\n".join(lines) + "\n"


def _short(table: Table1) -> list[tuple[str, list[tuple[str, list[str]]]]]:
    """Heading -> label -> cells: of the first two rankings, and of the other groups what has rates in `short`."""
    across, found = table.short, []
    for group in (*table.rankings[:2], *table.groups[len(table.rankings) :]):
        rows = [row for row in group.rows if any(row.rate(*column) is not None for column in across)]
        told = [
            (row.label, [_cell(row, *c) if c == across[-1] else _cell(row, *c).split()[0] for c in across])
            for row in rows
        ]
        found += [(group.heading, told)] if told else []
    return found


def _printed(K: int) -> list[Row]:
    theirs = paper.SUCCESS_RATE.get(K)
    return [Row("paper", f"K = {K}, the paper", K, _fractions(theirs))] if theirs else []


def _ours(each: Repeats, ranking: str, label: str, row: str) -> Row:
    count = len(each.seeds[ranking])
    rates, bounds = each.by_ranking[ranking], each.interval95.get(ranking)
    return Row(f"{row}:{ranking}", f"{label}, {seed_words(count)}", each.K, rates, bounds, count)


def _fractions(percent: Mapping[str, Mapping[str, float]]) -> Block:
    return {name: {kind: rate / 100 for kind, rate in row.items()} for name, row in percent.items()}


def _without_cg(block: Block) -> Block:
    return {name: {kind: rate for kind, rate in row.items() if kind != ALL} for name, row in block.items()}


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(row: Row, name: str, kind: str) -> str:
    rate, bound = row.rate(name, kind), row.bound(name, kind)
    if rate is None:
        return "-"
    return f"{100 * rate:.1f}" + (f" ({100 * bound[0]:.0f}-{100 * bound[1]:.0f})" if bound else "")


def _page_cell(row: Row, name: str, kind: str) -> str:
    rate, bound = row.rate(name, kind), row.bound(name, kind)
    if rate is None:
        return "-"
    small = f"<small>{100 * bound[0]:.0f}-{100 * bound[1]:.0f}</small>" if bound else ""
    return f"{100 * rate:.1f}{small}"
