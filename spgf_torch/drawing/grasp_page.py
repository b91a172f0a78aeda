"""The scene as one HTML file that turns under the mouse and needs nothing else, and as a picture."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_hex

from spgf_torch.drawing.grasp_picture import scene_picture
from spgf_torch.drawing.grasp_scene import CORNERS, Beside, Eye, Scene, pieces, scene_of
from spgf_torch.drawing.grasp_table import direction, voters
from spgf_torch.drawing.outline import outline_words
from spgf_torch.drawing.page import Section, caption, drawn, page, png, table
from spgf_torch.drawing.page_hands import closing_content, hand_content
from spgf_torch.drawing.style import SUCCESS_SCALE
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.hands.records import Grasp, Gripper

Trace = dict[str, Any]
DIGITS = 1  # of coordinates in mm
READABLE = 0.01  # m; the mouse finds an outline at points this far apart
DISTANCE = 1.7  # of the eye, in plotly's unit: the whole scene is in the picture
FLAT = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0}  # the colours are lit already


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
        page_path: None: no page, for which plotly is needed.
        points, normals: (M, 3), m and unit, in the input's frame.
        grasps: best first. grippers: `records.grippers_of` the hand. names: a word for each prototype.
        beside: obstacles, table, lines of text, and how the hands close.

    Raises:
        InputError: no points, or points and normals of different shapes.
    """
    beside = beside or Beside()
    scene = scene_of(points, normals, grasps, grippers, beside)
    write_bytes(picture_path, png(drawn(scene_picture(scene))))
    if page_path is None:
        return
    lead = f"<p>{len(grasps)} grasps on a cloud of {len(points):,} points, best first.</p>"
    lead += "".join(f"<p>{html.escape(line)}</p>" for line in beside.lines)
    sections = [
        Section("scene", "Scene", _scene_html(scene, grippers, names, beside)),
        Section("ranked", "Ranked grasps", _ranked_html(grasps, names, beside.weighed)),
        *([Section("input", "Input", _list(beside.notes))] if beside.notes else []),
        Section("frames", "Frames", caption(_FRAMES)),
    ]
    write_text(page_path, page("Grasps", lead, sections))


def _scene_html(scene: Scene, grippers: Mapping[str, Gripper], names: Sequence[str] | None, beside: Beside) -> str:
    options = "".join(
        f"<option>{rank}: {html.escape(grasp.type)}, {100 * grasp.probability:.0f} %{_of_target(grasp)}</option>"
        for rank, grasp in enumerate(scene.grasps, start=1)
    )
    eyes = "".join(f'<button data-eye="{eye}">{eye}</button>' for eye in _EYES)
    content = json.dumps(_content(scene, grippers, names, beside), separators=(",", ":")).replace("</", "<\\/")
    folder = files("spgf_torch.drawing")
    styles, script = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("grasp_page.css", "grasp_page.js"))
    return (
        f"<style>\n{styles}</style>"
        + caption(
            f"{outline_words(grippers, 'their tips')} Red: it will fail, green: it will hold. A chosen grasp shows its "
            "whole hand, and the way that it comes." + _closing_words(beside) + _surroundings_words(beside)
        )
        + f'<div class="scene"><div class="tools"><label>grasp <select><option>all</option>{options}</select></label>'
        '<button data-step="-1" aria-label="previous">&#9664;</button>'
        f'<button data-step="1" aria-label="next">&#9654;</button>{eyes}'
        '<button data-zoom="0.8" aria-label="nearer">+</button>'
        '<button data-zoom="1.25" aria-label="farther">&minus;</button>'
        '<label class="close">close <input type="range" min="0" max="1" step="0.01" value="0"></label>'
        '<span class="hint">drag to turn; point at a hand, or click it</span></div>'
        f'<div class="plot"></div><script type="application/json">{content}</script></div>'
        f"<script>\n{script}</script>"
    )


def _closing_words(beside: Beside) -> str:
    """What the slider does; empty where it does nothing."""
    return " The slider closes it, as far as it could with nothing between its fingers." if beside.closing else ""


