"""Rows of `conf/comparison` side by side: which runs are taken, who is ahead, what is written."""

import csv
import io
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from composing import composed
from PIL import Image
from report_runs import defaults, rewritten, without_ranking, write_run

from spgf_torch.compare import run
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.reporting.config import CompareConfig
from spgf_torch.reporting.data.comparison import Entry, baseline_rows, committed, compare, find_rows
from spgf_torch.reporting.data.costs import Costs, costs_of
from spgf_torch.reporting.data.runs import load_runs
from spgf_torch.reporting.data.seeds import Repeats
from spgf_torch.reporting.data.sweep import Difference
from spgf_torch.reporting.pages.comparison_text import costs, long_csv, markdown, seeds_told, verdict
from spgf_torch.settings import typed

ROWS = ("fpfh", "normal_only", "patch_pairs", "random_axis", "spgf")


def config(**changes: Any) -> CompareConfig:
    return typed(CompareConfig, {**composed("compare", "bootstrap=100", "K=3"), "baseline": None, **changes})


def features(**changes: str) -> dict[str, Any]:
    return {**defaults()["features"], **changes}


def row(folder: Path, name: str, trials: int = 1000, skill: float = 3.0, **changes: Any) -> Path:
    """A run of a row of `conf/comparison`; its folder's name sorts by row."""
    K = 1 if name == "normal_only" else 3
    varied = {
        "spgf": {},
        "fpfh": {"descriptor": "fpfh"},
        "patch_pairs": {"descriptor": "patch_pairs"},
        "random_axis": {"alignment": "random"},
        "normal_only": {"alignment": "random"},
    }[name]
    settings = {"features": features(**varied), "trials_per_object": trials, **changes}
    path = folder / f"2026-01-01_00-00-{ROWS.index(name):02d}.{trials:06d}"
    return write_run(path, K=K, skill=skill, model=False, **settings)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    for name in ROWS:
        row(folder, name, skill=-3.0 if name == "patch_pairs" else 3.0)
    row(folder, "spgf", trials=25, skill=0.0)
    row(folder, "fpfh", trials=25, skill=6.0)
    return folder


@pytest.fixture
def runs(made: Path, tmp_path: Path) -> Path:
    """A folder of runs to change: every row with 1000 trials, two with 25."""
    return Path(shutil.copytree(made, tmp_path / "train"))


def found(folder: Path, **changes: Any) -> tuple[dict[str, dict[int, Repeats]], list[str]]:
    lines: list[str] = []
    return find_rows(load_runs(str(folder), lines.append), config(**changes), lines.append), lines


@pytest.mark.parametrize("name", ROWS)
def test_every_committed_row_composes_and_differs_in_what_it_says(name: str) -> None:
    values = composed("train", f"+comparison={name}")
    values["K"] = values["prototypes"]["num_clusters"] if values["K"] == "???" else values["K"]
    made = typed(TrainConfig, values)
    expected = {"normal_only": ("spgf", "random", 1), "random_axis": ("spgf", "random", 20)}
    assert (made.features.descriptor, made.features.alignment, made.K) == expected.get(name, (
        name, "argmax", 20))  # fmt: skip
    assert set(committed()) == set(ROWS)


def test_runs_find_their_rows(runs: Path) -> None:
    rows, lines = found(runs)
    assert {name: sorted(of_row) for name, of_row in rows.items()} == {
        "fpfh": [25, 1000], "normal_only": [1000], "patch_pairs": [1000], "random_axis": [1000], "spgf": [25, 1000],
    }  # fmt: skip
    assert rows["normal_only"][1000].K == 1
    missing = "normal_only (25), patch_pairs (25), random_axis (25)"
    assert lines == [f"not run, or not with as many trials as spgf: {missing}"]


def test_other_runs_are_left_to_others(runs: Path) -> None:
    """Another K and another radius: each group of settings has fewer rows than the comparison."""
    write_run(runs / "2026-01-02_00-00-00", K=5, model=False)
    write_run(runs / "2026-01-02_00-00-01", K=3, model=False, features=features(radius=0.02))
    rows, lines = found(runs)
    assert all(repeats.stamp < "2026-01-02" for of_row in rows.values() for repeats in of_row.values())
    assert lines[0] == "2 of 9 runs are no rows of this comparison, or older ones of the same settings"


