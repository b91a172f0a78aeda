"""`python -m spgf_torch.compare`: descriptors and the learned baseline side by side, from runs of train."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli.command import run_command
from spgf_torch.progress import console, show
from spgf_torch.reporting.config import CompareConfig


def run(config: CompareConfig, folder: Path) -> None:
    """Write tables and the learning curve into `folder`; show the table, the costs and who is ahead of whom."""
    from spgf_torch.reporting.data.comparison import baseline_rows, compare, find_rows
    from spgf_torch.reporting.data.runs import load_runs

    def tell(line: str) -> None:
        console.print(f"compare: {line}")

    rows = find_rows(load_runs(config.runs, tell), config, tell)
    references = rows[config.reference]
    rows |= baseline_rows(config, references[max(references)], tell)
    rankings = dict.fromkeys([config.ranking, *config.rankings])
    comparisons = [compare(rows, config, ranking, tell) for ranking in rankings]

    from spgf_torch.drawing.page import drawn, png
    from spgf_torch.files.writing import write_bytes, write_text
    from spgf_torch.reporting.figures.comparison_chart import learning_curves  # matplotlib: not before there is a curve
    from spgf_torch.reporting.pages.comparison_text import long_csv, markdown, terminal

    write_text(folder / "comparison.md", markdown(comparisons))
    write_text(folder / "comparison.csv", long_csv(comparisons))
    for comparison in comparisons:
        name = "learning_curve" if comparison is comparisons[0] else f"learning_curve_{comparison.ranking}"
        write_bytes(folder / f"{name}.png", png(drawn(learning_curves(comparison))))
    for content in terminal(comparisons):
        show(content)
    show(f"tables and learning curve in {folder}")


if __name__ == "__main__":
    run_command("compare", CompareConfig, run)
