"""What matters: runs that vary a setting against those of the sweep with the same K, by the same seeds and objects."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace

from spgf_torch.drawing.page import table
from spgf_torch.errors import InputError
from spgf_torch.reporting.data.runs import Tell
from spgf_torch.reporting.data.seeds import Repeats, per_object
from spgf_torch.reporting.data.sweep import Difference, Variant, difference
from spgf_torch.reporting.pages.table1 import NAMES


@dataclass(frozen=True)
class Ablation:
    """A variant with its paired differences, by ranking."""

    variant: Variant
    differences: dict[str, Difference]


def ablations(
    variants: Sequence[Variant], rankings: Sequence[str], resamples: int, seed: int, tell: Tell
) -> list[Ablation]:
    """Every variant whose objects' rates can be read; the others are told in a line."""
    found = []
    for variant in variants:
        known = [r for r in rankings if r in variant.runs.by_ranking and r in variant.reference.by_ranking]
        name = variant.runs.runs[0].folder.name
        try:
            differences = {
                ranking: difference(
                    per_object(variant.runs, ranking), per_object(variant.reference, ranking), ranking, resamples, seed
                )
                for ranking in known
            }
        except InputError as error:
            tell(f"left out of the ablations: {name}: {error}")
            continue
        if lacking := [ranking for ranking in rankings if ranking not in known]:
            tell(f"{name}: no rates by the ranking {', '.join(lacking)}; left out of those ablations")
        found.append(Ablation(variant, differences))
    return found


def ranked_otherwise(
    row: Repeats, ranking: str, others: Sequence[str], resamples: int, seed: int, tell: Tell
) -> list[Ablation]:
    """The same runs ranked in other ways, against `ranking`: with and without sensed collisions last, among others."""
    found = []
    for other in (other for other in others if other != ranking and {other, ranking} <= row.by_ranking.keys()):
        try:
            rows, usual = per_object(row, other), per_object(row, ranking)
            renamed = {
                number: [replace(each, rates={ranking: each.rates[other]}) for each in of_seed]
                for number, of_seed in rows.items()
            }
            change = difference(renamed, usual, ranking, resamples, seed)
        except InputError as error:
            tell(f"left out of the ablations: {error}")
            return []
        instead = replace(row, by_ranking={ranking: row.by_ranking[other]}, seeds={ranking: row.seeds[other]})
        found.append(Ablation(Variant(instead, row, {"ranking": (other, ranking)}), {ranking: change}))
    return found


def ablation_rows(found: Sequence[Ablation], ranking: str, second: str | None) -> tuple[list[str], list[list[str]]]:
    """Heading and rows of the table, in percent and percentage points."""
    names = [
        name for name in NAMES if any(name in a.differences[ranking].mean for a in found if ranking in a.differences)
    ]
    head = ["what varies (usual)", "K", "seeds", "CG, all", *(f"change, {name}" for name in reversed(names))]
    head += [f"CG, all, {second}", f"change, {second}"] if second else []
    rows = []
    for ablation in found:
        cells = [_rate(ablation, ranking), *(_change(ablation, ranking, name) for name in reversed(names))]
        cells += [_rate(ablation, second), _change(ablation, second, "all")] if second else []
        seeds = next((str(change.seeds) for change in ablation.differences.values()), "-")
        rows.append([ablation.variant.label, str(ablation.variant.runs.K), seeds, *cells])
    return head, rows


def ablation_page(found: Sequence[Ablation], ranking: str, second: str | None) -> str:
    head, rows = ablation_rows(found, ranking, second)
    return table([html.escape(cell) for cell in head], [[html.escape(cell) for cell in row] for row in rows])


def ablation_markdown(found: Sequence[Ablation], ranking: str, second: str | None) -> str:
    head, rows = ablation_rows(found, ranking, second)
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    about = (
        f"Ablations: CG (%) by the ranking {ranking}, and differences paired by seed and object (points, 95 % "
        "interval over both; of one seed over objects alone)."
    )
    return "\n".join([about, "", *(f"| {' | '.join(line)} |" for line in lines)]) + "\n"


def ablation_csv(found: Sequence[Ablation]) -> str:
    """A line a variant, ranking, class and type; rates and differences are fractions."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ["setting", "value", "usual", "K", "ranking", "class", "type", "objects", "seeds"]
    writer.writerow([*head, "rate", "reference", "difference", "low", "high"])
    for ablation in found:
        variant, varies = ablation.variant, ablation.variant.varies
        about = [
            " ".join(varies),
            " ".join(value for value, _ in varies.values()),
            " ".join(u for _, u in varies.values()),
        ]
        for ranking, change in ablation.differences.items():
            for name, kind in ((name, kind) for name in change.mean for kind in variant.runs.types):
                rates = [
                    runs.by_ranking[ranking].get(name, {}).get(kind, float("nan"))
                    for runs in (variant.runs, variant.reference)
                ]
                values = (*rates, change.mean[name][kind], *change.interval95[name][kind])
                row = [*about, variant.runs.K, ranking, name, kind, change.objects, change.seeds]
                writer.writerow([*row, *(f"{value:.6g}" for value in values)])
    return text.getvalue()


def _rate(ablation: Ablation, ranking: str) -> str:
    block = ablation.variant.runs.by_ranking.get(ranking)
    return f"{100 * block['all']['CG']:.1f}" if block else "-"


def _change(ablation: Ablation, ranking: str, name: str) -> str:
    change = ablation.differences.get(ranking)
    if change is None or name not in change.mean:
        return "-"
    mean, (low, high) = change.mean[name]["CG"], change.interval95[name]["CG"]
    return f"{points(mean, 1)} ({points(low, 0)} to {points(high, 0)})"


def points(fraction: float, digits: int) -> str:
    """Percentage points with their sign; what rounds to nothing is +0."""
    return f"{round(100 * fraction, digits) + 0.0:+.{digits}f}"
