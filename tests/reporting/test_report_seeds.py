"""Runs of several seeds as one experiment; what their tables say of K and reach."""

import html
from pathlib import Path

import pytest
from report_runs import defaults, rewritten, without_ranking, write_run

from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.runs import Run, read_run
from spgf_torch.reporting.data.seeds import repeated
from spgf_torch.reporting.data.sweep import find_sweep
from spgf_torch.reporting.pages.context import choose
from spgf_torch.reporting.pages.rate_parts import headline
from spgf_torch.reporting.pages.reach_part import reach_part, reach_rows


@pytest.fixture
def runs(tmp_path: Path) -> list[Run]:
    """Seeds 2, 0 and 1."""
    return [read_run(write_run(tmp_path / f"{n}", skill=n, seed=n, model=n == 1)) for n in (2, 0, 1)]


def cg(run: Run, ranking: str = "paper") -> float:
    return run.by_ranking[ranking]["boxes"]["CG"]


def test_rates_are_means_over_seeds_and_bounds_enclose_every_seed(runs: list[Run]) -> None:
    """One box: its mean is drawn from those of the seeds, so the interval ends at the lowest and the highest."""
    each = repeated(runs, 2000, 0, print)
    rates = [cg(run) for run in runs]
    assert [run.seed for run in each.runs] == [0, 1, 2] and each.seeds["paper"] == (0, 1, 2) and len(set(rates)) > 1
    assert each.rate("paper", "boxes") == pytest.approx(sum(rates) / 3, abs=1e-6)
    assert each.interval95["paper"]["boxes"]["CG"] == pytest.approx((min(rates), max(rates)))
    assert each.random["boxes"] == pytest.approx(runs[0].random["boxes"]) and each.K == 3


def test_a_seed_whose_objects_cannot_be_read_is_told_and_left_out(runs: list[Run]) -> None:
    (runs[2].folder / "per_object.csv").write_text("object\n")
    lines: list[str] = []
    each = repeated(runs, 100, 0, lines.append)
    assert each.seeds["paper"] == (0, 2) and len(lines) == 1 and "mean over seeds" in lines[0]


def test_a_seed_of_other_objects_is_told_and_left_out(runs: list[Run]) -> None:
    path = runs[0].folder / "per_object.csv"
    path.write_text(path.read_text().replace("egg", "apple"))
    rewritten(runs[0].folder, lambda content: None)
    lines: list[str] = []
    each = repeated([read_run(runs[0].folder), *runs[1:]], 100, 0, lines.append)
    assert each.seeds["paper"] == (0, 1) and "expected the objects of the other seeds" in lines[0]


def test_a_ranking_is_of_the_seeds_that_have_it(runs: list[Run]) -> None:
    """Of one seed its rates and bounds are those that the run printed."""
    for run in runs[:2]:
        without_ranking(run.folder, "nested")
    each = repeated([read_run(run.folder) for run in runs], 100, 0, print)
    assert each.seeds["nested"] == (1,) and each.seeds["paper"] == (0, 1, 2)
    assert each.by_ranking["nested"] == runs[2].by_ranking["nested"]
    assert each.interval95["nested"] == runs[2].interval95["nested"]


def report_config() -> ReportConfig:
    return ReportConfig("", "paper", ["nested"], None, objects=1, worst=1, grasps=4, precision=5, bootstrap=100, seed=0)


def test_the_head_of_the_page_says_what_the_numbers_are_of(tmp_path: Path) -> None:
    runs = [read_run(write_run(tmp_path / f"{n}", K=20, seed=n, model=n == 1)) for n in (0, 1)]
    context = choose(report_config(), find_sweep(runs, 100, 0, print), print)
    assert (context.shown.seed, context.row.K, context.second) == (1, 20, "nested")
    text = html.unescape(headline(context).section.body)
    head = text[: text.index("<details>")]
    for words in ("the paper's ranking", "our ranking", "RobWorkSim", "2 seeds", "calibrated to the paper", "83.8 %"):
        assert words in head, words
    assert head.index("the paper's ranking") < head.index("our ranking")


def test_k_and_reach_have_a_table_of_paired_differences(tmp_path: Path) -> None:
    """K = 5 and 20 at two reaches, K = 10 at one alone; the paper's own difference is printed below: 83.8 - 64.6."""
    near = {**defaults()["affordance"], "reach": 0.03}
    runs = [read_run(write_run(tmp_path / f"{K}", K=K, model=False, skill=K / 10)) for K in (5, 10, 20)]
    sweep = find_sweep(runs, 100, 0, print)
    assert reach_part(choose(report_config(), sweep, print)) is None
    runs += [read_run(write_run(tmp_path / f"near{K}", K=K, model=False, affordance=near)) for K in (5, 20)]
    context = choose(report_config(), find_sweep(runs, 100, 0, print), print)
    curves = context.sweep.by_reach()
    head, lines = reach_rows(curves, ["paper"], context)
    assert head[4:] == ["K = 5", "K = 20", "K = 20 minus 5"]
    assert [line[:4] for line in lines[:3]] == [
        ["the paper's ranking", "30", "all", "1"],
        ["the paper's ranking", "100", "all", "1"],
        ["the paper", "not given", "all", "-"],
    ]
    few, many = (curves[0.1][i].rate("paper") for i in (0, 2))
    assert lines[1][6].startswith(f"{100 * (many - few):+.1f} (") and lines[2][4:] == ["64.6", "83.8", "+19.2"]
    part = reach_part(context)
    assert part is not None and set(part.files) == {"reach_over_K.png", "reach.md"}
