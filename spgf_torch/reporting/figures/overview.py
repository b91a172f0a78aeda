"""Fig. 1: from an object's texlets to inferred prototypes, (a) to (j), each panel computed from one real feature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from spgf_torch.drawing.prototype_rings import INNER, ring_positions
from spgf_torch.drawing.style import (
    CENTRE,
    LETTERS,
    NEIGHBOUR,
    OPPOSITE,
    OTHER,
    PAPER,
    angle_colours,
    success_colours,
)
from spgf_torch.reporting.figures.example import Steps
from spgf_torch.reporting.figures.grid_figures import colour_bar, strip, titled
from spgf_torch.reporting.figures.learned import Grasps
from spgf_torch.reporting.figures.pieces import (
    TEXLET,
    Pieces,
    faces,
    facing,
    frame,
    joined,
    lines,
    moved,
    show,
    sticks,
    texlets,
)
from spgf_torch.reporting.figures.scenes import ABOVE, Inferred, Look, coloured, prototype

SIDE = (-60.0, 20.0)  # deg; where a single feature is looked at from
LIFT = 0.28  # of the radius; how far apart the layers are drawn, above and below the centre
SPACING, ROWS_APART, COLUMNS = (
    0.075,
    0.066,
    3,
)  # m between prototypes and rows of them in panel (h), prototypes in a row
PANEL, STRIP = (0.18, 0.385), 0.17  # of the figure; width and height of a panel, height of one with flat grids
WORDS = (
    *("an object's texlets", "a feature's neighbours", "pairwise relations", "two circular grids", "unfolded"),
    *("moving average", "aligned", "prototypes", "learned grasps", "inferred on the object"),
)


@dataclass(frozen=True)
class Overview:
    """What the strip shows: an object, one of its features, prototypes, and what was learned of one of them."""

    object: Inferred
    steps: Steps
    looks: Sequence[Look]
    grasped: int
    learned: Grasps


def overview(shown: Overview, radius: float) -> Figure:
    """Fig. 1."""
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(11.0, 5.2))
        axes = [figure.add_axes((0.01 + 0.2 * (i % 5), (0.55, 0.06)[i // 5], *PANEL)) for i in range(10)]
        titled(axes, WORDS)
        for axis, pieces, view in (
            (axes[0], _scene(shown), ABOVE),
            (axes[1], _neighbours(shown.steps), SIDE),
            (axes[2], _relations(shown.steps), SIDE),
            (axes[3], _grids(shown.steps, radius), SIDE),
            (axes[7], _prototypes(shown.looks), ABOVE),
            (axes[8], _grasps(shown), ABOVE),
            (axes[9], coloured(shown.object, np.array([to_rgb(look.colour) for look in shown.looks])), ABOVE),
        ):
            show(axis, pieces, view)
        steps = shown.steps
        aligned = np.roll(steps.gap, -steps.start, axis=1)
        for axis, values, gap in (
            (axes[4], steps.grid, None),
            (axes[5], steps.smooth, steps.gap),
            (axes[6], steps.aligned, aligned),
        ):
            _unfolded(axis, values, gap)
        colour_bar(figure, (0.11, 0.075, 0.2, 0.022), r"$\alpha_2$ (deg) in (d) to (h)")
    return figure


def _scene(shown: Overview) -> Pieces:
    """(a): the feature red, its neighbours blue."""
    inferred, steps = shown.object, shown.steps
    colours = np.tile(to_rgb(OTHER), (len(inferred.positions), 1))
    colours[steps.neighbour] = to_rgb(NEIGHBOUR)
    front = facing(inferred.normals, ABOVE)
    pieces = texlets(inferred.positions[front], inferred.normals[front], colours[front])
    own = texlets(steps.position[None], steps.frame[None, :, 2], np.array([to_rgb(CENTRE)]), 2 * TEXLET)
    return joined([pieces, moved_towards(own)])


def moved_towards(pieces: Pieces) -> Pieces:
    """A little nearer to the camera of `ABOVE`, so that what lies at the same place does not cover it."""
    T = np.eye(4)
    azimuth, elevation = np.radians(ABOVE)
    T[:3, 3] = TEXLET * np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    return moved(pieces, T)


def _neighbours(steps: Steps) -> Pieces:
    """(b): light blue those that face away."""
    colours = np.where(steps.top[:, None], to_rgb(NEIGHBOUR), to_rgb(OPPOSITE))
    around = texlets(steps.steps, steps.normals, colours)
    return joined([around, _own(), frame(np.eye(4), 0.02)])


def _relations(steps: Steps) -> Pieces:
    """(c): a line to each neighbour."""
    ends = np.stack([np.zeros_like(steps.steps), steps.steps], axis=1)
    colours = np.where(steps.top[:, None], to_rgb(NEIGHBOUR), to_rgb(OPPOSITE))
    return joined([lines(ends, colours, 0.5), texlets(steps.steps, steps.normals, colours, 0.6 * TEXLET), _own()])


def _own() -> Pieces:
    return texlets(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.array([to_rgb(CENTRE)]), 1.3 * TEXLET)


def _grids(steps: Steps, radius: float) -> Pieces:
    """(d): the layers as flat rings above and below the feature, empty cells white."""
    cells = steps.gap.shape[1]
    azimuth, half = np.arange(cells) * 2 * np.pi / cells, np.pi / cells
    flat = np.zeros(cells)
    corners = [
        share * ring_positions(flat, azimuth + side, radius)
        for share, side in ((INNER, -half), (1, -half), (1, half), (INNER, half))
    ]
    quads, parts = np.stack(corners, axis=1), []
    for values, lift in zip(steps.grid[..., 1], (LIFT, -LIFT), strict=True):
        known = np.isfinite(values)
        colours = np.where(known[:, None], angle_colours(np.nan_to_num(values)), 1.0)
        raised = quads + np.array([0, 0, lift * radius])
        outline = np.stack([raised, np.roll(raised, -1, axis=1)], axis=2).reshape(-1, 2, 3)
        parts += [faces(raised, colours), lines(outline, np.tile(to_rgb(PAPER), (len(outline), 1)), 0.4)]
    return joined([*parts, _own(), frame(np.eye(4), 0.012)])


def _unfolded(axis: Axes, values: np.ndarray, gap: np.ndarray | None) -> None:
    """(e), (f), (g): both layers flat."""
    strip(axis, values[..., 1], gap)
    box = axis.get_position()
    axis.set_position((box.x0 + 0.04, box.y1 - STRIP - 0.05, box.width - 0.045, STRIP))
    axis.set_xlabel(r"$\alpha_3$ (deg)", labelpad=1)


def _prototypes(looks: Sequence[Look]) -> Pieces:
    """(h): all of them side by side, in rows as the camera sees them."""
    azimuth = np.radians(ABOVE[0])
    right, down = np.array([-np.sin(azimuth), np.cos(azimuth), 0]), np.array([0.0, 0, -1.0])
    parts = []
    for k, look in enumerate(looks):
        T = np.eye(4)
        T[:3, 3] = SPACING * (k % COLUMNS) * right + ROWS_APART * (k // COLUMNS) * down
        parts.append(moved(prototype(look), T))
    return joined(parts)


def _grasps(shown: Overview) -> Pieces:
    """(i): one prototype with hands."""
    hands = sticks(shown.learned.sticks, success_colours(shown.learned.probability), 1.2)
    return joined([prototype(shown.looks[shown.grasped], grey=True), hands])
