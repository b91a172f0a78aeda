"""Figs. 2 and 6: the angles of a real pair of texlets, and the transformation from a real feature to a real grasp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

from spgf_torch.drawing.style import ALONG, CENTRE, FAILED, HELD, LETTERS, NEIGHBOUR, OTHER, PAPER, TOWARDS
from spgf_torch.reporting.figures.example import Surroundings
from spgf_torch.reporting.figures.grid_figures import titled
from spgf_torch.reporting.figures.pieces import (
    AXES,
    View,
    centre,
    facing,
    flat,
    joined,
    moved,
    ring,
    show,
    sticks,
    texlets,
)
from spgf_torch.reporting.figures.scenes import Look
from spgf_torch.reporting.figures.sketches import arc, arrow, disc, note, patch, stroke

SIDE, ABOVE = (-62.0, 22.0), (-90.0, 90.0)  # deg; where Fig. 2 is looked at from
NORMAL = 0.55  # of the radius; length of a drawn normal
COLOURS = ("#6a2fb5", "#b25a00", "#00795A")  # of alpha1, alpha2, alpha3
AROUND, CENTRE_SIZE = 0.07, 0.012  # m; what is drawn of the object about Fig. 6's feature and grasp; its centre
BOW = 0.5  # of the length; how far the arrow T bends
UP, RIGHT = np.array([0.0, 1.0]), np.array([1.0, 0.0])


@dataclass(frozen=True)
class PairDrawn:
    """A neighbour in the centre's frame (R_x, R_y, n1).

    Attributes:
        step: (3,) m, from the centre to the neighbour. normal: (3,) the neighbour's. angles: (3,) deg.
    """

    step: np.ndarray
    normal: np.ndarray
    angles: np.ndarray

    @staticmethod
    def of(around: Surroundings, centre: int, pair: int) -> PairDrawn:
        to_frame = around.frames[centre]
        step, normal = (side[:, pair] @ to_frame for side in (around.pairs.step, around.pairs.normal))
        return PairDrawn(step, normal, np.degrees(around.angles[:, pair]))


def angle_figure(pair: PairDrawn, radius: float) -> Figure:
    """Fig. 2: the three angles of a pair in space, and alpha3 along the normal."""
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(8.4, 3.9))
        axes = [figure.add_axes(place) for place in ((0.0, 0.0, 0.58, 0.91), (0.6, 0.0, 0.39, 0.91))]
        _angles_in_space(axes[0], pair, radius)
        _angle_in_plane(axes[1], pair, radius)
        words = [rf"$\alpha_{i} = {angle:.0f}°$" for i, angle in enumerate(pair.angles, start=1)]
        titled(axes, (", ".join(words), rf"along the normal: {words[2]}"))
        for axis in axes:
            axis.margins(0.11)
            axis.set_aspect("equal", adjustable="datalim")
            axis.set_axis_off()
    return figure


@dataclass(frozen=True)
class Linked:
    """A feature and a grasp on an object, in its frame.

    Attributes:
        positions, normals: (N, 3) the object's texlets. T_object_feature, T_object_tcp: (4, 4).
        look: of the feature's prototype. success: how the grasp ended.
        outline: (S, 2, 3) m, of the open hand in the TCP's frame.
    """

    positions: np.ndarray
    normals: np.ndarray
    T_object_feature: np.ndarray
    T_object_tcp: np.ndarray
    look: Look
    outline: np.ndarray
    success: bool


def link_figure(linked: Linked, view: View) -> Figure:
    """Fig. 6: feature, grasp and the transformation T between their poses."""
    feature, tcp = linked.T_object_feature, linked.T_object_tcp
    hand = linked.outline @ tcp[:3, :3].T + tcp[:3, 3]
    near = facing(linked.normals, view)
    near &= np.linalg.norm(linked.positions - (feature + tcp)[:3, 3] / 2, axis=1) < AROUND
    pieces = [
        texlets(linked.positions[near], linked.normals[near], np.tile(to_rgb(OTHER), (int(near.sum()), 1))),
        sticks(hand[None], np.array([to_rgb(HELD if linked.success else FAILED)]), 2.6),
        *(moved(ring(layer), feature) for layer in linked.look.layers[:1]),
        moved(centre(CENTRE_SIZE, linked.look.colour), feature),
    ]
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(5.6, 4.4))
        axis = figure.add_axes((0, 0.1, 1, 0.8))
        show(axis, joined(pieces), view, 0.12)
        for T, length in ((feature, 0.045), (tcp, 0.03)):
            for direction, colour in zip(T[:3, :3].T, AXES, strict=True):
                arrow(axis, T[:3, 3], T[:3, 3] + length * direction, to_hex(colour), view)
        _transformation(axis, feature[:3, 3], tcp[:3, 3], view)
        note(axis, feature[:3, 3] + 0.047 * feature[:3, 0], r"$\alpha_3 = 0$, start", view, UP, TOWARDS, 8)
        _labels(axis, {f"feature: {linked.look.name}": feature[:3, 3], "grasp (TCP)": tcp[:3, 3]}, view)
        outcome = "success" if linked.success else "failure"
        words = f"T = (pose of the grasp in the feature's frame, {outcome}, id {linked.look.name.split()[-1]})"
        figure.text(0.5, 0.05, words, ha="center", va="center")
    return figure


def _labels(axis: Axes, named: Mapping[str, np.ndarray], view: View) -> None:
    """Words for two points (3,), beside the picture, with a line to each: the left point's words on the left."""
    line: Any = {"arrowstyle": "-", "color": PAPER, "linewidth": 0.8, "shrinkB": 3}
    by_side = sorted(named.items(), key=lambda each: flat(each[1], view)[0])
    for (words, point), place, side in zip(by_side, ((0.03, 0.16), (0.97, 0.85)), ("left", "right"), strict=True):
        x, y = flat(point, view).tolist()
        axis.annotate(words, (x, y), place, textcoords="figure fraction", ha=side, arrowprops=line, zorder=8)


