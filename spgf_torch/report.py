"""`python -m spgf_torch.report`: Table 1, the figures and one page from runs of train."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli import door
from spgf_torch.config import ReportConfig
from spgf_torch.progress import Stages, console


def run(config: ReportConfig, folder: Path) -> None:
    """Write tables, pictures and `index.html` into `folder`; show the table."""
    from spgf_torch.progress import show
    from spgf_torch.reporting.build import build
    from spgf_torch.reporting.table1 import terminal

    groups = build(config, folder, Stages(), lambda line: console.print(f"report: {line}", markup=False))
    show(terminal(groups))
    show(f"the whole report: {folder / 'index.html'}")


if __name__ == "__main__":
    door("report", ReportConfig, run)
