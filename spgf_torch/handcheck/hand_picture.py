"""Each preshape of a hand printed: open and closed from the front, open from the side, in parallel projection."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
import trimesh
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from spgf_torch.drawing.style import LETTERS, LIGHT, camera
from spgf_torch.handcheck.hand_scene import AXES, Part, joint_lines, parts, poses, tcp_lines
from spgf_torch.handcheck.posed import Posed

PANEL = 3.4  # inches
FRONT, SIDE = (-78.0, 14.0), (-12.0, 14.0)  # azimuth and elevation, deg, in the TCP frame: closing lies across
PANELS = (("open", 0, FRONT), ("closed", 1, FRONT), ("open, from the side", 0, SIDE))
FINEST = 0.01  # m of an edge that is sorted by depth as a whole: coarser, a long palm hides what stands before it
DARKEST = 0.5  # brightness of a face that looks away from the lamp


def hand_picture(preshapes: Sequence[Posed]) -> Figure:
    """A row a preshape. Pads are dots, joints' axes thin lines; red closing, blue approach, at the TCP."""
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(PANEL * len(PANELS), (PANEL + 0.25) * len(preshapes)))
        for row, posed in enumerate(preshapes):
            shapes, at = parts(posed), poses(posed, np.array([0.0, 1.0]))
            for column, (words, index, view) in enumerate(PANELS):
                axis = figure.add_subplot(len(preshapes), len(PANELS), row * len(PANELS) + column + 1)
                _panel(axis, posed, shapes, at[index], view)
                opening = f", {1000 * posed.preshape.opening:.0f} mm" if index == 0 and column == 0 else ""
                axis.set_title(f"{posed.name}: {words}{opening}")
        figure.subplots_adjust(0.01, 0.01, 0.99, 1 - 0.25 / (len(preshapes) * PANEL), 0.03, 0.1)
    return figure


def _panel(
    axis: Axes, posed: Posed, shapes: Sequence[Part], links: Mapping[str, np.ndarray], view: tuple[float, float]
) -> None:
    axis.set_axis_off()
    axis.set_aspect("equal")
    turn = camera(view) @ posed.preshape.T_base_tcp[:3, :3].T  # base to right, up, towards the eye
    corners, colours = _faces(shapes, links, turn)
    axis.add_collection(PolyCollection(list(corners), facecolors=colours, edgecolors=colours, linewidths=0.15))
    halo = [patheffects.withStroke(linewidth=2.6, foreground="white")]
    for line in joint_lines(posed, dict(links)).values():
        axis.plot(*(line @ turn.T)[:, :2].T, color="#333333", linewidth=0.7, zorder=3)
    for line, (colour, words) in zip(tcp_lines(posed), AXES, strict=True):
        seen = (line @ turn.T)[:, :2]
        axis.plot(*seen.T, color=colour, linewidth=1.6, zorder=4, path_effects=halo)
        if words and np.linalg.norm(seen[1] - seen[0]) > 0.01:
            axis.annotate(words, tuple(seen[1]), color=colour, fontsize=7, ha="center", zorder=5, path_effects=halo)
    pads = np.array(list(posed.pads_at(links).values())) @ turn.T
    axis.plot(pads[:, 0], pads[:, 1], "o", color="black", markersize=3.2, zorder=5, markeredgecolor="white")
    axis.autoscale_view()


def _faces(shapes: Sequence[Part], links: Mapping[str, np.ndarray], turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, 3, 2) that face the eye, far ones first, and their lit colours (T, 3)."""
    corners, colours = [], []
    for part in shapes:
        T = links[part.link]
        vertices, faces = trimesh.remesh.subdivide_to_size(part.vertices, part.faces, FINEST, max_iter=20)
        triangles = ((vertices @ T[:3, :3].T + T[:3, 3]) @ turn.T)[faces]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        shown = (normals[:, 2] > 0) & (lengths > 0)
        bright = normals[shown] @ np.array([LIGHT[0], LIGHT[2], -LIGHT[1]]) / lengths[shown]
        corners.append(triangles[shown])
        colours.append((DARKEST + (1 - DARKEST) * np.clip(0.3 + 0.7 * bright, 0, 1))[:, None] * to_rgb(part.colour))
    every, shades = np.concatenate(corners), np.concatenate(colours)
    order = np.argsort(every[..., 2].mean(axis=1), kind="stable")
    return every[order][..., :2], shades[order]
