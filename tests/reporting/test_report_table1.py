"""Table 1: its rows, its numbers, and its three formats."""

import csv
import io
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from spgf_torch.reporting.data.runs import Run
from spgf_torch.reporting.data.seeds import Repeats
from spgf_torch.reporting.pages.table1 import (
    Table1,
    about_seeds,
    escape,
    latex,
    long_csv,
    markdown,
    page_table,
    short_markdown,
    table1,
    terminal,
)

RATES = {name: {"NPG": 0.123, "WPG": 0.456, "CG": 0.789} for name in ("containers", "boxes", "curved", "all")}
BOUNDS = {name: {kind: (rate - 0.1, rate + 0.1) for kind, rate in row.items()} for name, row in RATES.items()}
CHANCE = {name: {"NPG": 0.01, "WPG": 0.02} for name in RATES}


def made(K: int, *rankings: str, hand: str = "sdh2") -> Repeats:
    """Five seeds."""
    blocks, bounds = dict.fromkeys(rankings, RATES), dict.fromkeys(rankings, BOUNDS)
    run = Run(
        Path(str(K)), str(K), {"hand": {"name": hand}}, K, 10, 0, "d", blocks, bounds, CHANCE, RATES, RATES, {}, {}
    )
    return Repeats((run,), dict.fromkeys(rankings, (0, 1, 2, 3, 4)), blocks, bounds, CHANCE, RATES, RATES)


def groups(*rows: Repeats, classwise: tuple[Repeats, ...] = ()) -> Table1:
    return table1(rows, classwise, ("nested", "log_odds"), rows[-1])


def test_rows_are_the_papers_then_ours_for_each_k() -> None:
    first, second, alone, chance = groups(made(7, "log_odds"), made(20, "nested", "log_odds")).groups
    assert [row.label for row in first.rows] == ["K = 20, the paper", "K = 20, ours, 5 seeds"]  # K = 7 is not nested
    assert [row.label for row in second.rows] == ["K = 7, ours, 5 seeds", "K = 20, ours, 5 seeds"]  # nor printed
    assert [row.label for row in alone.rows] == ["[*] Thomsen et al. (2015)"]
    assert [row.row for row in chance.rows] == ["random_paper", "random", "random_collision_free", "ceiling"]


def test_markdown_has_the_papers_columns() -> None:
    lines = markdown(groups(made(20, "nested")), "caption").splitlines()
    assert lines[0] == "caption" and lines[2].count("|") == 14
    assert lines[2].startswith("|  | containers NPG | containers WPG | containers CG | boxes NPG")
    assert lines[5].startswith("| K = 20, the paper | 78.0 | 40.5 | 74.0 |")
    assert lines[6].startswith("| K = 20, ours, 5 seeds | 12.3 (2-22) | 45.6 (36-56) | 78.9 (69-89) |")
    assert lines[8] == "| [*] Thomsen et al. (2015) | 68.0 | - | - | - | 84.0 | - | - | 84.0 | - | - | - | - |"
    assert lines[10].startswith("| random, the paper | 10.6 | 11.5 | - |")
    assert all(line.count("|") == 14 for line in lines[2:])


def test_the_short_form_has_two_rankings_and_no_row_without_rates() -> None:
    lines = short_markdown(groups(made(20, "nested", "log_odds"))).splitlines()
    assert lines[3] == "| K = 20, the paper | 74.0 | 87.9 | 92.5 | 37.0 | 70.4 | 83.8 |"
    assert lines[4] == "| K = 20, ours, 5 seeds | 78.9 | 78.9 | 78.9 | 12.3 | 45.6 | 78.9 (69-89) |"
    assert [line.split("**")[1] for line in lines if "**" in line] == [
        "our ranking, nested",
        "ranking: log_odds",
        "chance and ceiling",
    ]


def test_csv_is_long_and_in_fractions() -> None:
    rows = list(csv.DictReader(io.StringIO(long_csv(groups(made(20, "nested"))))))
    assert list(rows[0]) == ["class", "type", "K", "row", "rate", "low", "high", "seeds"]
    found = {(row["class"], row["type"], row["K"], row["row"]): row for row in rows}
    assert found["all", "CG", "20", "paper"]["rate"] == "0.838"
    ours = found["all", "CG", "20", "ours:nested"]
    assert (ours["rate"], ours["low"], ours["high"], ours["seeds"]) == ("0.789", "0.689", "0.889", "5")
    assert found["boxes", "WPG", "", "classwise_paper"]["rate"] == "0.84"
    assert found["all", "NPG", "", "random"]["rate"] == "0.01"
    assert ("all", "CG", "", "random") not in found and ("all", "CG", "", "random_collision_free") in found


