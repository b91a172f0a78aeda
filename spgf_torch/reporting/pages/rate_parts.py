"""Parts of the report that come from rates: headline, Table 1, the choice of ranking, Fig. 9, ablations."""

from __future__ import annotations

import html

from spgf_torch.affordance.config import JUDGE, NESTED
from spgf_torch.drawing.page import Section, caption, chart, drawn, png, table
from spgf_torch.evaluation import paper
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.objects.config import CLASSES
from spgf_torch.reporting.data.runs import Run
from spgf_torch.reporting.figures.charts import success_over_k
from spgf_torch.reporting.pages.ablations import (
    ablation_csv,
    ablation_markdown,
    ablation_page,
    ablations,
    ranked_otherwise,
)
from spgf_torch.reporting.pages.context import Context, Part, best_run
from spgf_torch.reporting.pages.table1 import Group, latex, long_csv, markdown, page_table

SECOND = "log_odds"  # shown beside the shown ranking in the ablations
FROM_K = 10  # the smallest K of the comparison of CG with single types: below, the paper's K = 5 is too coarse

JUDGE_WORDS = (
    " The ranking <code>judge</code> is not the paper's and does not depend on K: boosted trees learned from the same "
    "trials of the training folds. It knows more than the votes do: space that no camera has seen, how near sensed "
    "points come to the open hand, and which trials collided. Candidates with a sensed collision come last."
)


def headline(context: Context) -> Part:
    """The numbers a reader wants first."""
    run, ranking = best_run(context.sweep.runs, context.ranking), context.ranking
    low, high = run.interval95[ranking]["all"]["CG"]
    theirs_K, theirs = max(
        ((K, block["all"]["CG"]) for K, block in paper.SUCCESS_RATE.items()), key=lambda pair: pair[1]
    )
    chance = " / ".join(f"{100 * run.random['all'][kind]:.1f}" for kind in GRASP_TYPES)
    cards = [
        (
            f"{100 * run.by_ranking[ranking]['all']['CG']:.1f} %",
            f"CG, all objects, K = {run.K} (95 %: {100 * low:.0f} to {100 * high:.0f})",
        ),
        (f"{theirs:.1f} %", f"the paper's best, K = {theirs_K}"),
        (f"{chance} %", "a random candidate, NPG / WPG"),
    ]
    if (worst := _worst_gap(context)) is not None:
        gap, name, K = worst
        cards.append(
            (
                f"{100 * gap:+.1f}",
                f"CG minus the better single type, points: the worst class and K &ge; {FROM_K} ({name}, K = {K})",
            )
        )
    boxes = "".join(f'<div class="card"><b>{value}</b><span>{words}</span></div>' for value, words in cards)
    ks = ", ".join(str(r.K) for r in context.sweep.runs)
    text = (
        f"<p>Success-rate: of the {run.N} highest-ranked grasps on an object that was not learned from, the share "
        "that the simulated hand held (Eq. 10). NPG and WPG are the narrow and the wide pinch grasp, CG is both in "
        f"one ranking. Shown is the ranking <code>{html.escape(ranking)}</code>{_nested_words(ranking)} over runs "
        f"with K = {ks} prototypes; pictures of what was learned are of K = {context.shown.K}.</p>"
    )
    folders = [[str(r.K), html.escape(r.folder.name), html.escape(r.stamp.split("_")[0])] for r in context.sweep.runs]
    listed = f"<details><summary>The runs</summary>{table(['K', 'folder', 'date'], folders, 3)}</details>"
    return Part(Section("summary", "Summary", f'<div class="cards">{boxes}</div>{text}{listed}'))


def table_part(context: Context, groups: list[Group]) -> Part:
    """Table 1, and the same as files."""
    n = context.shown.N
    title = f"Success-rate (%) of the {n} highest-ranked grasps on novel objects, with 95 % intervals over objects."
    words = caption(
        f"Rates in percent of the {n} highest-ranked grasps; the small numbers are 95 % intervals (bootstrap over "
        "objects). Grey rows are the paper's, from its own objects and simulator: not the same data. <i>Random</i> "
        "is the share of successes among all candidates, <i>no sensed collision</i> the same among candidates "
        "whose open hand holds no sensed point, and the <i>ceiling</i> what a ranking that knew the outcomes would "
        "reach. Marked is the K with the best CG of a ranking. Files: <code>table1.md</code>, "
        "<code>table1.csv</code>, <code>table1.tex</code>." + (JUDGE_WORDS if JUDGE in context.rankings else "")
    )
    first, others, chance = groups[0], groups[1:-1], groups[-1]
    body = words + f'<div class="wide">{page_table([first, chance])}</div>'
    if others:
        body += f'<details><summary>Other rankings</summary><div class="wide">{page_table(others)}</div></details>'
    files = {
        "table1.md": markdown(groups, title),
        "table1.csv": long_csv(groups),
        "table1.tex": latex(groups, title),
    }
    return Part(Section("table1", "Table 1", body), {name: text.encode() for name, text in files.items()})


