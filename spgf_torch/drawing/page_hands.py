"""Whole hands of a page, which JavaScript poses and closes: the shapes of a grasp type once, and a pose a grasp."""

from __future__ import annotations

from typing import Any

import numpy as np

from spgf_torch.drawing.packed import packed
from spgf_torch.hands.records import Gripper

STEPS = 9  # places between open and closed, evenly spaced, that a page knows; between them it goes straight


def fractions() -> np.ndarray:
    """(F,) of the way from open to closed, at which a page is told where the shapes are."""
    return np.linspace(0.0, 1.0, STEPS)


def closing_content(gripper: Gripper, moves: np.ndarray | None) -> dict[str, Any]:
    """The open hand's collision shapes in the TCP frame, m, one after another, and how each moves while it closes.

    `corners` and `faces` are the first corner and the first face of each shape, and their numbers at the end; `steps`
    is how many of `fractions` the `moves` have: of each and of each shape 3 x 4 numbers, row by row.

    Args:
        moves: (F, shapes, 4, 4), `hands.hand.closing_poses`; None: it stays open.
    """
    shapes = gripper.shapes
    corners = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    faces = np.cumsum([0, *(len(shape.faces) for shape in shapes)])
    if moves is None:
        moves = np.broadcast_to(np.eye(4), (1, len(shapes), 4, 4))
    return {
        "vertices": packed(np.concatenate([shape.vertices for shape in shapes]), "f4"),
        "triangles": packed(np.concatenate([shape.faces for shape in shapes]), "u2"),
        "corners": corners.tolist(),
        "faces": faces.tolist(),
        "steps": len(moves),
        "moves": packed(moves[:, :, :3], "f4"),
    }
