"""Whole hands of a page, which JavaScript poses and closes: the shapes of a grasp type once, and a pose a grasp."""

from __future__ import annotations

from typing import Any

import numpy as np

from spgf_torch.hands.records import Grasp, Gripper

DIGITS, TURNS = 2, 6  # decimals of mm, and of the numbers of a rotation: 0.2 um at 200 mm
STEPS = 9  # places between open and closed, evenly spaced, that a page knows; between them it goes straight


def fractions() -> np.ndarray:
    """(F,) of the way from open to closed, at which a page is told where the shapes are."""
    return np.linspace(0.0, 1.0, STEPS)


def closing_content(gripper: Gripper, moves: np.ndarray | None) -> dict[str, Any]:
    """The open hand's collision shapes as one mesh in the TCP frame, mm, and how each moves while the hand closes.

    `starts` are the first vertices of the shapes, `moves` of each of `fractions` and shape 3 x 4 numbers, row by row.

    Args:
        moves: (F, shapes, 4, 4), `hands.hand.closing_poses`; None: it stays open.
    """
    shapes = gripper.shapes
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    corners = np.concatenate([shape.vertices for shape in shapes])
    faces = np.concatenate([shape.faces + start for shape, start in zip(shapes, starts[:-1], strict=True)])
    if moves is None:
        moves = np.broadcast_to(np.eye(4), (1, len(shapes), 4, 4))
    return {
        **dict(zip("xyz", np.round(1000 * corners, DIGITS).T.tolist(), strict=True)),
        **dict(zip("ijk", faces.T.tolist(), strict=True)),
        "starts": starts.tolist(),
        "moves": [[_rows(T) for T in of_all] for of_all in moves],
    }


def hand_content(grasp: Grasp, colour: str) -> dict[str, Any]:
    """A grasp's type, its colour, and the pose of its TCP: 3 x 4 numbers row by row, mm."""
    return {"type": grasp.type, "pose": _rows(grasp.T_input_tcp), "colour": colour}


def _rows(T: np.ndarray) -> list[float]:
    mm = np.hstack([np.round(T[:3, :3], TURNS), np.round(1000 * T[:3, 3:], DIGITS)]) + 0.0
    rows: list[float] = mm.ravel().tolist()
    return rows
