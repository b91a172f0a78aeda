"""The grasp page: one HTML file, which needs nothing else, with a view in three dimensions, a table and the reasons.

What it does is in `viewer/`: three.js in `three.min.js`, bundled by `make viewer`, and the page's own script beside it.
"""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np
from PIL import Image

from spgf_torch.drawing.grasp_content import eyes, page_content
from spgf_torch.drawing.grasp_picture import scene_picture
from spgf_torch.drawing.grasp_scene import Beside, Scene, Told, scene_of
from spgf_torch.drawing.grasp_table import direction, opened
from spgf_torch.drawing.page import drawn, png, table
from spgf_torch.drawing.style import SUCCESS_SCALE
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.hands.records import Grasp, Gripper

# three.js, then the page's own, in this order.
SCRIPTS = tuple(
    f"{name}.js"
    for name in (
        "three.min",
        "data",
        "hand",
        "cloud",
        "outlines",
        "votes",
        "surroundings",
        "stage",
        "filters",
        "why",
        "main",
    )
)
STILL, COLOURS = 900, 128  # pixels across of the picture in the page, and its colours


def write_scene_page(
    page_path: Path | None,
    picture_path: Path,
    points: np.ndarray,
    normals: np.ndarray,
    grasps: Sequence[Grasp],
    grippers: Mapping[str, Gripper],
    names: Sequence[str] | None = None,
    beside: Beside | None = None,
) -> None:
    """Write the cloud with its grasps as a page (.html) and as a picture (.png).

    Args:
        page_path: None: no page.
        points, normals: (M, 3), m and unit, of the targets, in the input's frame.
        grasps: best first. grippers: `records.grippers_of` the hand. names: a word for each prototype.
        beside: all else that was sensed or is known, and what is told.

    Raises:
        InputError: no points, or points and normals of different shapes.
    """
    beside = beside or Beside()
    scene = scene_of(points, normals, grasps, grippers, beside)
    picture = drawn(scene_picture(scene))
    write_bytes(picture_path, png(picture))
    if page_path is not None:
        content = page_content(points, normals, grasps, grippers, scene.eye, names or (), beside)
        write_text(page_path, _document(scene, content, picture, beside))


def _document(scene: Scene, content: Mapping[str, object], picture: Image.Image, beside: Beside) -> str:
    folder = files("spgf_torch.drawing").joinpath("viewer")
    parts = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.html", "viewer.css", *SCRIPTS)}
    head = dict(beside.told.head)
    file = head.pop("file", "")
    return Template(parts["page.html"]).substitute(
        title=html.escape(f"Grasps for {file}" if file else "Grasps"),
        styles=parts["viewer.css"],
        facts="".join(_fact(name, value) for name, value in ({"grasps": str(len(scene.grasps))} | head).items()),
        doubts="".join(f'<p class="doubt">{html.escape(line)}</p>' for line in beside.told.doubts),
        still=_small(picture),
        ramp=", ".join(f"{colour} {100 * place:.0f}%" for place, colour in SUCCESS_SCALE),
        notes=_notes(beside.told),
        content=json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        library=parts["three.min.js"],
        script="\n".join(parts[name] for name in SCRIPTS[1:]),
        **_controls(scene, beside),
        table=_table(scene) if scene.grasps else "<p>No grasp.</p>",
    )


def _fact(name: str, value: str) -> str:
    words = html.escape(value)
    return f"<div><dt>{html.escape(name)}</dt><dd>{f'<code>{words}</code>' if name == 'command' else words}</dd></div>"


def _controls(scene: Scene, beside: Beside) -> dict[str, str]:
    """The controls that there are things for: HTML by its place in the page."""
    types, targets = (sorted({getattr(grasp, name) for grasp in scene.grasps}) for name in ("type", "target"))
    kinds = "".join(_box(f'name="type" value="{html.escape(name)}"', html.escape(name)) for name in types)
    numbers = "".join(f'<option value="{target}">{target}</option>' for target in targets)
    several = f'<label>target <select name="target"><option value="">all</option>{numbers}</select></label>'
    voted = any(grasp.voters is not None and len(grasp.voters) for grasp in scene.grasps)
    absent = {
        "votes": not voted,
        "table": beside.table is None,
        "cameras": not beside.cameras,
        "rest": not _anything_else(beside),
    }
    return {
        "eyes": "".join(
            f'<button type="button" data-eye="{name}">{name}</button>'
            for name in ("grasp", *eyes(scene.eye), *(["camera"] if beside.cameras else []))
        ),
        "parts": "".join(
            _box(f'data-part="{name}"', words, name != "others")
            for name, words in _PARTS.items()
            if not absent.get(name, False)
        ),
        "kinds": f"<fieldset><legend>type</legend>{kinds}</fieldset>" if len(types) > 1 else "",
        "targets": several if len(targets) > 1 else "",
    }


def _box(what: str, words: str, checked: bool = True) -> str:
    """A box to tick; the other grasps begin unticked, since they would hide what is grasped."""
    return f'<label><input type="checkbox" {what}{" checked" if checked else ""}> {words}</label>'


def _anything_else(beside: Beside) -> bool:
    """Whether anything but targets was sensed."""
    return bool(len(beside.obstacles)) or (beside.sensed is not None and not beside.sensed.target.all())


def _table(scene: Scene) -> str:
    several = len({grasp.target for grasp in scene.grasps}) > 1
    judged = any(grasp.judged for grasp in scene.grasps)
    reasons = ("free", "holds") if judged else ("votes",)
    target, place = ("target",) * several, ("x y z (mm)", "approach")
    colours = ["rgb({}, {}, {})".format(*(255 * colour).round().astype(int)) for colour in scene.grasp_colours]
    rows = [
        [
            f'<button type="button" aria-pressed="false">{rank}</button>',
            html.escape(grasp.type),
            *([str(grasp.target)] if several else []),
            f'<i class="swatch" style="background:{colours[rank - 1]}"></i>{100 * grasp.probability:.1f}',
            *([f"{100 * each:.0f}" for each in grasp.judged or (0.0, 0.0)] if judged else [str(grasp.support)]),
            " ".join(f"{1000 * value:.0f}" for value in grasp.T_input_tcp[:3, 3] + 0.0),
            direction(grasp),
        ]
        for rank, grasp in enumerate(scene.grasps, start=1)
    ]
    types = f'<p class="soft">{html.escape(opened(scene.grasps))}</p>'
    return table(("rank", "type", *target, "prob. (%)", *reasons, *place), rows, 2) + types


def _notes(told: Told) -> str:
    parts = (("Model", told.lines), ("Input", told.notes))
    return "".join(
        f"<h2>{title}</h2><ul>{''.join(f'<li>{html.escape(line)}</li>' for line in lines)}</ul>"
        for title, lines in parts
        if lines
    )


def _small(picture: Image.Image) -> str:
    """The picture as a PNG of few bytes, in base64."""
    size = STILL, round(STILL * picture.height / picture.width)
    out = io.BytesIO()
    small = picture.resize(size, Image.Resampling.BOX, reducing_gap=1.5)
    small.quantize(COLOURS, Image.Quantize.FASTOCTREE).save(out, "PNG")  # the fastest of the methods
    return base64.b64encode(out.getvalue()).decode()


_PARTS = {"votes": "votes", "others": "other grasps", "rest": "surroundings", "table": "table", "cameras": "cameras"}
