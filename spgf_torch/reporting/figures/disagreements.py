"""Grasps that one engine holds and the other does not: the open hand on the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
import trimesh
from matplotlib.lines import Line2D

from spgf_torch.drawing.page import drawn, png
from spgf_torch.drawing.style import LETTERS, METHOD_COLOURS
from spgf_torch.evaluation.engines import Compared
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.reporting.figures.pieces import View, joined, mesh
from spgf_torch.reporting.figures.sheet import Sheet
from spgf_torch.second_engine.physics import MUJOCO, NAMES, SAPIEN
from spgf_torch.simulation.table import OUTCOMES

MOST = 9  # in the picture: three rows
MOST_ON_PAGE = 24  # whose hands and meshes stay within a few MB
COLOURS = {SAPIEN: METHOD_COLOURS[1], MUJOCO: METHOD_COLOURS[2]}  # of the hand, by who holds it


@dataclass(frozen=True)
class Disagreement:
    """One grasp that one engine holds.

    Attributes:
        name: of the object. grasp: type and rank. ends: how it ends in each engine. holds: the engine that holds it.
        mesh, hand: in the object's frame, m. view: azimuth and elevation, deg: both fingers are seen beside each other.
    """

    name: str
    grasp: str
    ends: str
    holds: str
    mesh: trimesh.Trimesh
    hand: trimesh.Trimesh
    view: View


def shown_disagreements(
    objects: Sequence[GraspObject], compared: Sequence[Compared], grippers: Mapping[str, Gripper]
) -> list[Disagreement]:
    """Up to `MOST_ON_PAGE`: those of the best CG grasps first, and of each object one before the next of any.

    grippers: grasp type -> the open hand; the codes of grasps count the types sorted by name.
    """
    types, found = sorted(grippers), []
    for index, its in enumerate(compared):
        for turn, place in enumerate(its.disagreements()):
            found.append(((its.rank(place) is None, turn, index), index, place))
    return [
        _disagreement(objects[index], compared[index], place, grippers[types[compared[index].grasp_type[place]]])
        for _, index, place in sorted(found)[:MOST_ON_PAGE]
    ]


def _disagreement(obj: GraspObject, its: Compared, place: int, gripper: Gripper) -> Disagreement:
    rank = its.rank(place)
    words = f"rank {rank}" if rank else "random" if place in its.random else "best of its type"
    ends = ", ".join(f"{NAMES[engine]}: {OUTCOMES[codes[place]]}" for engine, codes in its.outcomes.items())
    hand: trimesh.Trimesh = trimesh.util.concatenate(list(gripper.shapes)).copy()  # type: ignore[assignment]
    T = its.T_object_tcp[place]
    hand.apply_transform(T)
    holds = SAPIEN if its.held[SAPIEN][place] else MUJOCO
    name = obj.name.replace("_", " ")
    return Disagreement(name, f"{gripper.type}, {words}", ends, holds, obj.mesh, hand, _across(T))


def _across(T: np.ndarray) -> View:
    """Across closing and approach, from the upper side."""
    x, y, z = T[:3, 1] if T[2, 1] >= 0 else -T[:3, 1]
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(min(z, 1.0))))


def disagreements_picture(shown: Sequence[Disagreement]) -> bytes:
    """A PNG of the first of them, the hand in the colour of the engine that holds the grasp."""
    shown = shown[:MOST]
    sheet = Sheet.of(len(shown), min(3, len(shown)), panel=(3.0, 3.1), foot=0.52, below=0.36)
    for i, its in enumerate(shown):
        sheet.title(i, its.name)
        parts = [mesh(its.mesh, its.view), mesh(its.hand, its.view, COLOURS[its.holds])]
        sheet.paint(i, joined(parts), its.view)
        for line, height in ((its.grasp, 0.34), (its.ends, 0.19)):
            sheet.text(sheet.corner(i) + np.array([sheet.panel[0] / 2, height]), line, size=8)
    with mpl.rc_context(LETTERS):
        lines = [Line2D([], [], color=colour, linewidth=4, label=NAMES[name]) for name, colour in COLOURS.items()]
        sheet.figure.legend(handles=lines, loc="lower center", ncols=2, title="held only in")
    return png(drawn(sheet.figure))
