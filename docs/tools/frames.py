"""The drawing of frames: what T_input_tcp, T_input_base and T_object_feature are, for the page `frames`.

    python docs/tools/frames.py [docs/images/frames.svg]

Left: the hand in front of a surface, with the frames input, base and tcp, the pads, the opening and the pregrasp pose.
Right: the feature frame of a texlet, with one neighbour and its three angles. Flat drawings by matplotlib, to no scale.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon, Rectangle

RED, GREEN, BLUE, INK, PALE, HAND = "#c0392b", "#2e8b57", "#2166ac", "#333333", "#d9dee2", "#8fb3bb"
SIZE = (11.0, 5.4)  # inches


def arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, width: float = 2.0) -> None:
    axis.annotate("", xy=end, xytext=start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": width})


def label(axis: Axes, at: tuple[float, float], words: str, colour: str = INK, **how: object) -> None:
    axis.text(*at, words, color=colour, **{"ha": "center", "va": "center", "fontsize": 10, **how})  # type: ignore[arg-type]


def measure(axis: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """A line with a head at either end: a length."""
    axis.annotate("", xy=end, xytext=start, arrowprops={"arrowstyle": "<->", "color": INK, "lw": 1.0})


def hand(axis: Axes) -> None:
    """A hand from the side, the approach to the right: base, pads, tcp, pregrasp."""
    axis.add_patch(Rectangle((-3.4, -1.5), 1.3, 3.0, facecolor=HAND, edgecolor=INK))
    for side in (-1.0, 1.0):
        axis.add_patch(Rectangle((-2.1, side * 1.15 - 0.25), 2.5, 0.5, facecolor=HAND, edgecolor=INK))
        axis.plot([-0.4, 0.4], [side * 0.9] * 2, color=RED, lw=3.5, solid_capstyle="butt")
    axis.add_patch(Polygon([(-0.1, -0.45), (2.6, -0.45), (2.6, 0.45), (-0.1, 0.45)], facecolor=PALE, edgecolor=INK))
    label(axis, (2.0, -0.2), "object")
    frame(axis, (0.0, 0.0), 1.3, "tcp", "z: approach", "x: closing", shift=-0.45)
    frame(axis, (-2.75, 0.0), 1.0, "base", "z", "x")
    axis.plot([-6.1, 0.0], [0, 0], color=INK, lw=0.8, ls=(0, (5, 4)), zorder=0)
    frame(axis, (-5.6, 0.0), 0.85, "pregrasp", "", "")
    measure(axis, (-5.6, -2.05), (0.0, -2.05))
    label(axis, (-3.9, -2.35), "retreat (0.1 m), back along z of tcp")
    measure(axis, (0.95, -0.9), (0.95, 0.9))
    label(axis, (1.15, 0.72), "opening", ha="left")
    label(axis, (-0.75, 1.75), "pad", RED)
    arrow(axis, (-0.6, 1.6), (-0.2, 0.98), RED, 1.0)
    frame(axis, (-6.4, -3.9), 1.0, "input", "x", "z", below=False)
    axis.annotate(
        "", xy=(-0.03, -0.12), xytext=(-6.3, -3.8),
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2, "connectionstyle": "arc3,rad=0.38"},
    )  # fmt: skip
    label(
        axis,
        (0.7, -3.6),
        r"$T_{\mathrm{input,tcp}}$:  $p_{\mathrm{input}} = T_{\mathrm{input,tcp}}\; p_{\mathrm{tcp}}$",
    )
    axis.set_xlim(-7.2, 3.2)
    axis.set_ylim(-4.6, 2.6)
    axis.set_title("Hand and grasp", fontsize=12, color=INK)


def frame(
    axis: Axes,
    at: tuple[float, float],
    size: float,
    name: str,
    right: str,
    up: str,
    below: bool = True,
    shift: float = 0.0,
) -> None:
    """A frame whose one axis points right and whose other points up in the picture."""
    x, y = at
    blue, red = (BLUE, RED) if below else (RED, BLUE)
    arrow(axis, at, (x + size, y), blue)
    arrow(axis, at, (x, y + size), red)
    axis.plot(*at, "o", color=INK, ms=4)
    label(axis, (x + shift, y - 0.32), name, fontsize=11, fontweight="bold")
    label(axis, (x + size * 0.62, y + 0.2), right, blue, fontsize=9)
    label(axis, (x + 0.12, y + size * 0.92), up, red, fontsize=9, ha="left")


def feature(axis: Axes) -> None:
    """The feature frame of a texlet in its tangent plane and from the side, with the angles to a neighbour."""
    turn = np.deg2rad(30)
    ring = np.linspace(0, 2 * np.pi, 200)
    axis.plot(1.9 * np.cos(ring), 1.9 * np.sin(ring) + 1.0, color=INK, lw=0.8)
    for cell in range(36):
        angle = np.deg2rad(10 * cell + 5)
        spoke = np.array([1.65, 1.9])
        axis.plot(spoke * np.cos(angle), spoke * np.sin(angle) + 1.0, color=INK, lw=0.5)
    arrow(axis, (0, 1), (1.45, 1), RED)
    arrow(axis, (0, 1), (0, 2.45), GREEN)
    axis.plot(0, 1, "o", color=BLUE, ms=7)
    label(axis, (0.75, 0.85), "x: direction of\nstrongest bend", RED, fontsize=9, va="top")
    label(axis, (-0.35, 2.25), "y", GREEN, fontsize=10)
    label(axis, (-0.75, 0.75), "z: normal,\ntowards you", BLUE, fontsize=9)
    end = (1.75 * np.cos(turn), 1.0 + 1.75 * np.sin(turn))
    axis.plot([0, end[0]], [1, end[1]], color=INK, lw=1)
    axis.plot(*end, "o", color=INK, ms=5)
    axis.add_patch(Arc((0, 1), 1.3, 1.3, theta1=0, theta2=30, color=INK))
    label(axis, (0.9, 1.27), r"$\alpha_3$", fontsize=12)
    label(axis, (2.0, 2.2), "neighbour, in ring cell 3\n(cell 0 is centred on x)", fontsize=9, ha="left")
    label(axis, (0, -1.25), r"seen along the normal; radius $r$ = 30 mm", fontsize=9)
    side(axis)
    axis.set_xlim(-2.8, 5.0)
    axis.set_ylim(-4.6, 3.3)
    axis.set_title("Feature", fontsize=12, color=INK)


def side(axis: Axes) -> None:
    """Centre and neighbour in a cut through both: alpha1 below the tangent plane, alpha2 between the normals."""
    x = np.linspace(-1.2, 3.6, 100)
    y = -2.9 - 0.11 * (x + 0.9) ** 2
    axis.plot(x, y, color=INK, lw=2)
    centre = (-0.9, -2.9)
    neighbour = (2.4, float(np.interp(2.4, x, y)))
    axis.plot([centre[0], centre[0] + 3.6], [centre[1]] * 2, color=INK, lw=0.8, ls=(0, (5, 4)))
    axis.plot(*zip(centre, neighbour, strict=True), color=INK, lw=1)
    arrow(axis, centre, (centre[0], centre[1] + 1.1), BLUE)
    slope = -0.22 * (neighbour[0] + 0.9)
    normal = np.array([-slope, 1.0]) / np.hypot(slope, 1.0)
    arrow(axis, neighbour, tuple(np.array(neighbour) + 1.1 * normal), BLUE)
    label(axis, (-1.45, -2.15), r"$X_1$, $n_1$", BLUE)
    label(axis, (3.5, -2.9), r"$X_2$, $n_2$", BLUE)
    angle = -np.rad2deg(np.arctan2(neighbour[1] - centre[1], neighbour[0] - centre[0]))
    axis.add_patch(Arc(centre, 3.4, 3.4, theta1=-angle, theta2=0, color=INK))
    label(axis, (1.05, -3.13), r"$\alpha_1$", fontsize=12)
    label(axis, (4.3, -3.7), r"$\alpha_2$: angle" + "\nbetween\n" + r"$n_1$ and $n_2$", fontsize=9)


def main(path: Path) -> None:
    with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": "frames", "mathtext.fontset": "dejavusans"}):
        figure = Figure(figsize=SIZE)
        left, right = figure.subplots(1, 2, width_ratios=(10.4, 7.8))
        for axis, draw in ((left, hand), (right, feature)):
            axis.set_aspect("equal")
            axis.set_axis_off()
            draw(axis)
        figure.tight_layout()
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None, facecolor="white")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/frames.svg"))
