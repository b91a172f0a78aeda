"""The report as one HTML file that needs nothing else: styles, pictures, data and plotly.js stand in it."""

from __future__ import annotations

import base64
import html
import io
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from spgf_torch.drawing.style import DPI, LETTERS

WIDTH = 1500  # pixels of a picture in the page; the files beside it are at print resolution
QUALITY = 82  # of WebP
COMPRESSION = 4  # of PNG: half the time of the usual 6 for a tenth more bytes


Trace = dict[str, Any]


@dataclass(frozen=True)
class View:
    """What one WebGL view can show.

    Attributes:
        what: what an item is, for the label of the list. items: its names. traces: of each item, for plotly.js; in the
            place of its corners a trace may have `shape`, an index into `shapes`, and `pose`: 3 x 4 numbers row by row.
        half: half the side of the cube that is shown, mm; 0 = what the item needs. first: the item shown at first.
        centre: of that cube, mm. shapes: `points` (V, 3), and `i`, `j`, `k` of a mesh's faces.
        told: of each item words in plain text; () for none. still: a picture of the first item, where WebGL is missing.
    """

    what: str
    items: tuple[str, ...]
    traces: tuple[list[Trace], ...]
    half: float = 0.0
    first: int = 0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shapes: tuple[dict[str, Any], ...] = ()
    told: tuple[str, ...] = ()
    still: Image.Image | None = None

    def content(self) -> dict[str, Any]:
        """For JSON."""
        told = self.told or [""] * len(self.items)
        items = [
            {"name": name, "traces": traces, "told": words}
            for name, traces, words in zip(self.items, self.traces, told, strict=True)
        ]
        return {"items": items, "half": self.half, "centre": self.centre, "shapes": self.shapes}


@dataclass(frozen=True)
class Section:
    """A part of the page: `body` is HTML."""

    id: str
    title: str
    body: str


def page(title: str, lead: str, sections: Sequence[Section]) -> str:
    """The whole document. plotly.js is in it exactly once."""
    from plotly.offline import get_plotlyjs  # half a second to import

    links = " ".join(f'<a href="#{part.id}">{html.escape(part.title.split(":")[0])}</a>' for part in sections)
    parts = "\n".join(
        f'<section id="{part.id}"><h2>{html.escape(part.title)}</h2>\n{part.body}\n</section>' for part in sections
    )
    folder = files("spgf_torch.drawing")
    styles, script = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{styles}</style></head>\n<body><nav>{links}</nav><main>\n"
        f"<header><h1>{html.escape(title)}</h1>{lead}</header>\n{parts}\n</main>\n"
        f"<script>{get_plotlyjs()}</script>\n<script>\n{script}</script>\n</body></html>\n"
    )


def caption(text: str) -> str:
    """A paragraph of HTML that says what is seen."""
    return f'<p class="caption">{text}</p>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """A small table of HTML cells; the first `words` columns are text."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    lines = [
        "".join(f'<td class="words">{cell}</td>' if i < words else f"<td>{cell}</td>" for i, cell in enumerate(row))
        for row in rows
    ]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>\n{body}\n</tbody></table></div>'


def chart(figure: Figure, alt: str) -> str:
    """A flat chart as SVG within the page: sharp at every size."""
    text = io.StringIO()
    with mpl.rc_context(LETTERS):  # ticks are made while drawing
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    drawn = drawn.replace("<svg", f'<svg role="img" aria-label="{html.escape(alt)}"', 1)
    return f"<figure>{drawn}</figure>"


def drawn(figure: Figure) -> Image.Image:
    """A figure at print resolution."""
    figure.set_dpi(DPI)
    canvas = FigureCanvasAgg(figure)
    with mpl.rc_context(LETTERS):  # ticks are made while drawing
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def png(image: Image.Image) -> bytes:
    """The file of a picture."""
    out = io.BytesIO()
    image.save(out, "PNG", compress_level=COMPRESSION, dpi=(DPI, DPI))
    return out.getvalue()


def picture(image: Image.Image, alt: str) -> str:
    """A picture of things in space, made smaller for the page."""
    small = image.resize((WIDTH, round(WIDTH * image.height / image.width)), Image.Resampling.BOX, reducing_gap=1.5)
    return f"<figure>{_img(small, alt)}</figure>"


def _img(image: Image.Image, alt: str) -> str:
    out = io.BytesIO()
    image.save(out, "WEBP", quality=QUALITY, method=2)
    data = base64.b64encode(out.getvalue()).decode()
    return f'<img alt="{html.escape(alt)}" src="data:image/webp;base64,{data}">'


def turning(view: View) -> str:
    """A 3-D view that turns under the mouse, with a list of what it can show."""
    marks = {view.first: " selected"}
    options = "".join(f"<option{marks.get(i, '')}>{html.escape(name)}</option>" for i, name in enumerate(view.items))
    eyes = "".join(f'<button data-eye="{eye}">{words}</button>' for eye, words in _EYES.items())
    content = json.dumps(view.content(), separators=(",", ":")).replace("</", "<\\/")
    alt = view.items[view.first]
    still = f'<figure class="still">{_img(view.still, alt)}</figure>' if view.still else ""
    return (
        f'<div class="view" tabindex="0" aria-label="{_KEYS}"><div class="tools">'
        f"<label>{view.what} <select>{options}</select></label>"
        f'<button data-step="-1" aria-label="previous">&#9664;</button>'
        f'<button data-step="1" aria-label="next">&#9654;</button>{eyes}'
        '<button data-zoom="0.8" aria-label="nearer">+</button>'
        '<button data-zoom="1.25" aria-label="farther">&minus;</button>'
        f'<span class="hint" title="{_KEYS}">drag to turn, point to read</span></div>'
        f'<p class="told" aria-live="polite"></p>{still}<div class="plot"></div>'
        f'<script type="application/json">{content}</script></div>'
    )


_EYES = {"side": "from the side", "above": "from above", "below": "from below"}
_KEYS = "keys: n and p step, left and right turn, + and - zoom"
