"""Rings of prototypes as shapes in space, by hand."""

import numpy as np
import pytest

from spgf_torch.drawing.prototype_rings import ring_positions, rings
from spgf_torch.prototypes.naming import gaps


def test_ring_cells_lie_where_alpha1_says() -> None:
    """Eq. 2: elevation 0 lies in the plane, 90 deg right below the centre, -30 deg above the plane."""
    at = ring_positions(np.radians([0, 90, -30]), np.radians([0, 0, 90]), 0.03)
    assert at == pytest.approx(np.array([[0.03, 0, 0], [0, 0, -0.03], [0, 0.03 * np.sqrt(3) / 2, 0.015]]))


def test_gaps_are_left_out_of_a_ring() -> None:
    prototype = np.zeros((2, 36, 2))
    prototype[0, :6] = 90, 90
    top, bottom = rings(prototype, ~gaps(prototype) * 1.0, 0.03)
    assert len(top.quads) == 30 and len(top.gap_lines) == 6 and len(bottom.quads) == 36
    assert bottom.quads[:, :, 2].max() < top.quads[:, :, 2].min()  # drawn lower, so that both are seen


def test_cells_are_as_wide_as_the_share_that_saw_something() -> None:
    """From the outside in: all 0.5 to 1 of the radius, three quarters of the features 0.625 to 1, under half a gap."""
    seen = np.ones((2, 36))
    seen[0, 10:13], seen[0, 20:22] = 0.75, 0.49
    top, _ = rings(np.zeros((2, 36, 2)), seen, 0.03)
    inner = np.linalg.norm(top.quads[:, 0], axis=1)
    assert inner[[0, 11]] == pytest.approx([0.015, 0.01875]) and len(top.gap_lines) == 2
    assert np.linalg.norm(top.quads[:, 1], axis=1) == pytest.approx(np.full(34, 0.03))