def test_latex_is_one_tabular_with_as_many_cells_in_every_row() -> None:
    text = latex(groups(made(20, "nested", "log_odds")), "caption")
    assert text.count(r"\begin{tabular}{lrrrrrrrrrrrr}") == text.count(r"\end{tabular}") == 1
    assert r"\toprule" in text and r"\bottomrule" in text and r"log\_odds" in text
    assert text.count("{") == text.count("}")
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and "multicolumn" not in line]
    assert {line.count("&") for line in rows} == {12}


def test_latex_escapes_everything_special() -> None:
    assert escape("a_b & 5 % #1 $x$ {y} ~ ^ \\") == (
        r"a\_b \& 5 \% \#1 \$x\$ \{y\} \textasciitilde{} \^{} \textbackslash{}"
    )


def test_page_marks_the_k_that_is_the_papers_best() -> None:
    lines = page_table(groups(made(10, "nested"), made(20, "nested")).groups, ("NPG", "WPG", "CG")).splitlines()
    assert [line.split("<th>")[1].split("<")[0] for line in lines if "best" in line.split(">")[0]] == [
        "K = 20, the paper",
        "K = 20, ours, 5 seeds",
    ]


def test_classes_by_themselves_stand_below_the_printed_row() -> None:
    alone = groups(made(20, "nested"), classwise=(made(10, "nested"), made(20, "nested"))).groups[-2]
    assert [(row.row, row.label, row.K) for row in alone.rows[1:]] == [
        ("classwise_ours:nested", "K = 10, by nested, 5 seeds", 10),
        ("classwise_ours:nested", "K = 20, by nested, 5 seeds", 20),
    ]


def test_a_table_says_how_many_seeds_it_is_of() -> None:
    one = replace(made(20, "nested"), seeds={"nested": (3,)})
    assert about_seeds(groups(one)).startswith("Ours: one seed; 95 % intervals over objects alone")
    assert "means over 5 seeds, 95 % intervals over seeds and objects together." in about_seeds(
        groups(made(20, "nested"))
    )
    assert "over 1 to 5 seeds" in about_seeds(groups(one, made(10, "nested")))


def test_the_terminal_shows_two_rankings_in_80_columns() -> None:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal(groups(made(20, "nested", "log_odds", "paper"))))
    text = console.export_text()
    assert "our ranking, nested" in text and "ranking: log_odds" in text and text.count("78.9 (69-89)") == 2
    assert "RobWorkSim" in text and "5 seeds" in text and "…" not in text and "[*]" not in text


def test_of_another_hand_nothing_of_the_papers_stands_beside() -> None:
    """Three types: 4 x 4 columns; no row of the paper's, nor what is to be said beside them."""
    kinds = ("hook", "pinch", "sphere")
    block = {name: {**dict.fromkeys(kinds, 0.25), "CG": 0.5} for name in RATES}
    bounds = {name: dict.fromkeys(row, (0.1, 0.6)) for name, row in block.items()}
    chance = {name: dict.fromkeys(kinds, 0.125) for name in RATES}
    by_ranking, interval = {"nested": block}, {"nested": bounds}
    run = Run(
        Path("a"), "a", {"hand": {"name": "claw"}}, 20, 10, 0, "d", by_ranking, interval, chance, block, block, {}, {}
    )
    row = Repeats((run,), {"nested": (0,)}, by_ranking, interval, chance, block, block)
    found = table1([row], [], ("nested",), row)
    assert found.types == (*kinds, "CG") and found.other_data == ""
    assert [each.row for group in found.groups for each in group.rows] == [
        "ours:nested",
        "random",
        "random_collision_free",
        "ceiling",
    ]
    text = markdown(found, "")
    assert all(line.count("|") == 18 for line in text.splitlines()[2:]) and "paper" not in text
    assert "| K = 20, ours, 1 seed | 25.0 (10-60) | 25.0 (10-60) | 25.0 (10-60) | 50.0 (10-60) |" in text
    assert latex(found, "").count(r"\multicolumn{4}{c}") == 4 and r"\cmidrule(lr){14-17}" in latex(found, "")
    assert short_markdown(found).splitlines()[0].endswith("| curved CG | all hook | all pinch | all sphere | all CG |")
    assert 'colspan="4"' in page_table(found.groups, found.types)
