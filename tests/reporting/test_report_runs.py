"""Which folders are runs, and what is told about those that cannot be used."""

from pathlib import Path

import pytest
from report_runs import rewritten, without_ranking, write_run

from spgf_torch.errors import InputError
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.runs import load_runs, read_per_object, read_run
from spgf_torch.reporting.data.sweep import Sweep, find_sweep
from spgf_torch.reporting.pages.context import choose

CONFIG = ReportConfig(
    runs="", ranking="nested", rankings=["log_odds"], objects=1, worst=1, grasps=4, precision=5, bootstrap=100, seed=0
)


def swept(runs: list) -> Sweep:
    return find_sweep(runs, 100, 0, print)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two runs and the link to the newer one."""
    for K in (3, 5):
        write_run(tmp_path / f"2026-01-0{K}_00-00-00.000000_K={K}", K=K, model=K == 3)
    (tmp_path / "latest").symlink_to("2026-01-05_00-00-00.000000_K=5")
    return tmp_path


def loaded(runs: object) -> tuple[list, list[str]]:
    lines: list[str] = []
    return load_runs(runs, lines.append), lines


def test_a_folder_of_runs_a_run_or_a_list(folder: Path) -> None:
    runs, lines = loaded(str(folder))
    assert [run.K for run in runs] == [3, 5] and not lines  # the link is no third run
    assert [run.K for run in loaded(str(folder / "latest"))[0]] == [5]
    both = [str(folder), str(folder / "2026-01-03_00-00-00.000000_K=3")]
    assert [run.K for run in loaded(both)[0]] == [3, 5]  # named twice, read once
    assert runs[0].stamp < runs[1].stamp and runs[0].has_model and not runs[1].has_model


@pytest.mark.parametrize("runs", ["nowhere", ["nowhere"], [], 5, None])
def test_no_folder_is_refused(runs: object) -> None:
    with pytest.raises(InputError, match=r"^runs: expected") as error:
        loaded(runs)
    assert "\n" not in str(error.value)


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    (tmp_path / "something").mkdir()
    with pytest.raises(InputError, match="none in"):
        loaded(str(tmp_path))


def test_interrupted_and_damaged_runs_are_told_and_left_out(folder: Path) -> None:
    for name, content in {"half": None, "torn": '{"schema": 1, "succ', "other": '{"schema": 7}'}.items():
        write_run(folder / name, model=False)
        if content is None:
            (folder / name / "results.json").unlink()
        else:
            (folder / name / "results.json").write_text(content)
    without = write_run(folder / "gap", model=False)
    rewritten(without, lambda content: content.pop("ceiling"))
    runs, lines = loaded(str(folder))
    assert [run.K for run in runs] == [3, 5]
    assert len(lines) == 4 and all("left out" in line and "\n" not in line for line in lines)
    assert any("half" in line and "interrupted" in line for line in lines)
    assert any("gap" in line and "ceiling" in line for line in lines)


def test_nothing_left_is_refused(folder: Path) -> None:
    for path in folder.glob("*/results.json"):
        path.unlink()
    lines: list[str] = []
    with pytest.raises(InputError, match="at least one finished run"):
        load_runs(str(folder), lines.append)
    assert len(lines) == 2


def test_other_data_are_left_out_with_one_line(folder: Path) -> None:
    write_run(folder / "2026-01-01_00-00-00.000000_old", K=10, dataset="other", model=False)
    runs, lines = loaded(str(folder))
    assert [run.K for run in runs] == [3, 5]
    assert len(lines) == 1 and "_old" in lines[0] and "other objects, trials or N" in lines[0]
    for K in (11, 12, 13):
        write_run(folder / f"2026-01-01_00-00-00.0000{K}_old", K=K, dataset="other", model=False)
    _, lines = loaded(str(folder))
    assert "left out: 4 runs: other objects, trials or N than the newest run" in lines[0] and "_old" not in lines[0]


def test_a_ranking_that_some_runs_lack_is_told(folder: Path) -> None:
    without_ranking(next(folder.glob("*K=3")), "nested")
    lines: list[str] = []
    context = choose(CONFIG, swept(load_runs(str(folder), lines.append)), lines.append)
    assert context.ranking == "nested" and context.shown.K == 5  # K = 3 has a model and no such ranking
    assert lines == ["no rates by the ranking nested: K = 3; left out of its rows"]


def test_a_ranking_that_no_run_has_is_replaced(folder: Path) -> None:
    for run in folder.glob("*K=*"):
        without_ranking(run, "nested")
    lines: list[str] = []
    context = choose(CONFIG, swept(load_runs(str(folder), lines.append)), lines.append)
    assert context.ranking == "log_odds" and "nested; log_odds is shown instead" in lines[0]


def test_the_shown_run_is_the_best_with_a_model_or_the_one_asked_for(folder: Path) -> None:
    sweep = swept(loaded(str(folder))[0])
    assert choose(CONFIG, sweep, print).shown.K == 3
    CONFIG.show = 5
    assert choose(CONFIG, sweep, print).shown.K == 5
    CONFIG.show = 7
    with pytest.raises(InputError, match="show: expected one of K = 3, 5; got 7"):
        choose(CONFIG, sweep, print)
    CONFIG.show = None


def test_damaged_rates_of_objects_are_refused(folder: Path) -> None:
    (run, _), _ = loaded(str(folder))
    assert len(read_per_object(run)) == 3
    path = run.folder / "per_object.csv"
    path.write_text(path.read_text().replace("nested_CG", "nested_XX"))
    with pytest.raises(InputError, match=r"per_object\.csv: expected the file that results\.json was written with"):
        read_per_object(run)
    rewritten(run.folder, lambda content: None)
    run = read_run(run.folder)
    with pytest.raises(InputError, match=r"per_object\.csv.*nested_CG"):
        read_per_object(run)
