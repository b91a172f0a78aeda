"""Printed pictures of what was learned (Figs. 10 to 13), and of objects with grasps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import matplotlib as mpl
import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from spgf_torch.drawing.prototype_rings import Ring
from spgf_torch.drawing.style import ANGLE_SCALE, FAILED, HELD, LETTERS, SUCCESS_SCALE, success_colours
from spgf_torch.hands.records import Gripper
from spgf_torch.reporting.figures.learned import Grasps, short_outline
from spgf_torch.reporting.figures.pieces import (
    Pieces,
    View,
    centre,
    facing,
    frame,
    joined,
    mesh,
    ring,
    sticks,
    texlets,
)
from spgf_torch.reporting.figures.sheet import Sheet

ABOVE, BELOW = (-60.0, 38.0), (-60.0, -38.0)  # deg; azimuth and elevation of the camera
TOP, BOTTOM = (-90.0, 90.0), (-90.0, -90.0)  # straight at the centre's plane: x points to the right
RING_BOX = (0.033, -0.038, 0.03)
GRASP_BOX = {"NPG": 0.095, "WPG": 0.115}  # m; half the side of what is shown; of other types by the hand's width
AROUND = 0.07  # m about the TCP of the widest hand, of other types
CENTRE = 0.014  # m; the square in a prototype's colour, well within its ring
RULER = 0.05  # m
NOTE = 0.3  # inches below a picture: two lines of its note
WORDS = {TOP: "top", BOTTOM: "bottom", ABOVE: "perspective"}
# What Figs. 12 and 13 show of a prototype besides itself; the paper has these views. Other types: the first.
VIEWS = {"NPG": (ABOVE, TOP), "WPG": (ABOVE, BOTTOM)}


@dataclass(frozen=True)
class Look:
    """How a prototype is drawn and called.

    Attributes:
        layers: top and bottom. note: below its name.
    """

    name: str
    colour: str
    layers: tuple[Ring, Ring]
    note: str = ""


@dataclass(frozen=True)
class Inferred:
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
        sticks: (G, S, 2, 3) m; success: (G,) bool.
        note: what to write below.
    """

    title: str
    mesh: trimesh.Trimesh
    sticks: np.ndarray
    success: np.ndarray
    note: str = ""

    @staticmethod
    def of(
        name: str, mesh: trimesh.Trimesh, T: np.ndarray, outlines: Sequence[np.ndarray], success: np.ndarray
    ) -> Held:
        """Grasps (G, 4, 4) in the mesh's frame, of hands with these outlines (G), and their outcomes (G,) bool."""
        title = f"{name.replace('_', ' ')}: {success.sum()} of {len(success)} held"
        return Held(title, mesh, hands(T, outlines), success)


def hands(T: np.ndarray, outlines: Sequence[np.ndarray]) -> np.ndarray:
    """(G, S, 2, 3) m, the outlines (G) of hands (S, 2, 3) at their grasps (G, 4, 4).

    Those of fewer segments than others have their last one several times.
    """
    most = max(map(len, outlines), default=0)
    alike = [np.pad(each, ((0, most - len(each)), (0, 0), (0, 0)), mode="edge") for each in outlines]
    of_all = np.stack(alike) if alike else np.zeros((0, 0, 2, 3))
    sticks: np.ndarray = np.einsum("gij,gskj->gski", T[:, :3, :3], of_all) + T[:, None, None, :3, 3]
    return sticks


def prototype(look: Look, grey: bool = False) -> Pieces:
    """A prototype with its centre in its own colour and its frame."""
    layers = look.layers[:1] if grey else look.layers
    return joined([*(ring(layer, grey) for layer in layers), centre(CENTRE, look.colour), frame(np.eye(4), 0.024)])


def prototypes(looks: Sequence[Look]) -> Figure:
    """Fig. 10: each prototype from above and from below, both layers coloured by the angle to the centre's normal."""
    sheet = Sheet.of(len(looks), min(5, len(looks)), panel=(2.0, 1.36), foot=0.62)
    for k, look in enumerate(looks):
        _named(sheet, k, look)
        for side, view in enumerate((ABOVE, BELOW)):
            sheet.paint(k, prototype(look), view, RING_BOX, part=(side, 2))
    sheet.bar(ANGLE_SCALE, 180, r"$\alpha_2$, angle to the centre's normal (deg); left: from above, right: from below")
    return sheet.figure


