"""The scene printed, a panel a grasp type: parallel projection, far pieces first."""

from __future__ import annotations

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

PANEL = (5.2, 5.8)  # inches
STEP = 0.003  # m; longest piece of a line that is sorted by depth
LINE = 2.8  # points
DRAWN = 6  # grasps of a type: more hide each other


def scene_picture(scene: Scene) -> Figure:
    """The cloud with the best open hands of each type as outlines, red (probability 0) to green (1), with ranks."""
    grasp_types = sorted({grasp.type for grasp in scene.grasps}) or [""]
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(PANEL[0] * len(grasp_types), PANEL[1]))
        first: Axes | None = None  # both panels at one scale
        for place, grasp_type in enumerate(grasp_types):
            of_type = [i for i, grasp in enumerate(scene.grasps) if grasp.type == grasp_type]
            axis = figure.add_axes(
                (place / len(grasp_types), 0.12, 1 / len(grasp_types), 0.81), sharex=first, sharey=first
            )
            first = axis
            _panel(axis, scene, of_type[:DRAWN])
            shown = f"the best {min(DRAWN, len(of_type))} of {len(of_type)}, by rank"
            axis.set_title(f"{grasp_type}: {shown}" if grasp_type else "no grasp")
        bar_axis = figure.add_axes((0.35, 0.085, 0.3, 0.018))
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
    halo = [patheffects.withStroke(linewidth=2.2, foreground="white")]
    for index in drawn:
        x, y = axes[:2] @ scene.outlines[index][0, 0]
        axis.text(x, y, str(index + 1), ha="center", va="center", fontsize=8, path_effects=halo, zorder=3)
    axis.autoscale_view()


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
