"""Printed pictures of things in space (Figs. 10 to 13, worst objects): parallel projection, far pieces first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import matplotlib as mpl
import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from spgf_torch.drawing.style import (
    ANGLE_SCALE,
    FAILED,
    HELD,
    LETTERS,
    LIGHT,
    MESH,
    SUCCESS_SCALE,
    angle_colours,
    camera,
    scale,
    success_colours,
)
from spgf_torch.prototypes.naming import FAMILIES, family_of
from spgf_torch.reporting.figures.learned import Grasps, Ring, full_fork

PATCH = 0.012  # m; largest edge of a triangle that is sorted by depth
TEXLET = 0.0052  # m; drawn width of a texlet: they lie 5 mm apart
TITLE, GUTTER = 0.26, 0.08  # inches; height of a panel's title, room between panels
STEP = 0.006  # m; longest piece of a line that is sorted by depth
ABOVE, BELOW = (-60.0, 38.0), (-60.0, -38.0)  # deg; azimuth and elevation of the camera
# m; half width, bottom and top of the picture of a prototype, without and with hands.
RING_BOX, GRASP_BOX = (0.033, -0.038, 0.029), (0.105, -0.1, 0.1)


@dataclass(frozen=True)
class Pieces:
    """Polygons in space, ready to be sorted by depth.

    Attributes:
        corners: (P, 4, 3) m; triangles repeat their last corner, lines are (a, a, b, b).
        colours: (P, 3). widths: (P,) points, of lines; 0 for faces.
    """

    corners: np.ndarray
    colours: np.ndarray
    widths: np.ndarray


@dataclass(frozen=True)
class Texlets:
    """The texlets of an object: positions (N, 3) m, normals (N, 3), prototype ids (N,)."""

    name: str
    positions: np.ndarray
    normals: np.ndarray
    ids: np.ndarray


@dataclass(frozen=True)
class Held:
    """An object with some grasps on it.

    Attributes:
        title: what to write above.
        sticks: (G, 4, 2, 3) m; success: (G,) bool.
    """

    title: str
    mesh: trimesh.Trimesh
    sticks: np.ndarray
    success: np.ndarray

    @staticmethod
    def of(name: str, mesh: trimesh.Trimesh, T: np.ndarray, openings: Sequence[float], success: np.ndarray) -> Held:
        """Grasps (G, 4, 4) in the mesh's frame, of hands that open so wide (G, m), with their outcomes (G,) bool."""
        forks = np.stack([full_fork(opening) for opening in openings])
        sticks = np.einsum("gij,gskj->gski", T[:, :3, :3], forks) + T[:, None, None, :3, 3]
        return Held(f"{name.replace('_', ' ')}: {success.sum()} of {len(success)} held", mesh, sticks, success)


