"""Things in space as coloured polygons, sorted by depth and drawn in parallel projection: far ones first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from spgf_torch.drawing.prototype_rings import Ring, shading
from spgf_torch.drawing.style import ALONG, LIGHT, MESH, TOWARDS, angle_colours, camera
from spgf_torch.geometry.tangents import tangents

PATCH = 0.012  # m; largest edge of a triangle that is sorted by depth
STEP = 0.006  # m; longest piece of a line that is sorted by depth
TEXLET = 0.0048  # m; drawn width of a texlet: they lie 5 mm apart
EDGE = 0.25  # points; width of a face's edge, which closes the seams
AXES = np.array([to_rgb(colour) for colour in (TOWARDS, ALONG, "#1f1f1f")])  # of a frame: x, y, z

View = tuple[float, float]  # deg; azimuth and elevation of the camera


@dataclass(frozen=True)
class Pieces:
    """P polygons in space, ready to be sorted by depth.

    Attributes:
        corners: (P, 4, 3) m; triangles repeat their last corner, lines are (a, a, b, b).
        colours: (P, 3). widths: (P,) points, of lines; 0 for faces.
    """

    corners: np.ndarray
    colours: np.ndarray
    widths: np.ndarray

    def seen(self, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Polygons (P, 4, 2) m from far to near, their colours (P, 3) and the widths of their edges (P,) in points."""
        turned = self.corners @ camera(view).T
        order = np.argsort(turned[..., 2].mean(axis=1), kind="stable")
        widths = np.where(self.widths > 0, self.widths, EDGE)
        return turned[order][..., :2], self.colours[order], widths[order]


def joined(parts: Sequence[Pieces]) -> Pieces:
    return Pieces(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("corners", "colours", "widths"))
    )


def moved(pieces: Pieces, T: np.ndarray) -> Pieces:
    """The pieces in another frame, by T (4, 4)."""
    return Pieces(pieces.corners @ T[:3, :3].T + T[:3, 3], pieces.colours, pieces.widths)


def flat(points: np.ndarray, view: View) -> np.ndarray:
    """Points (..., 3) m as they lie in the picture, (..., 2) m."""
    seen: np.ndarray = np.asarray(points) @ camera(view)[:2].T
    return seen


def show(axis: Axes, pieces: Pieces, view: View, margin: float = 0.03) -> None:
    """Draw the pieces on axes of their own, all of them within, `margin` of their size around; units are metres."""
    corners, colours, widths = pieces.seen(view)
    axis.add_collection(
        PolyCollection(list(corners), facecolors=colours, edgecolors=colours, linewidths=widths, joinstyle="round")
    )
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    room = margin * float((high - low).max())
    axis.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
    axis.set_axis_off()


def faces(corners: np.ndarray, colours: np.ndarray) -> Pieces:
    """Quadrilaterals (P, 4, 3) with colours (P, 3)."""
    return Pieces(corners, colours, np.zeros(len(corners)))


def lines(ends: np.ndarray, colours: np.ndarray, width: float) -> Pieces:
    """Lines (L, 2, 3) of `width` points with colours (L, 3), cut into pieces short enough to be sorted by depth."""
    if not len(ends):
        return Pieces(np.zeros((0, 4, 3)), np.zeros((0, 3)), np.zeros(0))
    count = np.maximum(1, np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / STEP)).astype(int)
    line = np.repeat(np.arange(len(ends)), count)
    i = np.concatenate([np.arange(n) for n in count])
    a, step = ends[line, 0], ((ends[:, 1] - ends[:, 0]) / count[:, None])[line]
    first, last = a + i[:, None] * step, a + (i + 1)[:, None] * step
    return Pieces(np.stack([first, first, last, last], axis=1), colours[line], np.full(len(line), width))


def sticks(hands: np.ndarray, colours: np.ndarray, width: float) -> Pieces:
    """Outlines of hands (G, S, 2, 3) with colours (G, 3)."""
    return lines(hands.reshape(-1, 2, 3), np.repeat(colours, hands.shape[1], axis=0), width)


def frame(T: np.ndarray, length: float, width: float = 1.1) -> Pieces:
    """The axes of a pose (4, 4): x red, y green, z black."""
    ends = np.stack([np.tile(T[:3, 3], (3, 1)), T[:3, 3] + length * T[:3, :3].T], axis=1)
    return lines(ends, AXES, width)


def ring(layer: Ring, grey: bool = False) -> Pieces:
    """One layer of a prototype: coloured by alpha2 or grey, gaps as dashes."""
    colours = np.full((len(layer.quads), 3), 0.72) if grey else angle_colours(layer.alpha2_deg)
    shade = np.ones(len(colours)) if grey else shading(layer.quads)
    dashes = lines(layer.gap_lines, np.full((len(layer.gap_lines), 3), 0.6), 0.9)
    return joined([faces(layer.quads, colours * shade[:, None]), dashes])


def centre(size: float, colour: str) -> Pieces:
    """The feature's own patch: a square `size` m wide in its plane."""
    return texlets(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.array([to_rgb(colour)]), size)


def texlets(positions: np.ndarray, normals: np.ndarray, colours: np.ndarray, size: float = TEXLET) -> Pieces:
    """Surface patches (N, 3) m with unit normals (N, 3) as squares `size` m wide, shaded by the lamp."""
    x, y = tangents(normals)
    corners = positions[:, None] + size / 2 * np.stack([x + y, y - x, -x - y, x - y], axis=1)
    shade = 0.8 + 0.2 * np.clip(normals @ LIGHT, 0, 1)
    return faces(corners, np.asarray(colours) * shade[:, None])


def facing(normals: np.ndarray, view: View) -> np.ndarray:
    """(N,) bool: which patches with normals (N, 3) show their front to the camera."""
    front: np.ndarray = normals @ camera(view)[2] > 0
    return front


def mesh(solid: trimesh.Trimesh, view: View, colour: str = MESH) -> Pieces:
    """The triangles of a mesh that face the camera, shaded."""
    fine: trimesh.Trimesh = solid.subdivide_to_size(PATCH)  # type: ignore[assignment]
    front = facing(fine.face_normals, view)
    corners = fine.triangles[front]
    shade = 0.72 + 0.28 * np.clip(fine.face_normals[front] @ LIGHT, 0, 1)
    return faces(np.concatenate([corners, corners[:, -1:]], axis=1), shade[:, None] * to_rgb(colour))
