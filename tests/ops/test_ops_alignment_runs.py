"""The centre of a run of equals, by both implementations: runs of every length, at every place of the ring."""

import math
from collections.abc import Callable

import pytest
import torch

from spgf_torch.ops import alignment

CELLS = 12


def in_loops(rings: torch.Tensor) -> list[int]:
    return alignment.highest_curvature(rings.numpy()).tolist()


def in_torch(rings: torch.Tensor) -> list[int]:
    return alignment.highest_curvature_in_torch(rings).tolist()


def ring(first: int, length: int) -> torch.Tensor:
    """(1, 2, CELLS, 2): the top layer bends most in `length` cells from `first` on."""
    rings = torch.zeros((1, 2, CELLS, 2))
    rings[0, 0, (first + torch.arange(length)) % CELLS, 1] = math.pi / 2
    return rings


@pytest.mark.parametrize("find", [in_loops, in_torch])
def test_a_run_starts_at_its_centre(find: Callable[[torch.Tensor], list[int]]) -> None:
    """Of an even number of cells at the first of the two in the middle."""
    for length in range(1, CELLS):
        for first in range(CELLS):
            assert find(ring(first, length)) == [(first + (length - 1) // 2) % CELLS]


@pytest.mark.parametrize("find", [in_loops, in_torch])
def test_a_ring_of_equals_starts_where_most_follows(find: Callable[[torch.Tensor], list[int]]) -> None:
    """Cells of the bottom layer that fall away at 5 and 6: what is near counts most, so the start is 5."""
    rings = ring(0, CELLS)
    rings[0, 1, 5:7, 0] = 0.5
    assert find(rings) == [5]
