"""Figs. 3 to 5, drawn from one real feature: its grid, the moving average, the alignment."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle, Wedge

from spgf_torch.drawing.style import ANGLE_SCALE, CENTRE, LETTERS, NEIGHBOUR, PAPER, TOWARDS, angle_colours, scale
from spgf_torch.reporting.figures.example import Steps
from spgf_torch.reporting.figures.sketches import arrow, disc, patch, patches

INNER, OUTER = 0.55, 1.0  # of the radius; a ring as seen along the normal
FIELD = (1.75, 1.3)  # of the radius; half width and height of what is seen around it
EMPTY, HATCH = "#ffffff", "////"
CHOSEN = 6  # neighbours in Fig. 3, as in the paper's
ALPHA2 = r"$\alpha_2$ (deg)"
ALPHA3 = r"$\alpha_3$ (deg)"


def ring_circle(axis: Axes, values: np.ndarray | None, cells: int, gap: np.ndarray | None = None) -> None:
    """A layer seen along the normal: cells coloured by alpha2 (cells,) deg, NaN empty; gaps hatched."""
    width = 360 / cells
    for k in range(cells):
        known = values is not None and np.isfinite(values[k]) and not (gap is not None and gap[k])
        colour = angle_colours(values[k : k + 1])[0] if known and values is not None else EMPTY
        hatch = HATCH if gap is not None and gap[k] else None
        wedge = Wedge(
            (0, 0), OUTER, (k - 0.5) * width, (k + 0.5) * width, width=OUTER - INNER, facecolor=colour, hatch=hatch
        )
        wedge.set(edgecolor=PAPER, linewidth=0.5)
        axis.add_patch(wedge)
    axis.set(xlim=(-FIELD[0], FIELD[0]), ylim=(-FIELD[1], FIELD[1]), aspect="equal")
    axis.set_axis_off()


def start_mark(axis: Axes, cell: int, cells: int, words: str = "start") -> None:
    """Which cell of a circle is the start."""
    turn = 2 * np.pi * cell / cells
    x, y = np.cos(turn), np.sin(turn)
    look = {"arrowstyle": "-|>", "color": "black", "lw": 1}
    axis.annotate("", (1.02 * x, 1.02 * y), (1.2 * x, 1.2 * y), arrowprops=look)
    side = "left" if x > 0.3 else "right" if x < -0.3 else "center"
    axis.text(1.23 * x, 1.23 * y, words, ha=side, va="center", fontsize=8.5)


def strip(axis: Axes, layers: np.ndarray, gap: np.ndarray | None = None, names: bool = True) -> None:
    """Both layers unfolded: alpha2 (2, cells) deg as colours, top above bottom; NaN empty, gaps hatched."""
    cells = layers.shape[1]
    for row, (values, line) in enumerate(zip(layers, (1, 0), strict=True)):
        for k in range(cells):
            closed = gap is not None and gap[row, k]
            known = np.isfinite(values[k]) and not closed
            colour = angle_colours(values[k : k + 1])[0] if known else EMPTY
            axis.add_patch(
                Rectangle(
                    (k - 0.5, line), 1, 0.86, facecolor=colour, edgecolor=PAPER, lw=0.3, hatch=HATCH if closed else None
                )
            )
    axis.set(xlim=(-0.7, cells - 0.3), ylim=(-0.05, 1.95))
    axis.set_yticks([1.43, 0.43], ["top", "bottom"] if names else ["", ""])
    degrees_axis(axis, cells)
    axis.grid(False)
    axis.tick_params(left=False)
    axis.spines[["left", "bottom"]].set_visible(False)


def degrees_axis(axis: Axes, cells: int) -> None:
    """Ticks of alpha3 at the cells."""
    turns = np.arange(0, 360, 90)
    axis.set_xticks(turns * cells / 360, [str(turn) for turn in turns])


def colour_bar(figure: Figure, place: tuple[float, float, float, float], label: str = ALPHA2) -> None:
    """The scale of alpha2, horizontal, at `place` (left, bottom, width, height) of the figure."""
    axis = figure.add_axes(place)
    bar = figure.colorbar(ScalarMappable(Normalize(0, 180), scale(ANGLE_SCALE)), cax=axis, orientation="horizontal")
    bar.set_label(label, labelpad=1)
    bar.set_ticks([0, 45, 90, 135, 180])
    bar.outline.set_visible(False)  # type: ignore[operator]


def grid_figure(steps: Steps, radius: float) -> Figure:
    """Fig. 3: an empty layer, six neighbours, their projections, and the cells they are put into."""
    cells = steps.gap.shape[1]
    six = spread_out(steps, CHOSEN)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(10.0, 2.9))
        axes = [figure.add_axes((0.005 + 0.25 * i, 0.2, 0.24, 0.68)) for i in range(4)]
        ring_circle(axes[0], None, cells)
        start_mark(axes[0], 0, cells, "0°, start")
        for turn in (90, 180, 270):
            x, y = 1.27 * np.cos(np.radians(turn)), 1.16 * np.sin(np.radians(turn))
            axes[0].text(x, y, f"{turn}°", ha="center", va="center", fontsize=8.5)
        axes[0].text(0, 0, rf"$N_g = {cells}$", ha="center", va="center")
        _in_space(axes[1], steps, six, radius)
        _projected(axes[2], steps, six, radius)
        values = _cells_of(steps, six)
        ring_circle(axes[3], values, cells)
        start_mark(axes[3], 0, cells)
        titles = ("an empty layer", "six neighbours", "projected on the plane", "in cells, by $\\alpha_3$")
        titled(axes, titles)
        colour_bar(figure, (0.79, 0.17, 0.17, 0.035))
    return figure


def spread_out(steps: Steps, count: int) -> np.ndarray:
    """Neighbours of the top layer, one of each of `count` equal parts of the turn: the farthest one in it."""
    far = np.linalg.norm(steps.steps, axis=1)
    part = (steps.angles[2] % 360 // (360 / count)).astype(int)
    chosen = [
        candidates[far[candidates].argmax()]
        for k in range(count)
        if len(candidates := np.flatnonzero((part == k) & steps.top & np.isfinite(steps.angles[2])))
    ]
    return np.array(chosen, dtype=int)


def average_figure(steps: Steps) -> Figure:
    """Fig. 4: what a cell gets from the others, and a layer before and after."""
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(10.0, 3.6))
        left = figure.add_axes((0.055, 0.34, 0.23, 0.55))
        _window(left, steps)
        right = figure.add_axes((0.36, 0.41, 0.62, 0.47))
        _contributions(right, steps)
        for bottom, values, gap, words in (
            (0.27, steps.grid[0, :, 1], None, "before"),
            (0.17, steps.smooth[0, :, 1], steps.gap[0], "after"),
        ):
            axis = figure.add_axes((0.36, bottom, 0.62, 0.08), sharex=right)
            _one_strip(axis, values, gap, words)
        degrees_axis(axis, len(values))
        axis.tick_params(labelbottom=True)
        axis.set_xlabel(ALPHA3 + "; the top layer before and after coloured by $\\alpha_2$, hatched: a gap", labelpad=1)
        colour_bar(figure, (0.08, 0.13, 0.18, 0.03))
    return figure


def alignment_figure(steps: Steps) -> Figure:
    """Fig. 5: alpha2 around the top layer and both layers, before and after the start is moved to its maximum."""
    cells = steps.gap.shape[1]
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(10.0, 4.6))
        for column, (rings, gap, start, title) in enumerate(
            (
                (steps.smooth, steps.gap, steps.start, "(a) from $R_x$, towards the mean of the neighbours"),
                (steps.aligned, np.roll(steps.gap, -steps.start, axis=1), 0, "(b) aligned"),
            )
        ):
            left = 0.06 + 0.49 * column
            curve = figure.add_axes((left, 0.6, 0.42, 0.32))
            curve.plot(rings[0, :, 1], color="black", linewidth=1.4, drawstyle="steps-mid")
            curve.axvline(start, color=TOWARDS, linewidth=1.2)
            curve.text(start + 0.4, 8, r"$\alpha_{2,\max}$", color=TOWARDS)
            curve.set(xlim=(-0.7, cells - 0.3), ylim=(0, 100), title=title, ylabel="top " + ALPHA2)
            curve.set_yticks([0, 30, 60, 90])
            degrees_axis(curve, cells)
            curve.tick_params(labelbottom=False)
            axis = figure.add_axes((left, 0.4, 0.42, 0.17))
            strip(axis, rings[..., 1], gap)
            axis.set_xlabel(ALPHA3, labelpad=1)
            circle = figure.add_axes((left + 0.05, 0.0, 0.32, 0.3))
            ring_circle(circle, rings[0, :, 1], cells, gap[0])
            start_mark(circle, start, cells, "start" if column else r"$\alpha_{2,\max}$")
        colour_bar(figure, (0.43, 0.14, 0.14, 0.028))
    return figure


def _in_space(axis: Axes, steps: Steps, six: np.ndarray, radius: float) -> None:
    view = (-65.0, 33.0)
    disc(axis, radius, view)
    patches(axis, steps.steps[six], steps.normals[six], NEIGHBOUR, view)
    patch(axis, np.zeros(3), np.array([0.0, 0, 1]), CENTRE, view)
    arrow(axis, np.zeros(3), np.array([1.15 * radius, 0, 0]), TOWARDS, view, "$R_x$")
    arrow(axis, np.zeros(3), np.array([0, 0, 0.6 * radius]), "black", view, "$n_1$")
    _field(axis, radius)


def _projected(axis: Axes, steps: Steps, six: np.ndarray, radius: float) -> None:
    above = (-90.0, 90.0)
    disc(axis, radius, above)
    arrow(axis, np.zeros(3), np.array([1.15 * radius, 0, 0]), TOWARDS, above, "$R_x$")
    for step in steps.steps[six]:
        axis.plot([0, step[0]], [0, step[1]], color=NEIGHBOUR, linewidth=0.9)
    axis.plot(*steps.steps[six, :2].T, "s", color=NEIGHBOUR, markersize=6)
    axis.plot(0, 0, "s", color=CENTRE, markersize=7)
    _field(axis, radius)


def _field(axis: Axes, radius: float) -> None:
    axis.set(xlim=(-FIELD[0] * radius, FIELD[0] * radius), ylim=(-FIELD[1] * radius, FIELD[1] * radius), aspect="equal")
    axis.set_axis_off()


def _cells_of(steps: Steps, chosen: np.ndarray) -> np.ndarray:
    """(cells,) alpha2 deg of a grid that holds the chosen neighbours alone, NaN elsewhere."""
    cells = steps.gap.shape[1]
    place = np.round(steps.angles[2, chosen] * cells / 360).astype(int) % cells
    values = np.full(cells, np.nan)
    for k in np.unique(place):
        values[k] = steps.angles[1, chosen][place == k].mean()
    return values


def _window(axis: Axes, steps: Steps) -> None:
    for k, weight in steps.window.items():
        axis.bar(k, weight, width=0.86, color=TOWARDS if abs(k) == 2 else "#c9ced3")
    most = max(steps.window)
    axis.set(title="(a) weights about cell M", xlabel="cell", ylabel="weight", ylim=(0, 1.08))
    marks = sorted({-most, -2, 0, 2, most})
    axis.set_xticks(marks, [f"M{k:+d}".replace("M+0", "M") for k in marks])
    axis.grid(False, axis="x")


def _contributions(axis: Axes, steps: Steps) -> None:
    """Of each cell with data the weights that it has in the cells around, in its own colour."""
    cells, values = steps.gap.shape[1], steps.grid[0, :, 1]
    offsets, weights = np.array(sorted(steps.window.items())).T
    for k in np.flatnonzero(np.isfinite(values)):
        colour = angle_colours(values[k : k + 1])[0]
        for turn in (-cells, 0, cells):  # the ring goes on at both ends
            axis.plot(k + offsets + turn, weights, color=colour, linewidth=1.0, alpha=0.9)
        axis.bar(k, 1.0, width=0.3, color=colour)
    axis.set(xlim=(-0.7, cells - 0.3), ylim=(0, 1.08), ylabel="weight")
    axis.set_title("(b) what the cells with data (bars) give to the others: the top layer")
    axis.tick_params(labelbottom=False)


def _one_strip(axis: Axes, values: np.ndarray, gap: np.ndarray | None, words: str) -> None:
    strip(axis, np.stack([values, np.full(len(values), np.nan)]), None if gap is None else np.stack([gap, gap]))
    axis.set_ylim(0.98, 1.9)
    axis.set_yticks([1.43], [words])
    axis.tick_params(labelbottom=False)


def titled(axes: Sequence[Axes], words: Sequence[str]) -> None:
    """(a), (b) ... and words above each of the axes, all of a row at one height whatever their pictures' shapes."""
    for axis, letter, title in zip(axes, "abcdefghij", words, strict=False):
        box, figure = axis.get_position(original=True), axis.get_figure(root=True)
        assert figure is not None
        figure.text((box.x0 + box.x1) / 2, box.y1 + 0.01, f"({letter}) {title}", ha="center", va="bottom", fontsize=9.5)