@dataclass(frozen=True)
class Sheet:
    """A figure of panels on one pair of axes in inches: hundreds of times faster than axes of their own.

    Attributes:
        panel: width and height of a panel, inches. foot: height below the panels.
    """

    figure: Figure
    axis: Axes
    columns: int
    rows: int
    panel: tuple[float, float]
    foot: float

    @classmethod
    def of(cls, count: int, columns: int, panel: tuple[float, float], foot: float = 0.0, right: float = 0.0) -> Sheet:
        """Room for `count` panels in rows of `columns`, `right` inches beside them for a legend."""
        rows = ceil(count / columns)
        width, height = columns * panel[0] + right, rows * panel[1] + foot
        with mpl.rc_context(LETTERS):
            figure = Figure(figsize=(width, height))
            axis = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
            axis.set_axis_off()
        return cls(figure, axis, columns, rows, panel, foot)

    def corner(self, i: int) -> np.ndarray:
        """(2,) inches, the lower left corner of panel i."""
        return np.array(
            [i % self.columns * self.panel[0], self.foot + (self.rows - 1 - i // self.columns) * self.panel[1]]
        )

    def title(self, i: int, words: str) -> None:
        x, y = self.corner(i) + np.array([self.panel[0] / 2, self.panel[1] - 0.06])
        with mpl.rc_context(LETTERS):
            self.axis.text(x, y, words, ha="center", va="top", fontweight="bold")

    def placed(self, i: int, flat: np.ndarray, box: tuple[float, float, float], half: int | None = None) -> np.ndarray:
        """Points (..., 2) of a picture with this `box` in panel i (below its title), or in its left or right half."""
        across, down, up = box
        width = self.panel[0] * (1.0 if half is None else 0.5)
        room = self.panel[1] - TITLE
        size = min((width - GUTTER) / (2 * across), room / (up - down))
        middle = self.corner(i) + np.array([width * (0.5 + (half or 0)), room / 2])
        return middle + size * (flat - (0.0, (up + down) / 2))

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


def prototypes(shapes: Sequence[tuple[Ring, Ring]], names: Sequence[str]) -> Figure:
    """Fig. 10: each prototype from above and from below, both layers coloured by the angle to the centre's normal."""
    columns = min(5, len(shapes))
    sheet = Sheet.of(len(shapes), columns, panel=(2.0, 1.32), foot=0.62)
    for k, (pair, name) in enumerate(zip(shapes, names, strict=True)):
        pieces = _joined([*map(_ring_pieces, pair), _arrow(0.024)])
        sheet.title(k, name)
        for side, view in enumerate((ABOVE, BELOW)):
            _paint(sheet, k, pieces, view, RING_BOX, half=side)
    sheet.bar(ANGLE_SCALE, 180, "angle to the centre's normal (deg); left: from above, right: from below")
    return sheet.figure


def objects(shown: Sequence[Texlets], names: Sequence[str], colours: Sequence[str]) -> Figure:
    """Fig. 11: texlets that face the camera, coloured by prototype; the legend names those that occur."""
    sheet = Sheet.of(len(shown), 3, panel=(2.5, 2.5), right=1.45)
    palette = np.array([to_rgb(colour) for colour in colours])
    for i, texlets in enumerate(shown):
        sheet.title(i, texlets.name.replace("_", " "))
        _texels(sheet, i, texlets, palette)
    occurring = {int(k) for texlets in shown for k in texlets.ids}
    order = sorted(occurring, key=lambda k: (FAMILIES.index(family_of(names[k])), k))
    dots = [Line2D([], [], marker="o", linestyle="", color=colours[k], label=names[k]) for k in order]
    with mpl.rc_context(LETTERS):
        sheet.figure.legend(handles=dots, loc="center right", fontsize=8, handletextpad=0.2)
    return sheet.figure


def grasps(
    shapes: Sequence[tuple[Ring, Ring]], learned: Sequence[Grasps], names: Sequence[str], opening: float
) -> Figure:
    """Figs. 12 and 13: each prototype in grey with hands at its learned grasps, red (probability 0) to green (1)."""
    sheet = Sheet.of(len(shapes), min(5, len(shapes)), panel=(1.8, 1.85), foot=0.62)
    for k, (pair, found, name) in enumerate(zip(shapes, learned, names, strict=True)):
        sticks = _sticks(found.sticks, success_colours(found.probability), 1.0)
        sheet.title(k, name)
        _paint(sheet, k, _joined([_ring_pieces(pair[0], grey=True), _arrow(0.03), sticks]), ABOVE, GRASP_BOX)
    sheet.bar(SUCCESS_SCALE, 1, f"learned probability of success (hand open {1000 * opening:.0f} mm)")
    return sheet.figure


def worst(shown: Sequence[Held]) -> Figure:
    """Objects with their highest-ranked grasps: failed ones red, held ones green."""
    sheet = Sheet.of(len(shown), min(3, len(shown)), panel=(2.7, 2.8), foot=0.35)
    for i, held in enumerate(shown):
        colours = np.where(held.success[:, None], to_rgb(HELD), to_rgb(FAILED))
        sheet.title(i, held.title)
        _paint(sheet, i, _joined([_mesh(held.mesh), _sticks(held.sticks, colours, 1.3)]), ABOVE)
    words = ((FAILED, "failed"), (HELD, "held"))
    with mpl.rc_context(LETTERS):
        lines = [Line2D([], [], color=colour, linewidth=2, label=word) for colour, word in words]
        sheet.figure.legend(handles=lines, loc="lower center", ncols=2)
    return sheet.figure


def _paint(
    sheet: Sheet,
    panel: int,
    pieces: Pieces,
    view: tuple[float, float],
    box: tuple[float, float, float] | None = None,
    half: int | None = None,
) -> None:
    """Draw into a panel; `box` is the half width, bottom and top of the picture (m); without, everything is in it."""
    seen = pieces.corners @ camera(view).T
    order = np.argsort(seen[..., 2].mean(axis=1), kind="stable")
    flat = seen[order][..., :2]
    if box is None:
        low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
        flat -= (low + high) / 2
        most = 1.02 * float((high - low).max()) / 2
        box = (most, -most, most)
    colours = pieces.colours[order]
    widths = np.where(pieces.widths > 0, pieces.widths, 0.25)[order]
    polygons = PolyCollection(
        list(sheet.placed(panel, flat, box, half)), facecolors=colours, edgecolors=colours, linewidths=widths
    )
    sheet.axis.add_collection(polygons, autolim=False)


def _ring_pieces(ring: Ring, grey: bool = False) -> Pieces:
    faces = np.full((len(ring.quads), 3), 0.72) if grey else angle_colours(ring.alpha2_deg)
    shade = np.ones(len(faces)) if grey else _shading(ring.quads)
    quads = Pieces(ring.quads, faces * shade[:, None], np.zeros(len(faces)))
    gap = Pieces(
        np.repeat(ring.gap_lines, 2, axis=1), np.full((len(ring.gap_lines), 3), 0.6), np.full(len(ring.gap_lines), 0.9)
    )
    return _joined([quads, gap])


def _shading(quads: np.ndarray) -> np.ndarray:
    """(C,) brightness in [0.82, 1] by how much a quadrilateral faces the lamp."""
    normal = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-12)
    return 0.82 + 0.18 * np.abs(normal @ LIGHT)


def _arrow(length: float) -> Pieces:
    """The centre's normal (up) and the aligned direction."""
    ends = np.array([[[0, 0, 0], [0, 0, length]], [[0, 0, 0], [0.8 * length, 0, 0]]])
    return _lines(ends, np.array([[0.1, 0.1, 0.1], [0.75, 0.1, 0.1]]), 1.1)


def _sticks(sticks: np.ndarray, colours: np.ndarray, width: float) -> Pieces:
    return _lines(sticks.reshape(-1, 2, 3), np.repeat(colours, sticks.shape[1], axis=0), width)


def _lines(ends: np.ndarray, colours: np.ndarray, width: float) -> Pieces:
    """Lines (L, 2, 3) cut into pieces short enough to be sorted by depth."""
    if not len(ends):
        return Pieces(np.zeros((0, 4, 3)), np.zeros((0, 3)), np.zeros(0))
    count = np.maximum(1, np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / STEP)).astype(int)
    line = np.repeat(np.arange(len(ends)), count)
    i = np.concatenate([np.arange(n) for n in count])
    a, step = ends[line, 0], ((ends[:, 1] - ends[:, 0]) / count[:, None])[line]
    first, last = a + i[:, None] * step, a + (i + 1)[:, None] * step
    return Pieces(np.stack([first, first, last, last], axis=1), colours[line], np.full(len(line), width))


