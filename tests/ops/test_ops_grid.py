"""Cells, layers, the moving average and gaps, on values worked out by hand."""

import math

import numpy as np
import pytest
import torch

from spgf_torch.ops.grid import GAPS, Ring, organise, rings, smooth, triangle

RIGHT = math.pi / 2


def one_centre(directions_deg, alpha2_deg, cells=36, alpha1_deg=0.0, soft=False, layers=2):
    """The grid (layers, cells, 3) of one centre: number, sum of alpha1, sum of alpha2."""
    direction, alpha2 = np.deg2rad(directions_deg), np.deg2rad(alpha2_deg)
    grid = np.zeros((layers, cells, 3))
    organise(np.stack([np.full_like(direction, math.radians(alpha1_deg)), alpha2, direction]), soft, grid)
    return grid


@pytest.mark.parametrize(
    ("direction", "cell"), [(0, 0), (4.9, 0), (5.1, 1), (-4.9, 0), (-5.1, 35), (180, 18), (-180, 18), (174, 17)]
)
def test_a_cell_is_centred_on_its_direction(direction, cell):
    assert one_centre([float(direction)], [0.0])[0, :, 0].nonzero()[0].tolist() == [cell]


@pytest.mark.parametrize(("alpha2", "layer"), [(0, 0), (89.9, 0), (90, 0), (90.05, 0), (90.06, 1), (180, 1)])
def test_layers_part_at_a_right_angle_and_perpendicular_is_top(alpha2, layer):
    """The threshold stands SINGULAR = 1e-3 rad = 0.0573 deg beyond 90 deg."""
    assert one_centre([0.0], [float(alpha2)])[:, 0, 0].tolist() == [1 - layer, layer]


def test_a_grid_of_one_layer_leaves_the_other_out():
    grid = one_centre([0.0, 90.0], [30.0, 150.0], layers=1)
    assert grid[0, :, 0].nonzero()[0].tolist() == [0]


def test_a_cell_sums_up_its_neighbours():
    """Three neighbours at alpha1 = -45 deg with alpha2 10, 20, 60 deg."""
    grid = one_centre([10.0, 11.0, 12.0], [10.0, 20.0, 60.0], alpha1_deg=-45)
    assert grid[0, 1, 0] == 3
    assert np.rad2deg(grid[0, 1, 1:]).tolist() == pytest.approx([-135, 90])
    assert grid.astype(bool).sum() == 3


def test_a_neighbour_without_direction_has_no_cell():
    assert not one_centre([math.nan], [30.0]).any()


def test_soft_cells_share_a_neighbour_by_nearness():
    """At 13 deg: 0.7 to the cell at 10 deg and 0.3 to the one at 20; at 355 half to the last and half to the first."""
    assert one_centre([13.0], [40.0], soft=True)[0, :4, 0].tolist() == pytest.approx([0, 0.7, 0.3, 0])
    around = one_centre([-5.0], [40.0], soft=True)
    assert around[0, [0, 35], 0].tolist() == pytest.approx([0.5, 0.5])
    assert around[0, [0, 35], 2].tolist() == pytest.approx([math.radians(20)] * 2)


def smoothed(grid: np.ndarray, half_length: int = 6, gaps: str = "saturated", soft: bool = False) -> np.ndarray:
    found = np.empty((*grid.shape[:2], 2))
    valid = smooth(grid, triangle(grid.shape[1], half_length, torch.float64), np.array(GAPS[gaps]), soft, found)
    assert valid == (grid[..., 0] > 0).any()
    return found


def ring(values: dict[int, float], cells: int = 36, number: int = 1) -> np.ndarray:
    """A grid (2, cells, 3), alike in both layers and angles: so many neighbours of the same value in some cells."""
    grid = np.zeros((2, cells, 3))
    for cell, value in values.items():
        grid[:, cell] = number, number * value, number * value
    return grid