def choice_part(context: Context) -> Part:
    """Which ranking nested cross-validation chose in which fold."""
    chosen = [run for run in context.sweep.runs if run.chosen]
    if not chosen:
        return Part(Section("choice", "Choice of ranking", "<p>No run says which ranking was chosen in its folds.</p>"))
    folds = sorted({fold for run in chosen for fold in run.chosen})
    rows = [
        [f"K = {run.K}", *(f"<code>{html.escape(run.chosen.get(fold, '-'))}</code>" for fold in folds)]
        for run in chosen
    ]
    words = caption(
        "In every fold of the cross-validation the ranking was chosen by a second cross-validation inside the "
        "training objects, so that the objects it is judged on had no say. A row <i>nested</i> of Table 1 ranks "
        "each object by the ranking chosen in its fold."
    )
    head = ["", *(f"fold {fold}" for fold in folds)]
    return Part(Section("choice", "Choice of ranking", words + table(head, rows, len(head))))


def over_k(context: Context) -> Part:
    """Fig. 9."""
    figure = success_over_k(context.sweep.runs, context.ranking)
    words = caption(
        "Success-rate over the number of prototypes. A row a grasp type, a column a class of objects. "
        f"Coloured: this package, ranking <code>{html.escape(context.ranking)}</code>, with its 95 % interval over "
        "objects; grey: the paper. Dashed: random candidates; dotted: the best any ranking could do."
    )
    body = words + chart(figure, "success-rate over K")
    return Part(Section("fig9", "Fig. 9: over K", body), {"fig09_success_over_K.png": png(drawn(figure))})


def ablation_part(context: Context) -> Part | None:
    """Ablations, where there are some."""
    second = SECOND if SECOND in context.rankings and context.ranking != SECOND else None
    rankings = [context.ranking, *([second] if second else [])]
    config = context.config
    draws = (config.bootstrap, config.seed, context.tell)
    found = ranked_otherwise(context.shown, context.ranking, context.rankings, *draws)
    found += ablations(context.sweep.variants, rankings, *draws)
    if not found:
        return None
    words = caption(
        "Each row is a run that differs from the sweep in what stands first (in brackets: the sweep's value), or the "
        "shown run ranked in another way: <code>log_odds_free</code> is <code>log_odds</code> with the grasps at which "
        "a sensed point lies inside the open hand put last. "
        f"<i>Change</i> is its CG by the ranking <code>{html.escape(context.ranking)}</code> minus that of the run "
        "with the same K, paired over the same objects, in percentage points with the 95 % interval over objects: "
        "an interval without 0 is a difference that other objects would be expected to show, too. Files: "
        "<code>ablations.md</code>, <code>ablations.csv</code>."
    )
    files = {
        "ablations.md": ablation_markdown(found, context.ranking, second).encode(),
        "ablations.csv": ablation_csv(found).encode(),
    }
    return Part(Section("ablations", "Ablations", words + ablation_page(found, context.ranking, second)), files)


def _worst_gap(context: Context) -> tuple[float, str, int] | None:
    """The lowest CG minus better single type over classes and K >= 10, its class and K."""
    gaps = [
        (_gap(run, context.ranking, name), name, run.K)
        for run in context.sweep.runs
        if run.K >= FROM_K and context.ranking in run.by_ranking
        for name in CLASSES
        if name in run.by_ranking[context.ranking]
    ]
    return min(gaps, default=None)


def _gap(run: Run, ranking: str, name: str) -> float:
    rates = run.by_ranking[ranking][name]
    return rates["CG"] - max(rates[kind] for kind in GRASP_TYPES)


def _nested_words(ranking: str) -> str:
    return " (in each fold the ranking that did best on its training objects)" if ranking == NESTED else ""
