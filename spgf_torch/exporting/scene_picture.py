"""The scene printed: parallel projection, far pieces first."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from spgf_torch.exporting.scene import CORNERS, Scene, pieces
from spgf_torch.reporting.style import LETTERS, SUCCESS_SCALE, scale

SIZE = (7.2, 6.4)  # inches
STEP = 0.003  # m; longest piece of a line that is sorted by depth
LINE = 2.8  # points
NUMBERED = 10  # grasps that carry their rank


def scene_picture(scene: Scene) -> Figure:
    """The cloud with the open hands as outlines, red (probability 0) to green (1), the best ones with their rank."""
    axes = scene.eye.axes
    corners, colours, widths = _sorted(scene, axes)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=SIZE)
        axis = figure.add_axes((0.01, 0.09, 0.98, 0.9))
        axis.set_axis_off()
        axis.set_aspect("equal")
        axis.add_collection(PolyCollection(list(corners), facecolors=colours, edgecolors=colours, linewidths=widths))
        halo = [patheffects.withStroke(linewidth=2.2, foreground="white")]
        for rank, segments in enumerate(scene.outlines[:NUMBERED], start=1):
            x, y = axes[:2] @ segments[0, 0]
            axis.text(x, y, str(rank), ha="center", va="center", fontsize=8, path_effects=halo, zorder=3)
        axis.autoscale_view()
        bar_axis = figure.add_axes((0.3, 0.065, 0.4, 0.018))
        shades = ScalarMappable(Normalize(0, 100), scale(SUCCESS_SCALE))
        bar = figure.colorbar(shades, cax=bar_axis, orientation="horizontal")
        bar.set_label("probability of success (%)")
        bar.outline.set_visible(False)  # type: ignore[operator]
    return figure


def _sorted(scene: Scene, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polygons (P, CORNERS, 2) from far to near, their colours (P, 3) and the widths of their edges (P,) in points."""
    corners, colours, widths = [scene.patches], [scene.colours], [np.full(len(scene.patches), 0.2)]
    for segments, colour in zip(scene.outlines, scene.grasp_colours, strict=True):
        for line in pieces(segments, STEP):
            corners.append(np.stack([line[:-1]] * (CORNERS - 1) + [line[1:]], axis=1))
            colours.append(np.tile(colour, (len(line) - 1, 1)))
            widths.append(np.full(len(line) - 1, LINE))
    seen = np.concatenate(corners) @ axes.T
    order = np.argsort(seen[..., 2].mean(axis=1), kind="stable")
    return seen[order][..., :2], np.concatenate(colours)[order], np.concatenate(widths)[order]
