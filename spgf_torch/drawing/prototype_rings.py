"""The rings of a prototype as shapes in space: the surface around a feature, as far as its angles say. Pure geometry.

In the feature's frame: origin at the centre, z its normal, x the aligned direction (ring cell 0); metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spgf_torch.drawing.style import LIGHT

INNER = 0.5  # of the radius: where the drawn band of a ring begins
SUNK = 0.15  # of the radius: how much lower the bottom layer is drawn, so that the layers do not cover each other


@dataclass(frozen=True)
class Ring:
    """One layer of a prototype as a band of quadrilaterals.

    Attributes:
        quads: (C, 4, 3) m, the cells that are no gap.
        alpha2_deg: (C,) angle to the centre's normal.
        gap_lines: (G, 2, 3) m, where the cells that are gaps would lie in the plane.
    """

    quads: np.ndarray
    alpha2_deg: np.ndarray
    gap_lines: np.ndarray


def ring_positions(alpha1: np.ndarray, azimuth: np.ndarray, radius: float) -> np.ndarray:
    """(..., 3) where a neighbour at distance `radius` lies: alpha1 is how far it falls below the plane (Eq. 2), rad."""
    flat = np.cos(alpha1)
    return radius * np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), -np.sin(alpha1)], axis=-1)


def rings(degrees: np.ndarray, seen: np.ndarray, radius: float) -> tuple[Ring, Ring]:
    """Top and bottom layer of one prototype (2, cells, 2) in degrees; cell k is centred on azimuth k * 360 / cells.

    A cell is as wide, from the outside in, as the share of features that have something there, `seen` (2, cells); a
    gap where it is less than half of them.
    """
    return _ring(degrees[0], seen[0], radius, 0.0), _ring(degrees[1], seen[1], radius, SUNK * radius)


def shading(quads: np.ndarray) -> np.ndarray:
    """(C,) brightness in [0.82, 1] by how much quadrilaterals (C, 4, 3) face the lamp."""
    normal = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-12)
    brightness: np.ndarray = 0.82 + 0.18 * np.abs(normal @ LIGHT)
    return brightness


def _ring(layer_deg: np.ndarray, seen: np.ndarray, radius: float, sunk: float) -> Ring:
    cells = len(layer_deg)
    azimuth = np.arange(cells) * 2 * np.pi / cells
    half = np.pi / cells
    gap, inner = seen < 0.5, 1 - (1 - INNER) * seen
    borders = zip(_borders(np.radians(layer_deg[:, 0]), gap), _borders(inner, gap), (-half, half), strict=True)
    (a, b), (d, c) = (
        [np.reshape(share, (-1, 1)) * ring_positions(alpha1, azimuth + side, radius) for share in (begin, 1)]
        for alpha1, begin, side in borders
    )
    corners = [a, b, c, d]
    down = np.array([0, 0, sunk])
    ends = ring_positions(np.zeros((2, gap.sum())), azimuth[gap] + half * np.array([[-0.6], [0.6]]), radius)
    return Ring((np.stack(corners, axis=1) - down)[~gap], layer_deg[~gap, 1], np.swapaxes(ends, 0, 1) - down)


def _borders(values: np.ndarray, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (C,) at both borders of each cell: the mean with the neighbour, or its own where that is a gap."""
    before, after = (np.where(np.roll(gap, k), values, (values + np.roll(values, k)) / 2) for k in (1, -1))
    return before, after
