"""Cells, layers, the moving average and gaps, on values worked out by hand."""

import math

import pytest
import torch

from spgf_torch.features.grid import cell_means, empty_grid, encode_gaps, layer_of, moving_average, shares, triangle

RIGHT = math.pi / 2


def organise(grid: torch.Tensor, *neighbours: object) -> None:
    for share in shares(grid.shape[3], *neighbours):
        share.add_to(grid)


def one_centre(directions_deg, alpha2_deg, cells=36, height=0.0, soft=False):
    """The grid (3, 1, 2, cells) of one centre with neighbours at unit distance in the plane, `height` above it."""
    direction = torch.deg2rad(torch.tensor(directions_deg, dtype=torch.float64))
    local = torch.stack([direction.cos(), direction.sin(), torch.full_like(direction, height)])
    grid = empty_grid(1, cells, like=direction)
    alpha2 = torch.deg2rad(torch.tensor(alpha2_deg, dtype=torch.float64))
    organise(grid, layer_of(alpha2).long(), local, alpha2, soft)
    return grid


@pytest.mark.parametrize(
    ("direction", "cell"), [(0, 0), (4.9, 0), (5.1, 1), (-4.9, 0), (-5.1, 35), (180, 18), (-180, 18), (174, 17)]
)
def test_a_cell_is_centred_on_its_direction(direction, cell):
    assert one_centre([direction], [0.0])[0, 0, 0].nonzero().tolist() == [[cell]]


@pytest.mark.parametrize(("alpha2", "layer"), [(0, 0), (89.9, 0), (90, 0), (90.05, 0), (90.06, 1), (180, 1)])
def test_layers_part_at_a_right_angle_and_perpendicular_is_top(alpha2, layer):
    """The threshold stands SINGULAR = 1e-3 rad = 0.0573 deg beyond 90 deg."""
    assert one_centre([0.0], [alpha2])[0, 0, :, 0].tolist() == [1 - layer, layer]


def test_a_cell_holds_the_mean_of_its_neighbours():
    """Three neighbours 45 deg above the plane (alpha1 = -45 deg) with alpha2 10, 20, 60 deg: mean 30."""
    grid = one_centre([10, 11, 12], [10.0, 20.0, 60.0], height=1.0)
    assert grid[0, 0, 0].tolist() == [0, 3] + [0] * 34
    means, filled = cell_means(grid)
    assert torch.rad2deg(means[:, 0, 0, 1]).tolist() == pytest.approx([-45, 30])
    assert means[..., 2:].abs().sum() == 0
    assert filled.nonzero().tolist() == [[0, 0, 1]]


def test_perpendicular_by_a_hair_too_much_is_not_above_a_gap():
    rings = encode_gaps(*cell_means(one_centre([0.0], [90.05])))
    assert (rings[1, 0, 0] == RIGHT).all()


@pytest.mark.parametrize("local", [(0.0, 0.0, 1.0), (0.0, 0.0, -0.01), (0.0009, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_a_neighbour_along_the_normal_or_at_the_centre_has_no_cell(local):
    grid = empty_grid(1, 36, like=torch.empty(0))
    organise(grid, torch.tensor([0]), torch.tensor(local)[:, None], torch.tensor([0.5]))
    assert not grid.any()


def test_soft_cells_share_a_neighbour_by_nearness():
    """At 13 deg: 0.7 to the cell at 10 deg and 0.3 to the one at 20; at 355 half to the last and half to the first."""
    assert one_centre([13.0], [40.0], soft=True)[0, 0, 0, :4].tolist() == pytest.approx([0, 0.7, 0.3, 0])
    around = one_centre([355.0], [40.0], soft=True)
    assert around[0, 0, 0, [0, 35]].tolist() == pytest.approx([0.5, 0.5])
    assert around[2, 0, 0, [0, 35]].tolist() == pytest.approx([math.radians(20)] * 2)


def ring(values: dict[int, float], cells: int = 36) -> tuple[torch.Tensor, torch.Tensor]:
    """Means (2, 1, 2, cells), alike in both layers and angles, and the weight (1, 2, cells) of filled cells."""
    means, weight = torch.zeros((2, 1, 2, cells)), torch.zeros((1, 2, cells))
    for cell, value in values.items():
        means[..., cell], weight[..., cell] = value, 1
    return means, weight


def test_moving_average_by_hand():
    """Values 1 at cell 0 and 0.5 at cell 3, n = 6. At cell 1: weights 6/7 and 5/7: (6 + 2.5) / 11. At cell 5:
    2/7 and 5/7: (2 + 2.5) / 7. Cell 7 hears cell 3 alone, cell 30 cell 0 alone; cells 10 to 29 hear nothing."""
    averaged, filled = moving_average(*ring({0: 1.0, 3: 0.5}), half_length=6)
    got = averaged[0, 0, 0]
    assert got[[1, 5, 7, 30]].tolist() == pytest.approx([8.5 / 11, 4.5 / 7, 0.5, 1.0])
    assert (~filled[0, 0]).nonzero().flatten().tolist() == list(range(10, 30))
    assert torch.allclose(averaged, got.expand_as(averaged))


def test_equal_distances_give_the_plain_mean():
    """Fig. 4 (a): a cell between two at distance 2 on either side is the average of the two."""
    averaged, _ = moving_average(*ring({4: 1.0, 8: 2.0}), half_length=6)
    assert averaged[0, 0, 0, 6].item() == pytest.approx(1.5)


def test_no_half_length_is_no_average():
    means, weight = ring({0: 1.0, 3: 0.5})
    averaged, filled = moving_average(means, weight, half_length=0)
    assert torch.equal(averaged, means)
    assert torch.equal(filled, weight > 0)


def test_a_filter_longer_than_the_ring_counts_each_cell_once():
    """4 cells, n = 6: by the shorter way round the distances are 0, 1, 2, 1: weights 7, 6, 5, 6 sevenths."""
    kernel = triangle(4, 6, like=torch.empty(0, dtype=torch.float64))
    assert (7 * kernel[0]).tolist() == pytest.approx([7, 6, 5, 6])
    assert torch.equal(kernel, kernel.T)


def test_gaps_saturate():
    filled = torch.ones((1, 2, 36), dtype=torch.bool)
    filled[0, 0, 3] = filled[0, 1, 5] = False
    rings = encode_gaps(torch.full((2, 1, 2, 36), 0.25), filled)
    assert rings[:, 0, 0, 3].tolist() == pytest.approx([RIGHT, RIGHT])
    assert rings[:, 0, 1, 5].tolist() == pytest.approx([RIGHT, math.pi])
    assert (rings == 0.25).sum() == 2 * 2 * 36 - 4
    flat = encode_gaps(torch.full((2, 1, 2, 36), 0.25), filled, "flat")
    assert [flat[:, 0, 0, 3].tolist(), flat[:, 0, 1, 5].tolist()] == [[0, 0], pytest.approx([0, math.pi])]
