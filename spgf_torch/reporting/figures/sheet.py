"""A figure of panels on one pair of axes in inches: hundreds of times faster than axes of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from spgf_torch.drawing.style import LETTERS, scale
from spgf_torch.reporting.figures.pieces import Pieces, View

TITLE, GUTTER = 0.26, 0.08  # inches; height of a panel's title, room between panels

Box = tuple[float, float, float]  # m; half width, bottom and top of a picture


@dataclass(frozen=True)
class Sheet:
    """Panels in rows.

    Attributes:
        panel: width and height of a panel, inches. foot: height below the panels. below: of a panel's height what lies
            below its picture, for a ruler.
    """

    figure: Figure
    axis: Axes
    columns: int
    rows: int
    panel: tuple[float, float]
    foot: float
    below: float = 0.0

    @classmethod
    def of(
        cls,
        count: int,
        columns: int,
        panel: tuple[float, float],
        foot: float = 0.0,
        right: float = 0.0,
        below: float = 0.0,
    ) -> Sheet:
        """Room for `count` panels in rows of `columns`, `right` inches beside them for a legend."""
        rows = ceil(count / columns)
        width, height = columns * panel[0] + right, rows * panel[1] + foot
        with mpl.rc_context(LETTERS):
            figure = Figure(figsize=(width, height))
            axis = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
            axis.set_axis_off()
        return cls(figure, axis, columns, rows, panel, foot, below)

    def corner(self, i: int) -> np.ndarray:
        """(2,) inches, the lower left corner of panel i."""
        return np.array(
            [i % self.columns * self.panel[0], self.foot + (self.rows - 1 - i // self.columns) * self.panel[1]]
        )

    def title(self, i: int, words: str) -> None:
        self.text(self.corner(i) + np.array([self.panel[0] / 2, self.panel[1] - 0.06]), words, "bold")

    def text(self, at: np.ndarray, words: str, weight: str = "normal", size: float = 9) -> None:
        """Words below the place `at` (2,) inches, centred."""
        x, y = at
        with mpl.rc_context(LETTERS):
            self.axis.text(x, y, words, ha="center", va="top", fontweight=weight, fontsize=size)

    def placed(self, i: int, points: np.ndarray, box: Box, part: tuple[int, int] = (0, 1)) -> np.ndarray:
        """Points (..., 2) of a picture with this `box` in panel i, below its title; in a part of it: (which, of)."""
        across, down, up = box
        width = self.panel[0] / part[1]
        room = self.panel[1] - TITLE - self.below
        size = min((width - GUTTER) / (2 * across), room / (up - down))
        middle = self.corner(i) + np.array([width * (0.5 + part[0]), self.below + room / 2])
        return middle + size * (points - (0.0, (up + down) / 2))

    def paint(self, i: int, pieces: Pieces, view: View, box: Box | None = None, part: tuple[int, int] = (0, 1)) -> Box:
        """Draw into panel i; without a `box` everything is in it. Returns the box."""
        corners, colours, widths = pieces.seen(view)
        if box is None:
            low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
            corners = corners - (low + high) / 2
            most = 1.02 * float((high - low).max()) / 2
            box = (most, -most, most)
        polygons = PolyCollection(
            list(self.placed(i, corners, box, part)), facecolors=colours, edgecolors=colours, linewidths=widths
        )
        self.axis.add_collection(polygons, autolim=False)
        return box

    def ruler(self, i: int, length: float, box: Box) -> None:
        """A bar of `length` m in the lower left of a panel."""
        ends = self.placed(i, np.array([[0.0, 0.0], [length, 0.0]]), box)
        ends += self.corner(i) + np.array([0.1, 0.16]) - ends[0]
        self.axis.plot(*ends.T, color="black", linewidth=1.5, solid_capstyle="butt")
        self.text(ends.mean(axis=0) - (0, 0.03), f"{1000 * length:.0f} mm", size=7)

    def bar(self, stops: Sequence[tuple[float, str]], most: float, label: str) -> None:
        """A colour scale in the foot."""
        height = self.rows * self.panel[1] + self.foot
        with mpl.rc_context(LETTERS):
            axis = self.figure.add_axes((0.28, (self.foot - 0.2) / height, 0.44, 0.13 / height))
            bar = self.figure.colorbar(
                ScalarMappable(Normalize(0, most), scale(stops)), cax=axis, orientation="horizontal"
            )
            bar.set_label(label)
            bar.outline.set_visible(False)  # type: ignore[operator]
