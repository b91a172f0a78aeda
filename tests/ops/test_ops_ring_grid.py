"""Cells and layers, on values worked out by hand."""

import math

import numpy as np
import pytest
import torch

from spgf_torch.ops.moving_average import averaged
from spgf_torch.ops.ring_grid import Ring, organised, rings


def one_centre(directions_deg, alpha2_deg, cells=36, alpha1_deg=0.0, soft=False, layers=2):
    """The grid (2, 3, cells) of one centre: number, sum of alpha1, sum of alpha2."""
    direction, alpha2 = np.deg2rad(directions_deg), np.deg2rad(alpha2_deg)
    angles = np.stack([np.full_like(direction, math.radians(alpha1_deg)), alpha2, direction])
    return organised(np.array([0, len(directions_deg)]), angles, Ring(cells, 0, layers), soft)[0]


@pytest.mark.parametrize(
    ("direction", "cell"), [(0, 0), (4.9, 0), (5.1, 1), (-4.9, 0), (-5.1, 35), (180, 18), (-180, 18), (174, 17)]
)
def test_a_cell_is_centred_on_its_direction(direction, cell):
    assert one_centre([float(direction)], [0.0])[0, 0].nonzero()[0].tolist() == [cell]


@pytest.mark.parametrize(("alpha2", "layer"), [(0, 0), (89.9, 0), (90, 0), (90.05, 0), (90.06, 1), (180, 1)])
def test_layers_part_at_a_right_angle_and_perpendicular_is_top(alpha2, layer):
    """The threshold stands SINGULAR = 1e-3 rad = 0.0573 deg beyond 90 deg."""
    assert one_centre([0.0], [float(alpha2)])[:, 0, 0].tolist() == [1 - layer, layer]


def test_a_grid_of_one_layer_leaves_the_other_out():
    grid = one_centre([0.0, 90.0], [30.0, 150.0], layers=1)
    assert grid[0, 0].nonzero()[0].tolist() == [0] and not grid[1].any()


def test_a_cell_sums_up_its_neighbours():
    """Three neighbours at alpha1 = -45 deg with alpha2 10, 20, 60 deg."""
    grid = one_centre([10.0, 11.0, 12.0], [10.0, 20.0, 60.0], alpha1_deg=-45)
    assert grid[0, 0, 1] == 3
    assert np.rad2deg(grid[0, 1:, 1]).tolist() == pytest.approx([-135, 90])
    assert grid.astype(bool).sum() == 3


def test_a_neighbour_without_direction_has_no_cell():
    assert not one_centre([math.nan], [30.0]).any()


def test_soft_cells_share_a_neighbour_by_nearness():
    """At 13 deg: 0.7 to the cell at 10 deg and 0.3 to the one at 20; at 355 half to the last and half to the first."""
    assert one_centre([13.0], [40.0], soft=True)[0, 0, :4].tolist() == pytest.approx([0, 0.7, 0.3, 0])
    around = one_centre([-5.0], [40.0], soft=True)
    assert around[0, 0, [0, 35]].tolist() == pytest.approx([0.5, 0.5])
    assert around[0, 2, [0, 35]].tolist() == pytest.approx([math.radians(20)] * 2)


def test_rings_of_several_features_are_those_of_each():
    generator = torch.Generator().manual_seed(0)
    angles = (torch.rand((3, 40), generator=generator, dtype=torch.float64) * 3 - 1).numpy()
    ring = Ring(36, 6, 2)
    found, valid = rings(np.array([0, 12, 12, 40]), angles, ring, "saturated")
    assert valid.tolist() == [True, False, True]
    for feature, (a, b) in enumerate([(0, 12), (12, 12), (12, 40)]):
        grid = organised(np.array([0, b - a]), angles[:, a:b], ring)
        assert np.array_equal(found[feature], averaged(grid, 6, "saturated", False)[0][0])