def test_seeds_are_one_entry_and_differences_are_of_those_shared(runs: Path) -> None:
    """The reference has seeds 0 and 1, FPFH too, the others 0 alone."""
    for name in ("spgf", "fpfh"):
        row(runs / "other", name, skill=0.5, seed=1).rename(runs / f"2026-01-02_00-00-{name}")
    (runs / "other").rmdir()
    rows, _ = found(runs)
    result = compare(rows, config(), "nested", print)
    entries = {entry.name: entry for entry in result.table}
    assert entries["fpfh"].runs.seeds["nested"] == (0, 1) and entries["random_axis"].runs.seeds["nested"] == (0,)
    seeds = {name: entry.change.seeds for name, entry in entries.items() if entry.change}
    assert seeds == {"fpfh": 2, "random_axis": 1, "patch_pairs": 1, "normal_only": 1}
    mean = sum(run.by_ranking["nested"]["all"]["CG"] for run in entries["spgf"].runs.runs) / 2
    assert entries["spgf"].rates["all"]["CG"] == pytest.approx(mean, abs=1e-5)
    assert seeds_told(result).startswith("Means over 1 to 2 seeds") and "Means over 1 to 2 seeds" in markdown([result])


def test_without_the_reference_the_command_is_named(runs: Path) -> None:
    with pytest.raises(InputError, match=r"conf/comparison/spgf.yaml with K = 20 \(python -m spgf_torch.train -m"):
        found(runs, K=20)
    with pytest.raises(InputError, match=r"reference: expected one of conf/comparison \(fpfh, .*\), got magic"):
        found(runs, reference="magic")


def test_rates_differences_and_order(runs: Path) -> None:
    rows, _ = found(runs)
    lines: list[str] = []
    result = compare(rows, config(), "nested", lines.append)
    assert result.trials == 1000 and not lines
    names = [entry.name for entry in result.table]
    assert names[0] == "spgf" and names[-1] == "patch_pairs" and len(names) == 5
    spgf, worst = result.table[0], result.table[-1]
    assert spgf.change is None and worst.change is not None
    expected = worst.rates["all"]["CG"] - spgf.rates["all"]["CG"]
    assert worst.change.mean["all"]["CG"] == pytest.approx(expected, abs=1e-6)
    early = next(entry for entry in result.curve("fpfh") if entry.trials == 25)
    assert early.change is not None and early.change.mean["all"]["CG"] > 0  # against the reference of 25 trials
    assert result.random["all"]["CG"] == pytest.approx(
        sum(result.random["all"][kind] for kind in ("NPG", "WPG")) / 2, abs=1e-6
    )
    assert "CG" in result.random_bounds["boxes"]


