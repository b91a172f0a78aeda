"""Lines, arrows and arcs in space as strokes of a drawing in parallel projection, with words: Figs. 2, 3 and 6."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from spgf_torch.drawing.style import PAPER
from spgf_torch.reporting.figures.pieces import TEXLET, View, flat, texlets

PLANE = "#eef1f4"
AROUND = np.linspace(0, 2 * np.pi, 73)


def disc(axis: Axes, radius: float, view: View) -> None:
    """The centre's plane: a disc of `radius` m about the origin."""
    rim = radius * np.stack([np.cos(AROUND), np.sin(AROUND), np.zeros_like(AROUND)], axis=1)
    axis.add_patch(Polygon(flat(rim, view), facecolor=PLANE, edgecolor=PAPER, linewidth=0.6, zorder=0))
    axis.update_datalim(flat(rim, view))


def patches(axis: Axes, positions: np.ndarray, normals: np.ndarray, colour: str, view: View) -> None:
    """Texlets (N, 3) with their normals as short lines."""
    for position, normal in zip(positions, normals, strict=True):
        patch(axis, position, normal, colour, view)
        stroke(axis, np.stack([position, position + 1.4 * TEXLET * normal]), colour, view)


def patch(axis: Axes, position: np.ndarray, normal: np.ndarray, colour: str, view: View, size: float = TEXLET) -> None:
    """A texlet: a square in its plane."""
    corners = texlets(position[None], normal[None], np.zeros((1, 3)), size).corners[0]
    axis.add_patch(Polygon(flat(corners, view), facecolor=colour, edgecolor="white", linewidth=0.4, zorder=3))
    axis.update_datalim(flat(corners, view))


def stroke(axis: Axes, points: np.ndarray, colour: str, view: View, width: float = 1.1, style: str = "-") -> None:
    """A line through points (M, 3)."""
    axis.plot(*flat(points, view).T, style, color=colour, linewidth=width, zorder=4)


def arrow(axis: Axes, a: np.ndarray, b: np.ndarray, colour: str, view: View, words: str = "") -> None:
    """From a to b (3,), with words beyond its tip."""
    begin, end = _place(a, view), _place(b, view)
    look = {"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", end, begin, arrowprops=look, annotation_clip=False)
    axis.update_datalim([begin, end])
    if words:
        note(axis, b, words, view, np.subtract(end, begin), colour)


def arc(
    axis: Axes, a: np.ndarray, b: np.ndarray, size: float, colour: str, view: View, at: np.ndarray | None = None
) -> np.ndarray:
    """An arc of radius `size` m from direction a to direction b (3,), about `at`; returns its middle (3,)."""
    middle = np.zeros(3) if at is None else at
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    angle = np.arccos(np.clip(a @ b, -1, 1))
    across = b - (a @ b) * a
    across /= np.linalg.norm(across).clip(1e-12)
    turn = np.linspace(0, angle, 40)[:, None]
    points = middle + size * (np.cos(turn) * a + np.sin(turn) * across)
    stroke(axis, points, colour, view, 1.3)
    return points[20]


def note(
    axis: Axes, at: np.ndarray, words: str, view: View, away: np.ndarray, colour: str = "black", gap: float = 11
) -> None:
    """Words at a point (3,), `gap` points off it in the direction `away` (2,) of the picture."""
    x, y = gap * np.asarray(away) / max(float(np.linalg.norm(away)), 1e-12)
    look: Any = {"textcoords": "offset points", "ha": "center", "va": "center", "color": colour, "zorder": 6}
    axis.annotate(words, _place(at, view), (x, y), annotation_clip=False, **look)


def _place(point: np.ndarray, view: View) -> tuple[float, float]:
    x, y = flat(point, view)
    return float(x), float(y)
