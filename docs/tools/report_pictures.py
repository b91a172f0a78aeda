"""The pictures of a report that docs/paper.md shows, made small for the repository.

python docs/tools/report_pictures.py outputs/report/latest [data/report]
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image

NAMES = ("fig01_overview", "fig07_setup", "fig10_prototypes", "fig11_objects", "fig12_NPG", "fig13_WPG")
WIDTH, COLOURS, ROUNDS = 1400, 256, 3  # pixels; colours of a palette, and rounds of k-means that place them


def main(report: Path, into: Path) -> None:
    for name in NAMES:
        with Image.open(report / f"{name}.png") as picture:
            size = (WIDTH, round(WIDTH * picture.height / picture.width))
            small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        few = small.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, ROUNDS, dither=Image.Dither.NONE)
        few.save(into / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "data/report"))