def _surroundings_words(beside: Beside) -> str:
    """What the colours beside the targets' mean; empty where there are none."""
    parts = ["blue: obstacles"] * bool(len(beside.obstacles)) + ["squares: the table"] * (beside.table is not None)
    return f" Grey: what is to be grasped; {'; '.join(parts)}." if parts else ""


def _content(
    scene: Scene, grippers: Mapping[str, Gripper], names: Sequence[str] | None, beside: Beside
) -> dict[str, Any]:
    """What scene.js draws, as plain values; coordinates in mm."""
    colours = [to_hex(colour) for colour in scene.grasp_colours]
    weights = beside.weighed or [""] * len(scene.grasps)
    words = [_words(i + 1, grasp, names, weights[i]) for i, grasp in enumerate(scene.grasps)]
    shapes = {name: closing_content(gripper, beside.closing.get(name)) for name, gripper in grippers.items()}
    return {
        "cloud": _cloud(scene),
        "outlines": [_outline(*known) for known in zip(scene.outlines, colours, words, strict=True)],
        "shapes": shapes if scene.grasps else {},
        "hands": [hand_content(*known) for known in zip(scene.grasps, colours, strict=True)],
        "approaches": [_approach(grasp, colour) for grasp, colour in zip(scene.grasps, colours, strict=True)],
        "numbers": _numbers(scene),
        "bar": _bar(),
        "eyes": _eyes(scene.eye),
        "up": scene.eye.up.tolist(),
    }


def _eyes(eye: Eye) -> dict[str, list[float]]:
    """Places to look from, in plotly's unit."""
    right, level = eye.axes[0], np.cross(eye.axes[0], eye.up)  # level: towards the eye, but not up
    height = float(eye.towards @ eye.up)
    places = {"left": height * eye.up - right, "right": height * eye.up + right, "back": height * eye.up - level}
    places |= {"front": eye.towards, "above": eye.up + 0.25 * eye.towards}
    return {name: (DISTANCE * place / np.linalg.norm(place)).tolist() for name, place in places.items()}


def _cloud(scene: Scene) -> Trace:
    """Every patch as a fan of triangles."""
    first = CORNERS * np.arange(len(scene.patches))[:, None]
    fan = np.arange(1, CORNERS - 1)
    i, j, k = (np.broadcast_to(first + by, (len(first), len(fan))).ravel().tolist() for by in (0, fan, fan + 1))
    colours = [to_hex(colour) for colour in scene.colours for _ in fan]
    faces = {"i": i, "j": j, "k": k, "facecolor": colours}
    return {"type": "mesh3d", **_xyz(scene.patches.reshape(-1, 3)), **faces, "lighting": FLAT, "hoverinfo": "skip"}


