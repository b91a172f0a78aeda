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

from spgf_torch.reporting.learned import Grasps, Ring
from spgf_torch.reporting.style import (
    ANGLE_SCALE,
    FAILED,
    HELD,
    LETTERS,
    LIGHT,
    MESH,
    SUCCESS_SCALE,
    angle_colours,
    scale,
    success_colours,
)

PATCH = 0.012  # m; largest edge of a triangle that is sorted by depth
STEP = 0.006  # m; longest piece of a line that is sorted by depth
ABOVE, BELOW = (-60.0, 38.0), (-60.0, -38.0)  # deg; azimuth and elevation of the camera
# m; half width, bottom and top of the picture of a prototype, without and with hands.
RING_BOX, GRASP_BOX = (0.032, -0.032, 0.024), (0.105, -0.1, 0.1)


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
class Texels:
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


def prototypes(shapes: Sequence[tuple[Ring, Ring]], names: Sequence[str]) -> Figure:
    """Fig. 10: each prototype from above and from below, both layers coloured by the angle to the centre's normal."""
    columns = 5 if len(shapes) > 4 else len(shapes)
    rows = ceil(len(shapes) / columns)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(2.9 * columns, 1.55 * rows + 0.9), layout="constrained")
        axes = _bare(figure, rows, 2 * columns)
        for k, (pair, name) in enumerate(zip(shapes, names, strict=True)):
            above, below = axes[k // columns, 2 * (k % columns)], axes[k // columns, 2 * (k % columns) + 1]
            pieces = _joined([*map(_ring_pieces, pair), _arrow(0.024)])
            for axis, view in ((above, ABOVE), (below, BELOW)):
                _paint(axis, pieces, view, RING_BOX)
            above.set_title(name, loc="left", fontweight="bold")
        _bar(figure, axes, ANGLE_SCALE, 180, "angle to the centre's normal (deg); left: from above, right: from below")
    return figure


def objects(shown: Sequence[Texels], names: Sequence[str], colours: Sequence[str]) -> Figure:
    """Fig. 11: texlets that face the camera, coloured by prototype; the legend names those that occur."""
    columns = 3
    rows = ceil(len(shown) / columns)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(9.2, 2.75 * rows), layout="constrained")
        axes = _bare(figure, rows, columns)
        palette = np.array([to_rgb(colour) for colour in colours])
        for axis, texels in zip(axes.flat, shown, strict=False):
            _texels(axis, texels, palette)
            axis.set_title(texels.name.replace("_", " "), fontweight="bold")
        occurring = sorted({int(k) for texels in shown for k in texels.ids}, key=lambda k: (colours[k], k))
        order = sorted(occurring, key=lambda k: (names[k].split()[-2], k))
        dots = [Line2D([], [], marker="o", linestyle="", color=colours[k], label=names[k]) for k in order]
        figure.legend(handles=dots, loc="outside right center", fontsize=8, handletextpad=0.2)
    return figure


def grasps(
    shapes: Sequence[tuple[Ring, Ring]], learned: Sequence[Grasps], names: Sequence[str], opening: float
) -> Figure:
    """Figs. 12 and 13: each prototype in grey with hands at its learned grasps, red (probability 0) to green (1)."""
    columns = min(5, len(shapes))
    rows = ceil(len(shapes) / columns)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(2.3 * columns, 2.35 * rows + 0.9), layout="constrained")
        axes = _bare(figure, rows, columns)
        for axis, pair, found, name in zip(axes.flat, shapes, learned, names, strict=False):
            pieces = [_ring_pieces(pair[0], grey=True), _arrow(0.03), _sticks(found.sticks, success_colours(found.probability), 1.3)]
            _paint(axis, _joined(pieces), ABOVE, GRASP_BOX)
            axis.set_title(name, fontweight="bold")
        _bar(figure, axes, SUCCESS_SCALE, 1, f"learned probability of success (hand open {1000 * opening:.0f} mm)")
    return figure


