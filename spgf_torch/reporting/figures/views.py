"""3-D views for the page, as plain values that plotly.js draws: one view a figure, one item of it shown at a time.

A browser gives a page about sixteen WebGL contexts, so a figure has one, and a list to choose its item from.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import trimesh
from matplotlib.colors import to_hex

from spgf_torch.drawing.page import Trace, View
from spgf_torch.drawing.prototype_rings import Ring
from spgf_torch.drawing.style import (
    ANGLE_SCALE,
    FAILED,
    HELD,
    MESH,
    PAPER,
    SUCCESS_SCALE,
    angle_colours,
    success_colours,
)
from spgf_torch.prototypes.naming import family_of
from spgf_torch.reporting.figures.learned import LAYERS, Grasps
from spgf_torch.reporting.figures.scenes import Held, Inferred, Look

DIGITS = 2  # of coordinates in mm


def prototype_view(looks: Sequence[Look]) -> View:
    """Fig. 10: both layers of a prototype."""
    traces = []
    for look in looks:
        bands = [_band(ring, layer) for ring, layer in zip(look.layers, LAYERS, strict=True)]
        gaps = [_lines(ring.gap_lines, "gap", PAPER, 3) for ring in look.layers if len(ring.gap_lines)]
        traces.append([*bands, *gaps, *_axes(0.024), _scale(ANGLE_SCALE, 180, "angle to<br>normal (deg)")])
    names = [look.name for look in looks]
    first = next((k for k, name in enumerate(names) if family_of(name) == "rim"), 0)
    return View("prototype", tuple(names), tuple(traces), 32, first)


def grasp_view(looks: Sequence[Look], learned: Sequence[Grasps]) -> View:
    """Figs. 12 and 13: a prototype with hands at its learned grasps."""
    traces = []
    for look, found in zip(looks, learned, strict=True):
        bar = _scale(SUCCESS_SCALE, 1, "learned<br>probability")
        traces.append([_band(look.layers[0], "prototype", grey=True), *_axes(0.03), *_hands(found), bar])
    first = max(range(len(learned)), key=lambda k: float(learned[k].probability.mean()) if learned[k].points else -1.0)
    return View("prototype", tuple(look.name for look in looks), tuple(traces), 100, first)


def object_view(shown: Sequence[Inferred], looks: Sequence[Look]) -> View:
    """Fig. 11: an object's texlets, a trace a prototype, so that a click on the legend hides one."""
    traces = []
    for inferred in shown:
        found = np.unique(inferred.ids).tolist()
        traces.append([_dots(inferred.positions[inferred.ids == k], looks[k].name, looks[k].colour) for k in found])
    return View("object", tuple(t.name.replace("_", " ") for t in shown), tuple(traces))


def worst_view(shown: Sequence[Held]) -> View:
    """An object's mesh with its highest-ranked grasps, failed and held."""
    traces = []
    for held in shown:
        kinds = (("failed", FAILED, ~held.success), ("held", HELD, held.success))
        hands = [_lines(held.sticks[which].reshape(-1, 2, 3), word, colour, 6) for word, colour, which in kinds]
        traces.append([solid_trace(held.mesh), *(hand for hand in hands if hand["x"])])
    return View("object", tuple(held.title for held in shown), tuple(traces))


def _band(ring: Ring, name: str, grey: bool = False) -> Trace:
    quads, n = ring.quads.reshape(-1, 3), len(ring.quads)
    first = 4 * np.arange(n)
    i, j, k = (
        np.concatenate([first, first]),
        np.concatenate([first + 1, first + 2]),
        np.concatenate([first + 2, first + 3]),
    )
    colours = np.full((n, 3), 0.7) if grey else angle_colours(ring.alpha2_deg)
    hexes = [to_hex(colour) for colour in colours]
    hover: Trace = {"hoverinfo": "skip"}
    if not grey:
        words = [f"{name} layer: {angle:.0f} deg" for angle in np.repeat(ring.alpha2_deg, 4)]
        hover = {"hoverinfo": "text", "text": words}
    flat = {"ambient": 0.8, "diffuse": 0.35, "specular": 0.05}
    faces = {"i": i.tolist(), "j": j.tolist(), "k": k.tolist(), "facecolor": hexes + hexes}
    return {"type": "mesh3d", **_xyz(quads), **faces, "flatshading": True, "lighting": flat, **hover}


def _hands(found: Grasps) -> list[Trace]:
    """A trace a grasp, so that its words are shown where the mouse is."""
    hexes = [to_hex(colour) for colour in success_colours(found.probability)]
    traces = []
    for sticks, colour, p, support in zip(found.sticks, hexes, found.probability, found.support, strict=True):
        words = f"probability {p:.2f}<br>support {support:.0f} particles"
        traces.append({**_lines(sticks, words, colour, 5), "hoverinfo": "text", "text": words, "showlegend": False})
    return traces


def _axes(length: float) -> list[Trace]:
    normal, aligned = np.array([[[0, 0, 0], [0, 0, length]]]), np.array([[[0, 0, 0], [length, 0, 0]]])
    words = (("normal of the centre", "#222222", normal), ("aligned direction (cell 0)", "#b02020", aligned))
    return [{**_lines(ends, name, colour, 5), "hoverinfo": "text", "text": name} for name, colour, ends in words]


def _lines(ends: np.ndarray, name: str, colour: str, width: float) -> Trace:
    """Segments (L, 2, 3) m as one trace, with breaks between them."""
    points = [value for pair in _mm(ends) for value in (*pair, [None, None, None])]
    x, y, z = ([point[axis] for point in points] for axis in range(3))
    line = {"color": colour, "width": width}
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": name,
        "x": x,
        "y": y,
        "z": z,
        "line": line,
        "hoverinfo": "name",
    }


def _dots(points: np.ndarray, name: str, colour: str) -> Trace:
    marker = {"size": 4.5, "color": colour}
    return {
        "type": "scatter3d",
        "mode": "markers",
        "name": name,
        **_xyz(points),
        "marker": marker,
        "hoverinfo": "name",
        "showlegend": True,
    }


def solid_trace(mesh: trimesh.Trimesh, colour: str = MESH, words: str = "") -> Trace:
    """A mesh in one colour, with words where the mouse is."""
    i, j, k = mesh.faces.T.tolist()
    light = {"ambient": 0.65, "diffuse": 0.6, "specular": 0.05}
    hover = {"hoverinfo": "text", "text": words} if words else {"hoverinfo": "skip"}
    look = {"color": colour, "flatshading": True, "lighting": light, **hover}
    return {"type": "mesh3d", **_xyz(mesh.vertices), "i": i, "j": j, "k": k, **look}


def _scale(stops: Iterable[tuple[float, str]], most: float, title: str) -> Trace:
    """A colour bar: it belongs to a dot that cannot be seen."""
    marker = {
        "size": 0.01,
        "color": [0],
        "cmin": 0,
        "cmax": most,
        "colorscale": [list(stop) for stop in stops],
        "colorbar": {"title": {"text": title}, "len": 0.6, "thickness": 12},
    }
    dot = {"x": [0], "y": [0], "z": [0], "hoverinfo": "skip", "showlegend": False}
    return {"type": "scatter3d", "mode": "markers", **dot, "marker": marker}


def _xyz(points: np.ndarray) -> Trace:
    return dict(zip("xyz", _mm(np.asarray(points).T), strict=True))


def _mm(metres: np.ndarray) -> list[Any]:
    rounded: list[Any] = np.round(1000 * np.asarray(metres, dtype=np.float64), DIGITS).tolist()
    return rounded