@pytest.mark.parametrize("number", [1, 7])
def test_moving_average_by_hand(number):
    """Values 1 at cell 0 and 0.5 at cell 3, n = 6. At cell 1: weights 6/7 and 5/7: (6 + 2.5) / 11. At cell 5:
    2/7 and 5/7: (2 + 2.5) / 7. Cell 7 hears cell 3 alone, cell 30 cell 0 alone; cells 10 to 29 hear nothing and are
    gaps. However many neighbours a cell has: it counts once."""
    found = smoothed(ring({0: 1.0, 3: 0.5}, number=number))
    assert (
        found[:, [1, 5, 7, 30]].transpose(0, 2, 1).tolist() == [[pytest.approx([8.5 / 11, 4.5 / 7, 0.5, 1.0])] * 2] * 2
    )
    gap = (found == np.array(GAPS["saturated"])[:, None]).all(axis=(0, 2))
    assert gap.nonzero()[0].tolist() == list(range(10, 30))


def test_softly_shared_neighbours_count_each():
    """Three neighbours of 1.0 in cell 0, one of 0.5 in cell 2, n = 2: cell 1 hears them with 2/3 each."""
    grid = ring({0: 1.0}, number=3) + ring({2: 0.5})
    assert smoothed(grid, 2, soft=True)[0, 1].tolist() == pytest.approx([3.5 / 4] * 2)
    assert smoothed(grid, 2)[0, 1].tolist() == pytest.approx([0.75] * 2)


def test_equal_distances_give_the_plain_mean():
    """Fig. 4 (a): a cell between two at distance 2 on either side is the average of the two."""
    assert smoothed(ring({4: 1.0, 8: 1.4}))[0, 6].tolist() == pytest.approx([1.2, 1.2])


def test_no_half_length_is_no_average():
    found = smoothed(ring({0: 1.0, 3: 0.5}), half_length=0)
    assert found[1, [0, 3], 0].tolist() == [1.0, 0.5]
    assert (found[1] == GAPS["saturated"][1]).all(axis=1).sum() == 34


def test_a_filter_longer_than_the_ring_counts_each_cell_once():
    """4 cells, n = 6: by the shorter way round the distances are 0, 1, 2, 1: weights 7, 6, 5, 6 sevenths."""
    ahead, weight = triangle(4, 6, torch.float64)
    assert ahead.tolist() == [0, 1, 2, 3]
    assert (7 * weight).tolist() == pytest.approx([7, 6, 5, 6])


@pytest.mark.parametrize("half_length", [0, 1, 6])
def test_the_filter_comes_by_fours(half_length):
    ahead, weight = triangle(36, half_length, torch.float64)
    assert len(ahead) % 4 == 0
    assert weight.sum() == pytest.approx(half_length + 1)


@pytest.mark.parametrize(
    ("gaps", "values"), [("saturated", [(RIGHT, RIGHT), (RIGHT, math.pi)]), ("flat", [(0, 0), (0, math.pi)])]
)
def test_gaps_are_encoded(gaps, values):
    grid = ring(dict.fromkeys(range(36), 0.25))
    grid[0, 3] = grid[1, 5] = 0
    found = smoothed(grid, 0, gaps)
    assert found[[0, 1], [3, 5]].tolist() == [pytest.approx(value) for value in values]
    assert (found == 0.25).sum() == 2 * 2 * 36 - 4


def test_perpendicular_by_a_hair_too_much_is_not_above_a_gap():
    assert smoothed(one_centre([0.0], [90.05]))[0, 0, 1] == RIGHT


def test_rings_of_several_features_are_those_of_each():
    generator = torch.Generator().manual_seed(0)
    angles = torch.rand((3, 40), generator=generator, dtype=torch.float64) * 3 - 1
    start = torch.tensor([0, 12, 12, 40])
    found, valid = rings(start, angles, Ring(36, 6, 2), "saturated")
    assert valid.tolist() == [True, False, True]
    for feature, (a, b) in enumerate([(0, 12), (12, 12), (12, 40)]):
        grid = np.zeros((2, 36, 3))
        organise(angles[:, a:b].numpy(), False, grid)
        assert np.array_equal(found[feature].numpy(), smoothed(grid))
