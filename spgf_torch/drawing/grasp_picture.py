"""The scene printed, a panel a grasp type, three in a row: parallel projection, far pieces first."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from spgf_torch.drawing.grasp_scene import CORNERS, Scene, pieces
from spgf_torch.drawing.style import LETTERS, SUCCESS_SCALE, scale

PANEL = (5.2, 5.104)  # inches; with its title
FOOT, TITLE = 0.696, 0.406  # inches; height of the colour bar below the panels, and of a panel's title
COLUMNS = 3
POINTS = 72  # an inch
STEP = 0.003  # m; longest piece of a line that is sorted by depth
LINE = 2.8  # points
DRAWN = 6  # grasps of a type: more hide each other
RANK = np.array([15.0, 12.0])  # points; room of a rank with two digits
TURNS = np.linspace(0, 2 * np.pi, 12, endpoint=False) + np.pi / 2  # where a rank may go that finds its place taken


def scene_picture(scene: Scene) -> Figure:
    """The cloud with the best open hands of each type as outlines, red (probability 0) to green (1), with ranks."""
    grasp_types = sorted({grasp.type for grasp in scene.grasps}) or [""]
    with mpl.rc_context(LETTERS):
        columns, rows = min(COLUMNS, len(grasp_types)), -(-len(grasp_types) // COLUMNS)
        width, height = PANEL[0] * columns, PANEL[1] * rows + FOOT
        figure = Figure(figsize=(width, height))
        first: Axes | None = None  # all panels at one scale
        drawn: dict[Axes, list[int]] = {}
        for place, grasp_type in enumerate(grasp_types):
            of_type = [i for i, grasp in enumerate(scene.grasps) if grasp.type == grasp_type]
            bottom = FOOT + PANEL[1] * (rows - 1 - place // columns)
            room = (place % columns / columns, bottom / height, 1 / columns, (PANEL[1] - TITLE) / height)
            axis = figure.add_axes(room, sharex=first, sharey=first)
            first = axis
            _panel(axis, scene, of_type[:DRAWN])
            shown = f"the best {min(DRAWN, len(of_type))} of {len(of_type)}, by rank"
            axis.set_title(f"{grasp_type}: {shown}" if grasp_type else "no grasp")
            drawn[axis] = of_type[:DRAWN]
        for axis, indices in drawn.items():  # once the scale that they share is known
            _ranks(axis, scene, indices)
        bar_axis = figure.add_axes((0.35, 0.493 / height, 0.3, 0.104 / height))
        shades = ScalarMappable(Normalize(0, 100), scale(SUCCESS_SCALE))
        bar = figure.colorbar(shades, cax=bar_axis, orientation="horizontal")
        bar.set_label("probability of success (%)")
        bar.outline.set_visible(False)  # type: ignore[operator]
    return figure


def _panel(axis: Axes, scene: Scene, drawn: list[int]) -> None:
    """The cloud with the grasps `drawn`, indices into the scene's."""
    axis.set_axis_off()
    axis.set_aspect("equal")
    axes = scene.eye.axes
    corners, colours, widths = _sorted(scene, drawn, axes)
    axis.add_collection(PolyCollection(list(corners), facecolors=colours, edgecolors=colours, linewidths=widths))
    axis.autoscale_view()


def _ranks(axis: Axes, scene: Scene, drawn: list[int]) -> None:
    """The rank of each grasp where its outline begins; beside it, with a line to it, where a better one's stands."""
    begin = np.array([scene.eye.axes[:2] @ scene.outlines[index][0, 0] for index in drawn]).reshape(-1, 2)
    axis.apply_aspect()
    points = axis.transData.transform(begin) * POINTS / axis.figure.dpi
    halo = [patheffects.withStroke(linewidth=2.2, foreground="white")]
    for index, at, off in zip(drawn, begin, side_steps(points), strict=True):
        line: Any = {"arrowstyle": "-", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0} if off.any() else None
        look: Any = {"textcoords": "offset points", "ha": "center", "va": "center", "fontsize": 8, "zorder": 3}
        axis.annotate(str(index + 1), tuple(at.tolist()), off, arrowprops=line, path_effects=halo, **look)


def side_steps(points: np.ndarray) -> np.ndarray:
    """Steps (N, 2) from places (N, 2), points, after which no two ranks overlap; the earlier one is stepped less."""
    steps = [np.zeros(2)]
    steps += [length * np.array([np.cos(t), np.sin(t)]) for length in RANK[0] * np.arange(1, 5) for t in TURNS]
    taken, chosen = np.zeros((0, 2)), np.zeros(np.shape(points))
    for i, point in enumerate(points):
        free = (step for step in steps if (np.abs(taken - point - step) >= RANK).any(axis=1).all())
        chosen[i] = next(free, steps[0])
        taken = np.vstack([taken, point + chosen[i]])
    return chosen


def _sorted(scene: Scene, drawn: list[int], axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polygons (P, CORNERS, 2) from far to near, their colours (P, 3) and the widths of their edges (P,) in points."""
    corners, colours, widths = [scene.patches], [scene.colours], [np.full(len(scene.patches), 0.2)]
    for index in drawn:
        for line in pieces(scene.outlines[index], STEP):
            corners.append(np.stack([line[:-1]] * (CORNERS - 1) + [line[1:]], axis=1))
            colours.append(np.tile(scene.grasp_colours[index], (len(line) - 1, 1)))
            widths.append(np.full(len(line) - 1, LINE))
    seen = np.concatenate(corners) @ axes.T
    order = np.argsort(seen[..., 2].mean(axis=1), kind="stable")
    return seen[order][..., :2], np.concatenate(colours)[order], np.concatenate(widths)[order]
