"""Fig. 7: the cameras around an object, how its trials ended, and the hand open for each type of grasp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from spgf_torch.drawing.style import COLLIDED, FAILED, HELD, LETTERS
from spgf_torch.hands.records import Gripper
from spgf_torch.reporting.figures.grid_figures import titled
from spgf_torch.reporting.figures.learned import deep_outline
from spgf_torch.reporting.figures.pieces import Pieces, View, flat, frame, joined, lines, mesh, show, sticks
from spgf_torch.reporting.figures.scenes import ABOVE, hands
from spgf_torch.reporting.figures.sketches import note
from spgf_torch.sensing.cameras import Camera

HAND, HAND_VIEW = "#7d9cc0", (-72.0, 14.0)
FRUSTUM = 0.12  # m; how deep a camera's pyramid is drawn
RIG_VIEW = (-72.0, 30.0)
DOWNWARDS = np.diag([1.0, -1.0, -1.0, 1.0])  # the hand approaches from above
TRIED = 120  # trials drawn: more hide one another
ENDS = ((FAILED, "failed"), (COLLIDED, "failed, with a sensed collision"), (HELD, "held"))


@dataclass(frozen=True)
class Tried:
    """Some trials of one type on an object.

    Attributes:
        T: (G, 4, 4) object frame. success, collides: (G,) bool. gripper: the hand of this type.
    """

    gripper: Gripper
    T: np.ndarray
    success: np.ndarray
    collides: np.ndarray


def some_of_each(success: np.ndarray, collides: np.ndarray, count: int) -> np.ndarray:
    """Indices (<= count,) of trials, of each of the three outcomes of `ENDS` a third where there are as many."""
    ends = np.where(success, 2, np.where(collides, 1, 0))
    chosen = [np.flatnonzero(ends == end) for end in range(3)]
    return np.concatenate([of[np.linspace(0, len(of) - 1, min(len(of), count // 3)).astype(int)] for of in chosen])


def setup_figure(
    solid: trimesh.Trimesh, cameras: Sequence[Camera], tried: Tried, open_hands: Sequence[Gripper]
) -> Figure:
    """Fig. 7; the hand open for each type of grasp that is given, in a panel of its own."""
    count = 2 + len(open_hands)
    with mpl.rc_context(LETTERS):
        figure = Figure(figsize=(2.5 * count, 3.6))
        axes = [figure.add_axes(((i + 0.02) / count, 0.1, 0.96 / count, 0.81)) for i in range(count)]
        show(axes[0], _rig(solid, cameras), RIG_VIEW, 0.14)
        for i, camera in enumerate(cameras):
            note(axes[0], camera.T_object_camera[:3, 3], f"camera {i + 1}", RIG_VIEW, np.array([0.0, -1.0]), gap=25)
        which = some_of_each(tried.success, tried.collides, TRIED)
        colours = np.array([to_rgb(_end(tried.success[i], tried.collides[i])) for i in which])
        drawn = sticks(hands(tried.T[which], [deep_outline(tried.gripper)] * len(which)), colours, 0.8)
        show(axes[1], joined([mesh(solid, ABOVE), drawn]), ABOVE)
        words = [f"{len(cameras)} depth cameras", f"outcomes of {tried.gripper.type}"]
        for axis, gripper in zip(axes[2:], open_hands, strict=True):
            _hand(axis, gripper)
            words.append(f"the hand open for {gripper.type}")
        titled(axes, words)
        handles = [Line2D([], [], color=colour, linewidth=2, label=word) for colour, word in ENDS]
        figure.legend(handles=handles, loc="lower center", bbox_to_anchor=(1.5 / count, -0.005), ncols=3, fontsize=8)
    return figure


def _end(success: bool, collides: bool) -> str:
    return HELD if success else COLLIDED if collides else FAILED


def _rig(solid: trimesh.Trimesh, cameras: Sequence[Camera]) -> Pieces:
    """The object, and each camera's frame and pyramid."""
    parts, centre = [mesh(solid, RIG_VIEW)], solid.bounds.mean(axis=0)
    for camera in cameras:
        corners = camera.rays()[[0, 0, -1, -1], [0, -1, -1, 0]] * FRUSTUM
        corners = corners @ camera.T_object_camera[:3, :3].T + camera.T_object_camera[:3, 3]
        eye = np.tile(camera.T_object_camera[:3, 3], (4, 1))
        ends = np.concatenate([np.stack([eye, corners], 1), np.stack([corners, np.roll(corners, -1, axis=0)], 1)])
        sight = np.stack([camera.T_object_camera[:3, 3], centre])[None]
        parts += [lines(ends, np.full((len(ends), 3), 0.45), 0.8), lines(sight, np.full((1, 3), 0.8), 0.6)]
        parts += [frame(camera.T_object_camera, 0.09, 1.4)]
    return joined(parts)


def _hand(axis: Axes, gripper: Gripper) -> None:
    """The open hand from the side; of a jaw the opening is measured."""
    whole: trimesh.Trimesh = trimesh.util.concatenate(list(gripper.shapes))  # type: ignore[assignment]
    show(axis, mesh(whole.copy().apply_transform(DOWNWARDS), HAND_VIEW, HAND), HAND_VIEW)
    if gripper.jaw:
        ends = np.array([[-gripper.width / 2, 0, -0.012], [gripper.width / 2, 0, -0.012]])
        _measure(axis, ends, HAND_VIEW, f"{1000 * gripper.width:.0f} mm")


def _measure(axis: Axes, ends: np.ndarray, view: View, words: str) -> None:
    (ax, ay), (bx, by) = flat(ends, view).tolist()
    look = {"arrowstyle": "<|-|>", "color": "black", "lw": 1, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", (bx, by), (ax, ay), arrowprops=look)
    note(axis, ends.mean(axis=0), words, view, np.array([0.0, -1.0]), gap=27)  # below the tips
