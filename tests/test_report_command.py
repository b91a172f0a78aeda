"""`python -m spgf_torch.report` from the outside: every file it leaves, and the page in a real browser."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from browser import needs_browser, opened
from commands import here

sys.path.insert(0, str(Path(__file__).parent / "reporting"))
from report_runs import defaults, write_run

from spgf_torch.progress import ProgressReporter
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.runs import Notes, load_runs
from spgf_torch.reporting.pages.build import build

ROOT = Path(__file__).parents[1]
PICTURES = [
    *("fig01_overview", "fig02_angles", "fig03_grid", "fig04_moving_average", "fig05_alignment"),
    *("fig06_transformation", "fig07_setup"),
    *("fig09_success_over_K", "reach_over_K", "fig10_prototypes", "fig11_objects", "fig12_NPG", "fig13_WPG"),
    *("reliability", "precision_at_n", "worst_objects"),
]
TABLES = ["table1.md", "table1_short.md", "table1.csv", "table1.tex", "ablations.md", "ablations.csv", "reach.md"]
SMALL = ["objects=1", "worst=2", "grasps=6", "precision=20", "bootstrap=200"]
# Draws at once what the page draws one after another, before the browser takes its picture; then presses every button.
PRESS = """<script>
for (const view of waiting.splice(0)) start(view);
for (const button of document.querySelectorAll(".view button")) button.click();
console.info(`views drawn: ${document.querySelectorAll(".view .gl-container canvas").length}`);
</script>"""


def report(*overrides: str, cwd: Path) -> subprocess.CompletedProcess:
    return here("report", *overrides, cwd=cwd)


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess]:
    """A report on a sweep of two K with two seeds, another reach, a variant, an interrupted run, one of other data."""
    folder = tmp_path_factory.mktemp("report")
    runs = folder / "outputs/train"
    write_run(runs / "2026-01-01_00-00-00.000000_a", K=3, skill=2)
    write_run(runs / "2026-01-01_00-00-01.000000_b", K=5, skill=1, model=False)
    write_run(runs / "2026-01-01_00-00-01.100000_b", K=3, skill=1, model=False, seed=1)
    near = {**defaults()["affordance"], "reach": 0.05}
    for K in (3, 5):
        write_run(runs / f"2026-01-01_00-00-01.200000_n{K}", K=K, model=False, affordance=near)
    write_run(runs / "2026-01-01_00-00-02.000000_c", K=3, skill=0, model=False, folds=2)
    write_run(runs / "2026-01-01_00-00-00.500000_d", K=10, model=False, dataset="other")
    write_run(runs / "2026-01-01_00-00-03.000000_e", K=3, model=False)
    (runs / "2026-01-01_00-00-03.000000_e/results.json").unlink()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spgf_torch.drawing.page.DPI", 100)  # pictures as in print would take most of the time
        return folder / "outputs/report/latest", report(*SMALL, cwd=folder)


def test_every_file_is_there_and_nothing_half_written(
    reported: tuple[Path, subprocess.CompletedProcess],
) -> None:
    folder, done = reported
    assert done.returncode == 0, done.stderr
    expected = {"index.html", "config.yaml", *TABLES, *(f"{name}.png" for name in PICTURES)}
    assert {path.name for path in folder.iterdir()} == expected
    for name in PICTURES:
        assert (folder / f"{name}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "folds = 2 (3)" in (folder / "ablations.md").read_text()
    assert "K = 3, ours, 2 seeds" in (folder / "table1.md").read_text()
    assert "K = 5, the paper" in done.stdout and "index.html" in done.stdout
    told = [line for line in done.stderr.splitlines() if line.startswith("report:")]
    assert len(told) == 3 and "interrupted" in told[0] and "other objects" in told[1] and "fold_models=true" in told[2]
    assert "Warning" not in done.stderr, done.stderr


def test_the_page_needs_nothing_else(reported: tuple[Path, subprocess.CompletedProcess]) -> None:
    text = (reported[0] / "index.html").read_text()
    assert len(text.encode()) <= 15e6
    assert text.count("plotly.js v") == 1  # the banner of the library
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)  # plotly.js itself has addresses, unused
    assert not re.search(r"""(src|href)=["']?(https?:)?//|url\(["']?(https?:)?//|@import""", own)
    assert own.count('class="view"') == 5 and "wall 1" in own and "interrupted" in own
    assert {"summary", "table1", "choice", *(f"fig{i}" for i in (1, 2, 7, 8, 9, 10, 13)), "worst", "ablations"} <= set(
        re.findall(r'id="(\w+)"', own)
    )


@needs_browser
def test_a_browser_opens_the_page_without_errors(
    reported: tuple[Path, subprocess.CompletedProcess], tmp_path: Path
) -> None:
    page, picture = tmp_path / "page.html", tmp_path / "page.png"
    page.write_text((reported[0] / "index.html").read_text() + PRESS)
    console = opened(page, picture, "--hide-scrollbars", size=(1280, 3000))
    assert any('"views drawn: 5"' in line for line in console), console
    assert not [line for line in console if re.search("Error|Uncaught|ERR_|WebGL is not supported", line)]
    assert picture.stat().st_size > 50_000


UNUSABLE = {
    "runs=nowhere": ["runs", "nowhere"],
    "worst=0": ["worst", "1 to 100", "got 0"],
    "pictured=99": ["pictured: expected a K of runs with a model (3), got 99"],
}


def test_unusable_input_is_one_line(tmp_path: Path) -> None:
    write_run(tmp_path / "run", K=3)
    lines = [[override, "runs=run"] if "pictured" in override else [override] for override in UNUSABLE]
    for line, words in zip(lines, UNUSABLE.values(), strict=True):
        done = here("report", *line, cwd=tmp_path)
        assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr
        assert all(word in done.stderr for word in words)
    assert not list(tmp_path.glob("outputs/report/*"))


def test_torn_files_leave_their_figures_out(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", K=3)
    (run / "model.safetensors").write_bytes(b"torn")
    (run / "predictions.parquet").write_bytes(b"torn")
    rates = ["nested", "paper"]
    config = ReportConfig(
        str(run),
        rates[0],
        rates,
        None,
        pictured=None,
        fold=None,
        objects=1,
        worst=1,
        grasps=4,
        precision=5,
        bootstrap=100,
        seed=0,
    )
    notes = Notes()
    build(config, load_runs(config.runs, notes), tmp_path, ProgressReporter(), notes)
    assert {"index.html", "table1.md"} <= {path.name for path in tmp_path.iterdir()}
    assert not list(tmp_path.glob("fig1*")) and not (tmp_path / "reliability.png").exists()
    assert len(notes.lines) == 2
    assert "predictions.parquet" in notes.lines[0] and "model.safetensors" in notes.lines[1]