def objects(shown: Sequence[Inferred], looks: Sequence[Look]) -> Figure:
    """Fig. 11: texlets that face the camera, coloured by prototype; the legend names those that occur."""
    sheet = Sheet.of(len(shown), 3, panel=(2.4, 2.66), right=1.4, below=0.26)
    palette = np.array([to_rgb(look.colour) for look in looks])
    for i, inferred in enumerate(shown):
        sheet.title(i, inferred.name.replace("_", " "))
        sheet.ruler(i, RULER, sheet.paint(i, coloured(inferred, palette), ABOVE))
    occurring = sorted({int(k) for each in shown for k in each.ids})
    dots = [Line2D([], [], marker="s", linestyle="", color=looks[k].colour, label=looks[k].name) for k in occurring]
    with mpl.rc_context(LETTERS):
        sheet.figure.legend(handles=dots, loc="center right", fontsize=8.5, handletextpad=0.2)
    return sheet.figure


def coloured(inferred: Inferred, palette: np.ndarray, view: View = ABOVE) -> Pieces:
    """The texlets that face the camera in the colours (K, 3) of their prototypes."""
    front = facing(inferred.normals, view)
    return texlets(inferred.positions[front], inferred.normals[front], palette[inferred.ids[front]])


def grasps(looks: Sequence[Look], learned: Sequence[Grasps], gripper: Gripper) -> Figure:
    """Figs. 12 and 13: each prototype, and with hands at its learned grasps, red (probability 0) to green (1)."""
    views, half = VIEWS.get(gripper.type, (ABOVE, TOP)), _half_side(gripper)
    sheet = Sheet.of(len(looks), min(2, len(looks)), panel=(4.6, 1.85), foot=0.62)
    for k, (look, found) in enumerate(zip(looks, learned, strict=True)):
        pieces = joined([prototype(look, grey=True), sticks(found.sticks, success_colours(found.probability), 1.2)])
        _named(sheet, k, replace(look, note=look.note.replace(", ", ",\n")), parts=3)
        sheet.paint(k, prototype(look), ABOVE, RING_BOX, part=(0, 3))
        for column, view in enumerate(views, start=1):
            sheet.paint(k, pieces, view, (half, -half, half), part=(column, 3))
    seen = ", ".join(WORDS[view] for view in views)
    how_open = f"hand open {1000 * gripper.width:.0f} mm; " if gripper.jaw else ""
    label = f"learned probability of success; {how_open}views: {seen}"
    sheet.bar(SUCCESS_SCALE, 1, label + "; coloured rings: as in Fig. 10")
    return sheet.figure


def worst(shown: Sequence[Held], ranking: str) -> Figure:
    """Objects with their highest-ranked grasps by a `ranking`, in words: failed ones red, held ones green."""
    below = NOTE if any(held.note for held in shown) else 0.0
    sheet = Sheet.of(len(shown), min(3, len(shown)), panel=(2.7, 2.8 + below), foot=0.52, below=below)
    for i, held in enumerate(shown):
        colours = np.where(held.success[:, None], to_rgb(HELD), to_rgb(FAILED))
        sheet.title(i, held.title)
        sheet.paint(i, joined([mesh(held.mesh, ABOVE), sticks(held.sticks, colours, 1.3)]), ABOVE)
        sheet.text(sheet.corner(i) + np.array([sheet.panel[0] / 2, below]), held.note, size=7.5)
    words = ((FAILED, "failed"), (HELD, "held"))
    with mpl.rc_context(LETTERS):
        handles = [Line2D([], [], color=colour, linewidth=2, label=word) for colour, word in words]
        sheet.figure.legend(handles=handles, loc="lower center", ncols=2, title=f"the best grasps by {ranking}")
    return sheet.figure


def _half_side(gripper: Gripper) -> float:
    """Half the side (m) of what is shown around a prototype of the grasps of a hand."""
    if gripper.type in GRASP_BOX:
        return GRASP_BOX[gripper.type]
    return AROUND + float(np.linalg.norm(short_outline(gripper)[..., :2], axis=-1).max())


def _named(sheet: Sheet, i: int, look: Look, parts: int = 1) -> None:
    """Name and note above the first of so many parts of a panel."""
    top = sheet.corner(i) + np.array([sheet.panel[0] / parts / 2, sheet.panel[1] - 0.06])
    sheet.text(top, look.name, "bold")
    sheet.text(top - (0, 0.15), look.note, size=7.5)