def _transformation(axis: Axes, feature: np.ndarray, tcp: np.ndarray, view: View) -> None:
    """An arrow from the feature to the grasp, bent so that it leaves what is between them free."""
    begin, end = flat(np.stack([feature, tcp]), view)
    bow = FancyArrowPatch(begin, end, connectionstyle=f"arc3,rad={BOW}", arrowstyle="-|>", mutation_scale=14)
    bow.set(color="black", linewidth=1.7, zorder=9)
    axis.add_patch(bow)
    across = np.array([(end - begin)[1], -(end - begin)[0]])
    x, y = (begin + end) / 2 + 0.8 * BOW * across
    axis.text(x, y, "T", fontsize=14, fontweight="bold", ha="center", va="center")


def _angles_in_space(axis: Axes, pair: PairDrawn, radius: float) -> None:
    view, origin = SIDE, np.zeros(3)
    ground, n1, length = pair.step * [1, 1, 0], np.array([0.0, 0, 1]), NORMAL * radius
    disc(axis, radius, view)
    _axes(axis, radius, view)
    arrow(axis, origin, length * n1, "black", view, "$n_1$")
    stroke(axis, np.stack([origin, pair.step]), NEIGHBOUR, view)
    stroke(axis, np.stack([origin, ground]), PAPER, view, 1.0, "--")
    stroke(axis, np.stack([ground, pair.step]), PAPER, view, 0.8, ":")
    stroke(axis, np.stack([pair.step, pair.step + length * n1]), PAPER, view, 1.0, "--")
    arrow(axis, pair.step, pair.step + length * pair.normal, NEIGHBOUR, view, "$n_2$")
    patch(axis, origin, n1, CENTRE, view)
    patch(axis, pair.step, pair.normal, NEIGHBOUR, view)
    note(axis, origin, "$X_1$", view, -RIGHT - UP, CENTRE, 16)
    note(axis, pair.step, "$X_2$", view, -UP, NEIGHBOUR, 15)
    arcs = (
        (ground, pair.step, 0.62 * radius, origin, RIGHT),
        (n1, pair.normal, 0.6 * length, pair.step, UP),
        (np.array([1.0, 0, 0]), ground, 0.38 * radius, origin, -UP),
    )
    for i, (a, b, size, at, away) in enumerate(arcs):
        note(axis, arc(axis, a, b, size, COLOURS[i], view, at), rf"$\alpha_{i + 1}$", view, away, COLOURS[i])


def _angle_in_plane(axis: Axes, pair: PairDrawn, radius: float) -> None:
    view, ground = ABOVE, pair.step * [1, 1, 0]
    disc(axis, radius, view)
    _axes(axis, radius, view)
    stroke(axis, np.stack([np.zeros(3), ground]), NEIGHBOUR, view)
    for axis_of in (0, 1):
        foot = ground * np.eye(3)[axis_of]
        stroke(axis, np.stack([ground, foot]), PAPER, view, 0.9, "--")
        words = ("$p(X, R_x)$", "$p(X, R_y)$")[axis_of]
        note(axis, foot, words, view, (-UP, -RIGHT)[axis_of] * np.sign(foot[axis_of]), gap=(11, 28)[axis_of])
    patch(axis, np.zeros(3), np.array([0.0, 0, 1]), CENTRE, view)
    patch(axis, ground, np.array([0.0, 0, 1]), NEIGHBOUR, view)
    note(axis, ground, "$X_2$", view, RIGHT + UP, NEIGHBOUR, 18)
    middle = arc(axis, np.array([1.0, 0, 0]), ground, 0.38 * radius, COLOURS[2], view)
    note(axis, middle, r"$\alpha_3$", view, flat(middle, view), COLOURS[2])


def _axes(axis: Axes, radius: float, view: View) -> None:
    arrow(axis, np.zeros(3), np.array([1.15 * radius, 0, 0]), TOWARDS, view, "$R_x$")
    arrow(axis, np.zeros(3), np.array([0, 1.15 * radius, 0]), ALONG, view, "$R_y$")
