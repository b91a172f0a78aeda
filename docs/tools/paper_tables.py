"""Take the tables and figures of docs/paper.md from a report: python docs/tools/paper_tables.py outputs/report/latest.

A table stands between `<!-- FILE -->` and `<!-- end -->`, where FILE is one of the report's.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
FIGURES = ("fig09_success_over_K.png", "reach_over_K.png")  # the others: report_pictures.py
BLOCK = re.compile(r"(<!-- (\S+\.md) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(text: str, report: Path) -> str:
    """The page with its tables as they are in the report's folder."""
    return BLOCK.sub(lambda found: f"{found[1]}\n{(report / found[2]).read_text()}\n{found[3]}", text)


if __name__ == "__main__":
    report, page = Path(sys.argv[1]), ROOT / "docs/paper.md"
    page.write_text(filled(page.read_text(encoding="utf-8"), report), encoding="utf-8")
    for name in FIGURES:
        shutil.copyfile(report / name, ROOT / "data/report" / name)
