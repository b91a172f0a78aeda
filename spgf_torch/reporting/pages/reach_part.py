"""What the dictionary of prototypes adds: success-rate over K for each distance within which features may vote."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from spgf_torch.drawing.page import Section, caption, chart, drawn, png, table
from spgf_torch.errors import InputError
from spgf_torch.evaluation import paper
from spgf_torch.reporting.data.seeds import Repeats, per_object
from spgf_torch.reporting.data.sweep import NOMINAL_K, difference
from spgf_torch.reporting.figures.charts import SHOWN_CLASSES, success_over_reach
from spgf_torch.reporting.pages.ablations import points
from spgf_torch.reporting.pages.context import Context, Part
from spgf_torch.reporting.pages.table1 import HEADINGS

Curves = Mapping[float, Sequence[Repeats]]


def reach_part(context: Context) -> Part | None:
    """Success-rate over K at each reach, where runs have several of both."""
    curves = {reach: rows for reach, rows in context.sweep.by_reach().items() if len(rows) > 1}
    if len(curves) < 2:
        return None
    rankings = context.rankings[:2]
    try:
        head, rows = reach_rows(curves, rankings, context)
    except InputError as error:
        context.tell(f"left out of K and reach: {error}")
        return None
    figure = success_over_reach(curves, rankings)
    papers = " Grey: the paper, on its own objects." if context.row.of_papers_hand else ""
    words = caption(
        "CG success-rate over the number of prototypes K, for each reach: how far from a grasp a feature may vote for "
        "it. The paper names no such limit; its features are of 30 mm radius. With K = 1 all shapes are one: "
        f"what a wide reach gives there comes from poses alone.{papers} "
        f"<i>K = {NOMINAL_K} minus</i> are differences in points, paired by seed and object. Files: "
        "<code>reach_over_K.png</code>, <code>reach.md</code>."
    )
    body = words + chart(figure, "success-rate over K and reach") + table(head, rows, 4)
    text = "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)) + "\n"
    files = {"reach_over_K.png": png(drawn(figure)), "reach.md": text.encode()}
    return Part(Section("reach", "K and reach", body), files)


def reach_rows(curves: Curves, rankings: Sequence[str], context: Context) -> tuple[list[str], list[list[str]]]:
    """Heading and rows: CG in percent at each K that several reaches have, and what K = 20 is better by.

    Raises InputError where the rates of objects cannot be read.
    """
    counts = Counter(row.K for rows in curves.values() for row in rows)
    ks = sorted(K for K, count in counts.items() if count > 1)
    below = [K for K in ks if K < NOMINAL_K] if NOMINAL_K in ks else []
    head = ["ranking", "reach (mm)", "objects", "seeds", *(f"K = {K}" for K in ks)]
    head += [f"K = {NOMINAL_K} minus {K}" for K in below]
    lines = []
    for name in SHOWN_CLASSES:
        for ranking in rankings:
            for reach, rows in curves.items():
                by_k = {row.K: row for row in rows if ranking in row.by_ranking}
                seeds = _span(len(by_k[K].seeds[ranking]) for K in ks if K in by_k)
                rates = [_rate(by_k.get(K), ranking, name) for K in ks]
                changes = [_change(by_k.get(NOMINAL_K), by_k.get(K), ranking, name, context) for K in below]
                lines.append([HEADINGS.get(ranking, ranking), f"{1000 * reach:g}", name, seeds, *rates, *changes])
        if context.row.of_papers_hand:
            lines.append(_printed(name, ks, below))
    return head, lines


def _span(counts: Iterable[int]) -> str:
    """`5`, or `1 to 5`; - of none."""
    found = sorted(counts)
    return " to ".join(dict.fromkeys(str(count) for count in (*found[:1], *found[-1:]))) or "-"


def _rate(row: Repeats | None, ranking: str, name: str) -> str:
    if row is None or name not in row.by_ranking[ranking]:
        return "-"
    low, high = row.interval95[ranking][name]["CG"]
    return f"{100 * row.rate(ranking, name):.1f} ({100 * low:.0f}-{100 * high:.0f})"


def _change(many: Repeats | None, few: Repeats | None, ranking: str, name: str, context: Context) -> str:
    if many is None or few is None or name not in few.by_ranking[ranking]:
        return "-"
    draws = (context.config.bootstrap, context.config.seed)
    change = difference(per_object(many, ranking), per_object(few, ranking), ranking, *draws)
    mean, (low, high) = change.mean[name]["CG"], change.interval95[name]["CG"]
    return f"{points(mean, 1)} ({points(low, 0)} to {points(high, 0)})"


def _printed(name: str, ks: Sequence[int], below: Sequence[int]) -> list[str]:
    """The paper's own rates, where it has that K."""
    theirs = {K: block[name]["CG"] for K, block in paper.SUCCESS_RATE.items()}
    rates = [f"{theirs[K]:.1f}" if K in theirs else "-" for K in ks]
    changes = [f"{theirs[NOMINAL_K] - theirs[K]:+.1f}" if K in theirs else "-" for K in below]
    return ["the paper", "not given", name, "-", *rates, *changes]
