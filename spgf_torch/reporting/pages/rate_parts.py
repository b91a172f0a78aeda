"""Parts of the report that come from rates: headline, Table 1, the choice of ranking, Fig. 9, ablations."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Mapping, Sequence

from spgf_torch.affordance.config import JUDGE, NESTED
from spgf_torch.drawing.page import Section, caption, chart, drawn, png, table
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.results import KNOWS_MORE
from spgf_torch.evaluation.success import ALL
from spgf_torch.objects.config import CLASSES
from spgf_torch.reporting.data.runs import Block, Run
from spgf_torch.reporting.data.seeds import Repeats, seed_words
from spgf_torch.reporting.figures.charts import success_over_k
from spgf_torch.reporting.pages.ablations import (
    ablation_csv,
    ablation_markdown,
    ablation_page,
    ablations,
    ranked_otherwise,
)
from spgf_torch.reporting.pages.context import Context, Part
from spgf_torch.reporting.pages.table1 import Table1, about_seeds, latex, long_csv, markdown, page_table, short_markdown

FROM_K = 10  # the smallest K of the comparison of CG with single types: below, the paper's K = 5 is too coarse
PAPERS = "paper"  # the ranking
MANY = 8  # runs; more choices of rankings are folded away

JUDGE_WORDS = (
    " The ranking <code>judge</code> is not the paper's and does not depend on K: boosted trees learned from the same "
    "trials of the training folds. It knows more than the votes do: space that no camera has seen, how near sensed "
    "points come to the open hand, and which trials collided. Candidates with a sensed collision come last."
)


def headline(context: Context) -> Part:
    """The numbers a reader wants first, and what they are of: the K that the paper has its best with, or the shown."""
    row, ranking = context.row, context.ranking
    second = context.second
    cards, papers = [_card(row, ranking)], row.of_papers_hand
    if papers and row.K in paper.SUCCESS_RATE:
        cards.append(
            (f"{paper.SUCCESS_RATE[row.K]['all']['CG']:.1f} %", f"the paper, K = {row.K}, on other objects, RobWorkSim")
        )
    if second is not None and second in row.by_ranking:
        cards.append(_card(row, second))
    kinds = html.escape(" / ".join(row.grasp_types))
    ours, theirs = (_singles(rates, row.grasp_types) for rates in (_percent(row.random), paper.RANDOM))
    beside = f"; the paper's: {theirs}" if papers else ""
    cards.append((f"{ours} %", f"a random candidate, {kinds}{beside}"))
    if (worst := _worst_gap(context)) is not None:
        gap, name, K = worst
        cards.append(
            (
                f"{100 * gap:+.1f}",
                f"percentage points: CG less {_better(row.grasp_types)}, where CG does worst ({name}, K = {K}; of all "
                f"classes and K from {FROM_K} on)",
            )
        )
    boxes = "".join(f'<div class="card"><b>{value}</b><span>{words}</span></div>' for value, words in cards)
    other_data = f"<b>{paper.OTHER_DATA}</b> " if papers else ""
    text = (
        f"<p>{other_data}{_told(context)}</p>"
        f"<p>Success-rate: of the {row.N} highest-ranked grasps on an object that was not learned from, the share "
        f"that the simulated hand held (Eq. 10). {_kinds_words(row)} Pictures of what was learned "
        f"are of K = {row.K}, seed {context.shown.seed}.</p>"
    )
    folders = [
        [str(run.K), str(run.seed), html.escape(run.folder.name), html.escape(run.stamp.split("_")[0])]
        for each in context.sweep.rows
        for run in each.runs
    ]
    runs = table(["K", "seed", "folder", "date"], folders, 4)
    listed = f"<details><summary>The runs</summary>{runs}</details>"
    return Part(Section("summary", "Summary", f'<div class="cards">{boxes}</div>{text}{listed}'))


def table_part(context: Context, found: Table1) -> Part:
    """Table 1, and the same as files."""
    n = context.shown.N
    about = " ".join(filter(None, [about_seeds(found), found.other_data, KNOWS_MORE]))
    title = f"Success-rate (%) of the {n} highest-ranked grasps on novel objects. {about}"
    grey = "Grey rows are the paper's. " if found.other_data else ""
    words = caption(
        f"Rates in percent of the {n} highest-ranked grasps, small numbers are intervals. {about} "
        f"{grey}<i>Random</i> is the share of successes among all candidates, <i>collision-free</i> the same"
        " among candidates whose open hand holds no sensed point, and the <i>ceiling</i> what a ranking that "
        "knew the outcomes would reach. Shaded is the K that is the paper's best. Files: <code>table1.md</code>, "
        "<code>table1.csv</code>, <code>table1.tex</code>." + (JUDGE_WORDS if JUDGE in context.rankings else "")
    )
    first, others, rest = found.rankings[:2], found.rankings[2:], found.groups[len(found.rankings) :]
    body = words + f'<div class="wide">{page_table([*first, *rest], found.types)}</div>'
    if others:
        folded = page_table(others, found.types)
        body += f'<details><summary>Other rankings</summary><div class="wide">{folded}</div></details>'
    files = {
        "table1.md": markdown(found, title),
        "table1_short.md": short_markdown(found),
        "table1.csv": long_csv(found),
        "table1.tex": latex(found, title),
    }
    return Part(Section("table1", "Table 1", body), {name: text.encode() for name, text in files.items()})


def choice_part(context: Context) -> Part:
    """Which ranking nested cross-validation chose in which fold."""
    chosen = [run for row in context.sweep.rows for run in row.runs if run.chosen]
    if not chosen:
        return Part(Section("choice", "Choice of ranking", "<p>No run says which ranking was chosen in its folds.</p>"))
    folds = sorted({fold for run in chosen for fold in run.chosen})
    rows = [
        [f"K = {run.K}, seed {run.seed}", *(f"<code>{html.escape(run.chosen.get(fold, '-'))}</code>" for fold in folds)]
        for run in chosen
    ]
    words = caption(
        "In every fold of the cross-validation the ranking <i>nested</i> is chosen by a second cross-validation inside "
        "the training objects: those it is judged on do not choose. The formulas to choose from were known by their "
        "rates on these objects, though (docs/EXPERIMENTS.md)."
    )
    head = ["", *(f"fold {fold}" for fold in folds)]
    listed = table(head, rows, len(head))
    if len(rows) > MANY:
        listed = f"<details><summary>{len(rows)} runs</summary>{listed}</details>"
    return Part(Section("choice", "Choice of ranking", words + counted_choices(chosen) + listed))


def counted_choices(runs: Sequence[Run]) -> str:
    """How often each ranking was chosen, over all folds of all runs, as a sentence in HTML."""
    counts = Counter(ranking for run in runs for ranking in run.chosen.values())
    told = ", ".join(f"<code>{html.escape(name)}</code> {count} times" for name, count in counts.most_common())
    return f"<p>Chosen in {counts.total()} folds: {told}.</p>"


def over_k(context: Context) -> Part:
    """Fig. 9."""
    second = context.second
    figure = success_over_k(context.sweep.rows, context.ranking, second)
    beside = f" Dotted with squares: our ranking <code>{html.escape(second)}</code>. {KNOWS_MORE}" if second else ""
    theirs = f" Grey: the paper. {paper.OTHER_DATA}" if context.row.of_papers_hand else ""
    words = caption(
        "Success-rate over the number of prototypes. A row a grasp type, a column a class of objects. "
        f"Coloured: this package, ranking <code>{html.escape(context.ranking)}</code>, with its 95 % interval."
        f"{beside}{theirs} Dashed: random candidates; dotted: what a ranking that knew the "
        "outcomes would reach."
    )
    body = words + chart(figure, "success-rate over K")
    return Part(Section("fig9", "Fig. 9: over K", body), {"fig09_success_over_K.png": png(drawn(figure))})


def ablation_part(context: Context) -> Part | None:
    """Ablations, where there are some."""
    second, config = context.second, context.config
    draws = (config.bootstrap, config.seed, context.tell)
    found = ranked_otherwise(context.row, context.ranking, context.rankings, *draws)
    found += ablations(context.sweep.variants, [context.ranking, *([second] if second else [])], *draws)
    if not found:
        return None
    words = caption(
        "Each row is an experiment that differs from the sweep in what stands first (in brackets: the sweep's value), "
        "or the shown one ranked in another way: <code>log_odds_free</code> is <code>log_odds</code> with the grasps "
        "at which a sensed point lies inside the open hand put last. "
        f"<i>Change</i> is its CG by the ranking <code>{html.escape(context.ranking)}</code> minus that of the sweep "
        "with the same K, paired by object and by seed (as many as <i>seeds</i> says), in percentage points with the "
        "95 % interval over both; of one seed over objects alone. An interval without 0 is a difference that other "
        "objects, and where there are several also other seeds, would be expected to show, too. Files: "
        "<code>ablations.md</code>, <code>ablations.csv</code>."
    )
    files = {
        "ablations.md": ablation_markdown(found, context.ranking, second).encode(),
        "ablations.csv": ablation_csv(found).encode(),
    }
    return Part(Section("ablations", "Ablations", words + ablation_page(found, context.ranking, second)), files)


def _card(row: Repeats, ranking: str) -> tuple[str, str]:
    """CG of all objects by a ranking, with its interval and what it is of."""
    low, high = row.interval95[ranking]["all"][ALL]
    name = {PAPERS: "the paper's ranking", NESTED: "our ranking, which knows sensed collisions"}.get(ranking, ranking)
    seeds = seed_words(len(row.seeds[ranking]))
    words = (
        f"here, {html.escape(name)}: CG, all objects, K = {row.K}, {seeds} (95 %: {100 * low:.0f} to {100 * high:.0f})"
    )
    return f"{100 * row.rate(ranking):.1f} %", words


def _singles(rates: Mapping[str, Mapping[str, float]], kinds: Sequence[str]) -> str:
    """Rates of all objects of each type, as far as there are some."""
    return " / ".join(f"{rates['all'][kind]:.1f}" for kind in kinds if kind in rates["all"])


def _better(kinds: Sequence[str]) -> str:
    """The best single type in words, as HTML."""
    if len(kinds) == 2:
        return f"the better of {html.escape(' and '.join(kinds))}"
    return f"the best of {html.escape(', '.join(kinds))}"


def _kinds_words(row: Repeats) -> str:
    """What the grasp types are, in a sentence of HTML."""
    if row.of_papers_hand:
        return "NPG and WPG are the narrow and the wide pinch grasp, CG is both in one ranking."
    named = html.escape(", ".join(row.grasp_types))
    return f"Grasp types of the hand: {named}; CG is all of them in one ranking."


def _told(context: Context) -> str:
    """How many seeds, and what our ranking knows more, in sentences of HTML."""
    count = len(context.row.seeds[context.ranking])
    seeds = (
        f"Rates are means over {count} seeds (folds, noise, draws), intervals over seeds and objects together."
        if count > 1
        else "Rates are of one seed, intervals over objects alone."
    )
    return f"{seeds} {KNOWS_MORE}" if NESTED in context.rankings else seeds


def _percent(block: Block) -> Block:
    return {name: {kind: 100 * rate for kind, rate in row.items()} for name, row in block.items()}


def _worst_gap(context: Context) -> tuple[float, str, int] | None:
    """The lowest CG minus better single type over classes and K >= 10, its class and K."""
    gaps = [
        (
            row.rate(context.ranking, name) - max(row.rate(context.ranking, name, kind) for kind in row.grasp_types),
            name,
            row.K,
        )
        for row in context.sweep.rows
        if row.K >= FROM_K and context.ranking in row.by_ranking
        for name in CLASSES
        if name in row.by_ranking[context.ranking]
    ]
    return min(gaps, default=None)