def _outline(segments: np.ndarray, colour: str, words: str) -> Trace:
    lines = [[*_mm(line).tolist(), [None] * 3] for line in pieces(segments, READABLE)]
    x, y, z = zip(*(point for line in lines for point in line), strict=True)
    look = {"line": {"color": colour, "width": 7}, "hoverinfo": "text", "text": words}
    return {"type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, **look}


def _numbers(scene: Scene) -> Trace:
    """The rank of every grasp, where its outline begins."""
    at = np.array([segments[0, 0] for segments in scene.outlines]).reshape(-1, 3)
    ranks = [str(rank) for rank in range(1, len(at) + 1)]
    look = {"text": ranks, "textfont": {"size": 12, "color": "#222222"}, "hoverinfo": "skip"}
    return {"type": "scatter3d", "mode": "text", **_xyz(at), **look}


def _approach(grasp: Grasp, colour: str) -> Trace:
    """The way of the TCP from where it waits to the grasp."""
    way = np.stack([grasp.T_input_pregrasp[:3, 3], grasp.T_input_tcp[:3, 3]])
    look = {"line": {"color": "#222222", "width": 4, "dash": "dash"}, "marker": {"size": [3, 5], "color": colour}}
    words = ["the TCP waits here before it approaches", "TCP: between the pads"]
    return {"type": "scatter3d", "mode": "lines+markers", **_xyz(way), **look, "hoverinfo": "text", "text": words}


def _bar() -> Trace:
    """The colour bar: it belongs to a dot that cannot be seen."""
    bar = {"title": {"text": "probability<br>of success (%)"}, "len": 0.6, "thickness": 12}
    marker = {"size": 0.01, "color": [0], "cmin": 0, "cmax": 100, "colorscale": SUCCESS_SCALE, "colorbar": bar}
    dot = {"x": [None], "y": [None], "z": [None], "hoverinfo": "skip"}
    return {"type": "scatter3d", "mode": "markers", **dot, "marker": marker}


def _of_target(grasp: Grasp) -> str:
    """Words for a target with a number other than the only one's."""
    return "" if grasp.target == 1 else f", target {grasp.target}"


def _words(rank: int, grasp: Grasp, names: Sequence[str] | None, weighed: str) -> str:
    """What is shown where the mouse is."""
    lines = (
        f"<b>{rank}</b>: {html.escape(grasp.type)}{_of_target(grasp)}",
        f"probability {100 * grasp.probability:.0f} %",
        judged_words(grasp),
        _lines(weighed),
        f"{grasp.support} votes",
        html.escape(voters(grasp, names)),
    )
    return "<br>".join(line for line in lines if line)


def judged_words(grasp: Grasp) -> str:
    """What a judge weighed; empty where the votes ranked."""
    if grasp.judged is None:
        return ""
    free, holds = grasp.judged
    return f"free with {100 * free:.0f} %, then holds with {100 * holds:.0f} %"


def _ranked_html(grasps: Sequence[Grasp], names: Sequence[str] | None, weighed: Sequence[str]) -> str:
    judged = any(grasp.judged for grasp in grasps)
    columns = ("judge, and what it weighed most", "shapes that voted", "votes") if judged else ("votes",)
    place = ("x (mm)", "y (mm)", "z (mm)", "approach", *(() if judged else ("prototypes",)))
    head = ("rank", "type", "probability (%)", *columns, *place)
    reasons = ["<br>".join(filter(None, pair)) for pair in zip_longest(map(judged_words, grasps), map(_lines, weighed))]
    shapes = [html.escape(voters(grasp, names)) for grasp in grasps]
    rows = [
        [
            str(rank),
            html.escape(grasp.type) + _of_target(grasp),
            f"{100 * grasp.probability:.1f}",
            *([reasons[rank - 1], shapes[rank - 1].replace(", ", "<br>")] if judged else []),
            str(grasp.support),
            *(f"{1000 * value:.1f}" for value in grasp.T_input_tcp[:3, 3]),
            direction(grasp),
            *([] if judged else [shapes[rank - 1]]),
        ]
        for rank, grasp in enumerate(grasps, start=1)
    ]
    words = caption(_WEIGHED) if judged and weighed else ""
    return words + table(head, rows)


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{html.escape(line)}</li>' for line in lines)}</ul>"


def _lines(weighed: str) -> str:
    """A number a line."""
    return html.escape(weighed).replace("; ", "<br>")


def _xyz(points: np.ndarray) -> Trace:
    return dict(zip("xyz", _mm(points).T.tolist(), strict=True))


def _mm(metres: np.ndarray) -> np.ndarray:
    return np.round(1000 * metres, DIGITS)


_WEIGHED = (
    "The judge ranked. What it weighed most: the numbers that moved its probability most, up (+) or down (-), against "
    "what is usual among the hypotheses about the same thing. The local shapes (prototypes) that voted for a grasp are "
    "shown beside it; they take no part in the rank."
)
_EYES = ("front", "left", "right", "back", "above")
_FRAMES = (
    "All positions and directions are in the input's frame. The TCP lies between the pads, its z axis is the "
    "approach, its x axis the direction of closing. <code>grasps.json</code> has the poses of the TCP and of the "
    "hand's base link, the joints of the open and of the closed hand, and the pose before the approach."
)
