"""Table 1: its rows, its numbers, and its three formats."""

import csv
import io
from pathlib import Path

from spgf_torch.reporting.data.runs import Run
from spgf_torch.reporting.pages.table1 import escape, latex, long_csv, markdown, page_table, table1

RATES = {name: {"NPG": 0.123, "WPG": 0.456, "CG": 0.789} for name in ("containers", "boxes", "curved", "all")}
BOUNDS = {name: {kind: (rate - 0.1, rate + 0.1) for kind, rate in row.items()} for name, row in RATES.items()}
CHANCE = {name: {"NPG": 0.01, "WPG": 0.02} for name in RATES}


def made(K: int, *rankings: str) -> Run:
    blocks, bounds = dict.fromkeys(rankings, RATES), dict.fromkeys(rankings, BOUNDS)
    return Run(Path(str(K)), str(K), {}, K, 10, 0, "d", blocks, bounds, CHANCE, RATES, RATES, {}, {})


def groups(*runs: Run) -> list:
    return table1(runs, ("nested", "log_odds"), runs[-1])


def test_rows_are_the_papers_then_ours_for_each_k() -> None:
    first, second, chance = groups(made(7, "log_odds"), made(20, "nested", "log_odds"))
    assert [row.label for row in first.rows] == ["K = 20, paper", "K = 20, ours"]  # K = 7 has no nested ranking
    assert [row.label for row in second.rows] == ["K = 7, ours", "K = 20, paper", "K = 20, ours"]  # and no paper's row
    assert [row.row for row in chance.rows] == ["random_paper", "random", "random_collision_free", "ceiling"]


def test_markdown_has_the_papers_columns() -> None:
    lines = markdown(groups(made(20, "nested")), "caption").splitlines()
    assert lines[0] == "caption" and lines[2].count("|") == 14
    assert lines[2].startswith("|  | containers NPG | containers WPG | containers CG | boxes NPG")
    assert lines[5].startswith("| K = 20, paper | 78.0 | 40.5 | 74.0 |")
    assert lines[6].startswith("| K = 20, ours | 12.3 (2-22) | 45.6 (36-56) | 78.9 (69-89) |")
    assert lines[8].startswith("| random, paper | 10.6 | 11.5 | - |")
    assert all(line.count("|") == 14 for line in lines[2:])


def test_csv_is_long_and_in_fractions() -> None:
    rows = list(csv.DictReader(io.StringIO(long_csv(groups(made(20, "nested"))))))
    assert list(rows[0]) == ["class", "type", "K", "row", "rate", "low", "high"]
    found = {(row["class"], row["type"], row["K"], row["row"]): row for row in rows}
    assert found["all", "CG", "20", "paper"]["rate"] == "0.838"
    ours = found["all", "CG", "20", "ours:nested"]
    assert (ours["rate"], ours["low"], ours["high"]) == ("0.789", "0.689", "0.889")
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


def test_page_marks_the_best_k_of_each_ranking() -> None:
    better = {**RATES, "all": {**RATES["all"], "CG": 0.9}}
    good = made(10, "nested")
    good.by_ranking["nested"] = better
    lines = page_table(groups(good, made(20, "nested"))).splitlines()
    assert [line.split("<th>")[1].split("<")[0] for line in lines if "best" in line.split(">")[0]] == [
        "K = 10, paper",
        "K = 10, ours",
    ]
