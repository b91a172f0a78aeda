"""The picture of the grasp page, opened in a headless Chromium: that of docs/tutorials/first_grasp.md.

python docs/tools/grasp_page_picture.py outputs/predict/latest/index.html [docs/images/grasp_page.png]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image

from spgf_torch.paths import root

sys.path.insert(0, str(root() / "tests"))
from driven_browser import SOFTWARE_GL, DrivenBrowser

WINDOW, WIDTH, COLOURS = (1280, 800), 1000, 256  # px of the window, px across of the picture, colours of its palette


def main(page: Path, picture: Path) -> None:
    """Open the page, wait until it is drawn, and keep a small picture of it."""
    with tempfile.TemporaryDirectory() as folder:
        browser = DrivenBrowser(Path(folder) / "profile", *SOFTWARE_GL)
        try:
            tab = browser.open(page.resolve(), WINDOW)
            tab.until("document.body.dataset.chosen !== undefined")
            tab.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            tab.picture(Path(folder) / "page.png")
        finally:
            browser.close()
        image = Image.open(Path(folder) / "page.png").convert("RGB")
        small = image.resize((WIDTH, round(WIDTH * image.height / image.width)), Image.Resampling.LANCZOS)
        small.quantize(COLOURS, Image.Quantize.FASTOCTREE).save(picture, optimize=True)


if __name__ == "__main__":
    given = [Path(word) for word in sys.argv[1:]]
    main(given[0], given[1] if len(given) > 1 else root() / "docs/images/grasp_page.png")