def _mesh(mesh: trimesh.Trimesh) -> Pieces:
    """The triangles of a mesh that face the camera, shaded."""
    fine: trimesh.Trimesh = mesh.subdivide_to_size(PATCH)  # type: ignore[assignment]
    facing = fine.face_normals @ camera(ABOVE)[2] > 0
    corners = fine.triangles[facing]
    shade = 0.72 + 0.28 * np.clip(fine.face_normals[facing] @ LIGHT, 0, 1)
    colours = shade[:, None] * to_rgb(MESH)
    return Pieces(np.concatenate([corners, corners[:, -1:]], axis=1), colours, np.zeros(len(corners)))


def _texels(sheet: Sheet, panel: int, texlets: Texlets, palette: np.ndarray) -> None:
    view = camera(ABOVE)
    middle = (texlets.positions.min(axis=0) + texlets.positions.max(axis=0)) / 2
    seen = (texlets.positions - middle) @ view.T
    front = texlets.normals @ view[2] > 0
    order = np.flatnonzero(front)[np.argsort(seen[front, 2])]
    half = 1.06 * float(np.abs(seen[:, :2]).max())
    at = sheet.placed(panel, seen[order, :2], (half, -half, half))
    size = TEXLET / half * sheet.panel[0] / 2 * 72  # points
    sheet.axis.scatter(at[:, 0], at[:, 1], s=size**2, c=palette[texlets.ids[order]], linewidths=0)


def _joined(parts: Sequence[Pieces]) -> Pieces:
    return Pieces(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("corners", "colours", "widths"))
    )
