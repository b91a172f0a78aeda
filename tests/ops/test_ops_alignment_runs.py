"""The centre of a run of equals, by both implementations: runs of every length, at every place of the ring."""

import math

import pytest
import torch

from spgf_torch.ops.alignment import highest_curvature, highest_curvature_in_torch

CELLS = 12


def ring(first: int, length: int) -> torch.Tensor:
    """(1, 2, CELLS, 2): the top layer bends most in `length` cells from `first` on."""
    rings = torch.zeros((1, 2, CELLS, 2))
    rings[0, 0, (first + torch.arange(length)) % CELLS, 1] = math.pi / 2
    return rings


@pytest.mark.parametrize("find", [highest_curvature, highest_curvature_in_torch])
def test_a_run_starts_at_its_centre(find) -> None:
    """Of an even number of cells at the first of the two in the middle."""
    for length in range(1, CELLS):
        for first in range(CELLS):
            assert find(ring(first, length)).tolist() == [(first + (length - 1) // 2) % CELLS]


@pytest.mark.parametrize("find", [highest_curvature, highest_curvature_in_torch])
def test_a_ring_of_equals_starts_where_most_follows(find) -> None:
    """Cells of the bottom layer that fall away at 5 and 6: what is near counts most, so the start is 5."""
    rings = ring(0, CELLS)
    rings[0, 1, 5:7, 0] = 0.5
    assert find(rings).tolist() == [5]
