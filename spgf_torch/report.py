"""`python -m spgf_torch.report`: Table 1, the figures and one page from runs of train."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli.command import run_command
from spgf_torch.extras import needed
from spgf_torch.progress import ProgressReporter, show
from spgf_torch.reporting.config import ReportConfig


def run(config: ReportConfig, folder: Path) -> None:
    """Write tables, pictures and `index.html` into `folder`; show the table."""
    needed("index.html", "plotly")

    from spgf_torch.reporting.data.runs import Notes, load_runs

    notes, stages = Notes(), ProgressReporter()
    runs = load_runs(config.runs, notes, pictured=True)

    from spgf_torch.reporting.pages.build import (
        build,  # brings torch and matplotlib: not before there is something to draw
    )
    from spgf_torch.reporting.pages.table1 import terminal

    groups = build(config, runs, folder, stages, notes)
    show(terminal(groups))
    show(f"the whole report: {folder / 'index.html'}")


if __name__ == "__main__":
    run_command("report", ReportConfig, run)