@pytest.mark.parametrize(
    ("changes", "ranking", "words"),
    [({"trials_per_object": 50}, "nested", r"spgf's runs \(25, 1000\), got 50"), ({}, "best", "expected one of paper")],
)
def test_refusals(runs: Path, changes: dict[str, Any], ranking: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        compare(found(runs)[0], config(**changes), ranking, print)


def test_a_run_whose_objects_cannot_be_read_is_told(runs: Path) -> None:
    rows, _ = found(runs)
    (rows["fpfh"][25].runs[0].folder / "per_object.csv").write_text("object\n")
    lines: list[str] = []
    assert len(compare(rows, config(), "nested", lines.append).entries) == 6
    assert len(lines) == 1 and "per_object.csv" in lines[0]


def test_the_verdict_follows_from_the_intervals() -> None:
    """Ahead where the whole interval is above 0, behind where it is below, else not told apart."""
    intervals = {"up": (0.001, 0.041), "down": (-0.08, -0.01), "touching": (1e-17, 0.05), "wide": (-0.1, 0.1)}

    def entry(name: str, low: float, high: float) -> Entry:
        change = Difference(50, 1, {"all": {"CG": (low + high) / 2}}, {"all": {"CG": (low, high)}})
        return Entry(name, 1000, None, {}, {}, change, None)  # type: ignore[arg-type]

    told = verdict([entry(name, *bounds) for name, bounds in intervals.items()], "spgf", "all", "CG")
    assert told == (
        "all CG: better than spgf: up (+2.1, +0.1 to +4.1); worse: down (-4.5, -8.0 to -1.0); "
        "not told apart: touching (+2.5, +0.0 to +5.0), wide (+0.0, -10.0 to +10.0)"
    )
    assert verdict([], "spgf", "all", "CG") == "all CG: nothing to compare spgf with"


def spend(folder: Path, seconds: dict[str, float], from_cache: dict[str, int], **costs: float) -> None:
    more = {"seconds": seconds, "from_cache": from_cache} | ({"costs": costs} if costs else {})
    rewritten(folder, lambda results: results.update(more))


def test_costs_are_of_the_run_that_made_what_others_read(runs: Path) -> None:
    """The 1000-trial run of FPFH read its features, pairs and prototypes from the cache; that of 25 had made them.

    20 s of its own voting, and 3 + 4 + 5 of the other's stages. Of the random axis nobody made the prototypes.
    """
    rows, _ = found(runs)
    cached = {"features": 3, "pairs": 3, "prototypes": 4}
    stages = {"sensing": 9.0, "features": 3.0, "particles": 4.0, "prototypes": 5.0, "voting": 6.0, "total": 30.0}
    spend(rows["fpfh"][25].runs[0].folder, stages, {})
    read = {"features": 0.01, "particles": 0.01, "prototypes": 0.01, "voting": 20.0}
    spend(rows["fpfh"][1000].runs[0].folder, read, cached, model_bytes=5, prediction_ms=70.5)
    spend(rows["random_axis"][1000].runs[0].folder, read, {"prototypes": 4})
    spend(rows["spgf"][1000].runs[0].folder, {"total": 600.0}, {}, training_s=500.0)
    spent = costs_of([each.runs[0] for of_row in rows.values() for each in of_row.values()])
    assert spent[rows["fpfh"][1000].runs[0].stamp] == Costs(32.0, False, 70.5, 5)
    told = spent[rows["random_axis"][1000].runs[0].stamp]
    assert told.at_least and told.training_s == pytest.approx(20.03) and told.model_bytes is None
    assert spent[rows["spgf"][1000].runs[0].stamp] == Costs(500.0, False, None, None)
    assert costs(spent[rows["fpfh"][1000].runs[0].stamp]) == ["32.0", "70", "0.0"] and costs(told)[0] == "> 20.0"


def test_the_learned_baseline_joins(runs: Path, tmp_path: Path) -> None:
    """A network has no votes to rank as the paper does; runs of other data are left out."""
    made = row(tmp_path / "baseline", "spgf", skill=5.0)
    without_ranking(made, "paper")
    other = row(tmp_path / "baseline", "fpfh", dataset="d2")
    rows, _ = found(runs)
    lines: list[str] = []
    settings = config(baseline=str(tmp_path / "baseline"))
    other.rename(tmp_path / "baseline/2025-01-01_00-00-00")
    learned = baseline_rows(settings, rows["spgf"][1000], lines.append)
    assert list(learned) == ["learned"] and list(learned["learned"]) == [1000] and len(lines) == 1
    result = compare({**rows, **learned}, settings, "nested", lines.append)
    entry = next(entry for entry in result.table if entry.name == "learned")
    assert entry.rates == entry.runs.by_ranking["nested"] and entry.change is not None
    assert "learned" not in {e.name for e in compare({**rows, **learned}, settings, "paper", lines.append).entries}
    assert "left out of the ranking paper: learned" in lines[-1]
    (run,) = rows["spgf"][1000].runs
    reference = replace(rows["spgf"][1000], runs=(replace(run, dataset="d3"),))
    assert baseline_rows(settings, reference, lines.append) == {}
    assert baseline_rows(config(baseline=str(tmp_path / "no")), reference, lines.append) == {}
    assert "no row of the learned baseline" in lines[-1]


def test_the_command_writes_tables_and_a_figure(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "run").mkdir()
    run(config(runs=str(runs), rankings=["paper"]), tmp_path / "run")
    out = capsys.readouterr().out
    assert "patch_pairs" in out and "all CG: " in out and max(map(len, out.splitlines()[:14])) <= 100
    text = (tmp_path / "run/comparison.md").read_text()
    assert "ranking nested" in text and "ranking paper" in text and "## Costs" in text
    lines = list(csv.DictReader(io.StringIO((tmp_path / "run/comparison.csv").read_text())))
    assert {line["row"] for line in lines} == {*ROWS, "random"}
    assert {line["ranking"] for line in lines} == {"nested", "paper"}
    one = next(line for line in lines if (line["row"], line["type"], line["trials"]) == ("fpfh", "CG", "25"))
    assert float(one["difference_low"]) <= float(one["difference"]) <= float(one["difference_high"])
    with Image.open(tmp_path / "run/learning_curve.png") as image:
        assert image.width > 2000
    assert (tmp_path / "run/learning_curve_paper.png").is_file()


def test_long_csv_says_the_costs(runs: Path) -> None:
    rows, _ = found(runs)
    spend(rows["spgf"][1000].runs[0].folder, {"voting": 1.0}, {}, model_bytes=125038272, prediction_ms=70.0)
    text = long_csv([compare(rows, config(), "paper", print)])
    assert any(line.split(",")[1] == "spgf" and "125038272" in line for line in text.splitlines())
