"""The moving average and gaps, on values worked out by hand."""

import math

import numpy as np
import pytest

from spgf_torch.ops.moving_average import GAPS, averaged, triangle

RIGHT = math.pi / 2


def average(grid: np.ndarray, half_length: int = 6, gaps: str = "saturated", soft: bool = False) -> np.ndarray:
    found, valid = averaged(grid[None], half_length, gaps, soft)
    assert valid.tolist() == [(grid[:, 0] > 0).any()]
    return found[0]


def ring(values: dict[int, float], cells: int = 36, number: int = 1) -> np.ndarray:
    """A grid (2, 3, cells), alike in both layers and angles: so many neighbours of the same value in some cells."""
    grid = np.zeros((2, 3, cells))
    for cell, value in values.items():
        grid[:, :, cell] = number, number * value, number * value
    return grid


@pytest.mark.parametrize("number", [1, 7])
def test_moving_average_by_hand(number):
    """Values 1 at cell 0 and 0.5 at cell 3, n = 6. At cell 1: weights 6/7 and 5/7: (6 + 2.5) / 11. At cell 5:
    2/7 and 5/7: (2 + 2.5) / 7. Cell 7 hears cell 3 alone, cell 30 cell 0 alone; cells 10 to 29 hear nothing and are
    gaps. However many neighbours a cell has: it counts once."""
    found = average(ring({0: 1.0, 3: 0.5}, number=number))
    assert (
        found[:, [1, 5, 7, 30]].transpose(0, 2, 1).tolist() == [[pytest.approx([8.5 / 11, 4.5 / 7, 0.5, 1.0])] * 2] * 2
    )
    gap = (found == np.array(GAPS["saturated"])[:, None]).all(axis=(0, 2))
    assert gap.nonzero()[0].tolist() == list(range(10, 30))


def test_softly_shared_neighbours_count_each():
    """Three neighbours of 1.0 in cell 0, one of 0.5 in cell 2, n = 2: cell 1 hears them with 2/3 each."""
    grid = ring({0: 1.0}, number=3) + ring({2: 0.5})
    assert average(grid, 2, soft=True)[0, 1].tolist() == pytest.approx([3.5 / 4] * 2)
    assert average(grid, 2)[0, 1].tolist() == pytest.approx([0.75] * 2)


def test_equal_distances_give_the_plain_mean():
    """Fig. 4 (a): a cell between two at distance 2 on either side is the average of the two."""
    assert average(ring({4: 1.0, 8: 1.4}))[0, 6].tolist() == pytest.approx([1.2, 1.2])


def test_no_half_length_is_no_average():
    found = average(ring({0: 1.0, 3: 0.5}), half_length=0)
    assert found[1, [0, 3], 0].tolist() == [1.0, 0.5]
    assert (found[1] == GAPS["saturated"][1]).all(axis=1).sum() == 34


def test_a_filter_longer_than_the_ring_counts_each_cell_once():
    """4 cells, n = 6: by the shorter way round the distances are 0, 1, 2, 1: weights 7, 6, 5, 6 sevenths."""
    ahead, weight = triangle(4, 6)
    assert ahead.tolist() == [0, 1, 2, -1]
    assert (7 * weight).tolist() == pytest.approx([7, 6, 5, 6])


@pytest.mark.parametrize("half_length", [0, 1, 6])
def test_the_filter_comes_by_fours(half_length):
    ahead, weight = triangle(36, half_length)
    assert len(ahead) % 4 == 0
    assert weight.sum() == pytest.approx(half_length + 1)


@pytest.mark.parametrize(
    ("gaps", "values"), [("saturated", [(RIGHT, RIGHT), (RIGHT, math.pi)]), ("flat", [(0, 0), (0, math.pi)])]
)
def test_gaps_are_encoded(gaps, values):
    grid = ring(dict.fromkeys(range(36), 0.25))
    grid[0, :, 3] = grid[1, :, 5] = 0
    found = average(grid, 0, gaps)
    assert found[[0, 1], [3, 5]].tolist() == [pytest.approx(value) for value in values]
    assert (found == 0.25).sum() == 2 * 2 * 36 - 4


def test_perpendicular_by_a_hair_too_much_is_not_above_a_gap():
    assert average(ring({0: math.radians(90.05)}))[0, 0, 1] == RIGHT