def worst(shown: Sequence[Held]) -> Figure:
    """Objects with their highest-ranked grasps: failed ones red, held ones green."""
    columns = 3
    rows = ceil(len(shown) / columns)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(9.2, 3.2 * rows + 0.4), layout="constrained")
        axes = _bare(figure, rows, columns)
        for axis, held in zip(axes.flat, shown, strict=False):
            colours = np.where(held.success[:, None], to_rgb(HELD), to_rgb(FAILED))
            pieces = _joined([_mesh(held.mesh), _sticks(held.sticks, colours, 1.5)])
            _paint(axis, pieces, ABOVE)
            axis.set_title(held.title, fontweight="bold")
        lines = [Line2D([], [], color=colour, linewidth=2, label=word) for colour, word in ((FAILED, "failed"), (HELD, "held"))]
        figure.legend(handles=lines, loc="outside lower center", ncols=2)
    return figure


def camera(view: tuple[float, float]) -> np.ndarray:
    """(3, 3): rows are the picture's right, up and the direction towards a camera at (azimuth, elevation) deg."""
    azimuth, elevation = np.radians(view)
    flat = np.cos(elevation)
    towards = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def _paint(axis: Axes, pieces: Pieces, view: tuple[float, float], box: tuple[float, float, float] | None = None) -> None:
    """Draw; `box` is the half width, bottom and top of the picture (m), without one everything is in it."""
    seen = pieces.corners @ camera(view).T
    if box is None:
        flat = seen[..., :2].reshape(-1, 2)
        seen[..., :2] -= (flat.min(axis=0) + flat.max(axis=0)) / 2
        half = 1.04 * np.abs(seen[..., :2]).max()
        box = (half, -half, half)
    order = np.argsort(seen[..., 2].mean(axis=1), kind="stable")
    colours = pieces.colours[order]
    axis.add_collection(
        PolyCollection(
            list(seen[order][..., :2]),
            facecolors=colours,
            edgecolors=colours,
            linewidths=np.where(pieces.widths > 0, pieces.widths, 0.25)[order],
        )
    )
    axis.set(xlim=(-box[0], box[0]), ylim=box[1:], aspect="equal")


def _ring_pieces(ring: Ring, grey: bool = False) -> Pieces:
    faces = np.full((len(ring.quads), 3), 0.72) if grey else angle_colours(ring.alpha2_deg)
    shade = np.ones(len(faces)) if grey else _shading(ring.quads)
    quads = Pieces(ring.quads, faces * shade[:, None], np.zeros(len(faces)))
    gap = Pieces(np.repeat(ring.gap_lines, 2, axis=1), np.full((len(ring.gap_lines), 3), 0.6), np.full(len(ring.gap_lines), 0.9))
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
    fine = mesh.subdivide_to_size(PATCH)
    facing = fine.face_normals @ camera(ABOVE)[2] > 0
    corners = fine.triangles[facing]
    shade = 0.72 + 0.28 * np.clip(fine.face_normals[facing] @ LIGHT, 0, 1)
    colours = shade[:, None] * to_rgb(MESH)
    return Pieces(np.concatenate([corners, corners[:, -1:]], axis=1), colours, np.zeros(len(corners)))


def _texels(axis: Axes, texels: Texels, palette: np.ndarray) -> None:
    view = camera(ABOVE)
    middle = (texels.positions.min(axis=0) + texels.positions.max(axis=0)) / 2
    seen = (texels.positions - middle) @ view.T
    front = texels.normals @ view[2] > 0
    order = np.flatnonzero(front)[np.argsort(seen[front, 2])]
    half = 1.06 * np.abs(seen[:, :2]).max()
    size = 0.0052 / (2 * half) * 2.35 * 72  # points: a texlet is some 5 mm wide
    axis.scatter(*seen[order, :2].T, s=size**2, c=palette[texels.ids[order]], linewidths=0)
    axis.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")


def _joined(parts: Sequence[Pieces]) -> Pieces:
    return Pieces(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("corners", "colours", "widths")))


def _bare(figure: Figure, rows: int, columns: int) -> np.ndarray:
    """Axes (rows, columns) without frames."""
    axes: np.ndarray = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    return axes


def _bar(figure: Figure, axes: np.ndarray, stops: Sequence[tuple[float, str]], most: float, label: str) -> None:
    colours = ScalarMappable(Normalize(0, most), scale(stops))
    bar = figure.colorbar(colours, ax=axes, location="bottom", shrink=0.45, aspect=40, pad=0.02)
    bar.set_label(label)
    bar.outline.set_visible(False)  # type: ignore[operator]


