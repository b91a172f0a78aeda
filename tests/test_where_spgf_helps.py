"""The pure functions behind tests/benchmarks/where_spgf_helps.py, on values derived by hand."""

import math
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import torch

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))

from shared import at_pads, hidden, paired

from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView

SIDE = 0.1  # m of a cube whose front face lies at z = 0 and that reaches to z = 0.1
CUBE = np.array([[SIDE * (x - 0.5), SIDE * (y - 0.5), SIDE * z] for x, y, z in product((0, 1), repeat=3)])


def front() -> DepthView:
    """A camera 1 m before the middle of the cube's front face, looking at it: 41 x 41 pixels of 5 mm."""
    K = torch.tensor([[200.0, 0, 20], [0, 200, 20], [0, 0, 1]])
    at = 0.005 * (torch.arange(41) - 20)
    on = (at.abs()[:, None] <= SIDE / 2) & (at.abs()[None] <= SIDE / 2)
    depth = torch.where(on, 1.0, torch.inf)
    return DepthView(depth, K, torch.eye(3), torch.tensor([0.0, 0, -1]))


def test_points_behind_a_cubes_face_are_solid_as_deep_as_the_cube():
    points = torch.tensor([[0, 0, 0.03], [0.01, 0.02, 0.07], [0, 0, 0.12], [0.2, 0, 0.03]])
    depth, hit = hidden.in_front(points[:3], [front()])
    torch.testing.assert_close(depth, torch.tensor([0.03, 0.07, 0.12]))
    torch.testing.assert_close(hit[0], torch.zeros(3))
    torch.testing.assert_close(hit[1], torch.tensor([0.01, 0.02, 0]) / 1.07)  # on the ray, where it meets z = 0
    assert hidden.inside(points, hidden.pieces_of([CUBE])).tolist() == [True, True, False, False]


def test_the_least_depth_of_several_views_counts():
    behind = DepthView(torch.full((41, 41), 1.0), front().K, torch.diag(torch.tensor([1.0, -1, -1])), torch.zeros(3))
    behind = DepthView(behind.depth, behind.K, behind.rotation, torch.tensor([0, 0, 1 + SIDE]))
    depth, hit = hidden.in_front(torch.tensor([[0, 0, 0.03], [0, 0, 0.09]]), [front(), behind])
    torch.testing.assert_close(depth, torch.tensor([0.03, 0.01]))
    torch.testing.assert_close(hit[:, 2], torch.tensor([0.0, SIDE]))


@pytest.mark.parametrize(
    ("depth", "offset", "views", "level", "side"),
    [
        (0.012, (0.001, 0, -0.012), 1, 1, 0),  # straight behind
        (0.03, (0.03, 0.01, -0.01), 1, 4, 1),  # towards the highest curvature; an edge of cells is in the deeper one
        (0.03, (-0.03, 0.01, -0.01), 4, 4, 2),  # away from it
        (0.5, (0.0, -0.03, -0.01), 4, 9, 3),  # across
    ],
)
def test_cells_tell_depth_side_and_whether_one_view_is_all(depth, offset, views, level, side):
    cell = hidden.cell_of(torch.tensor([depth]), torch.tensor([offset]), views)
    assert cell.item() == (level * hidden.SIDES + side) * 2 + (views > 1)
    told = hidden.without_frames(cell).item()
    assert told == (level * hidden.SIDES + min(side, 1)) * 2 + (views > 1)


def test_a_profile_is_the_share_of_solid_points_drawn_to_that_of_all():
    cell = torch.full((200,), 5)
    kind = torch.arange(200) // 100  # 100 points behind texlets of a cube, 100 behind those of a sheet
    table = hidden.profile(hidden.counted(kind, cell, kind == 0, 2))
    assert table[0, 5].item() == pytest.approx((100 + 50 * 0.5) / 150)
    assert table[1, 5].item() == pytest.approx(50 * 0.5 / 150)
    assert table[:, 6].tolist() == [0.5, 0.5]  # nothing known


def test_occupancy_of_fingers_palm_and_sweep():
    part = torch.tensor([hidden.LEFT, hidden.LEFT, hidden.RIGHT, hidden.PALM, hidden.SWEEP, hidden.LEFT])
    row = torch.tensor([0, 0, 0, 0, 0, 1])
    its = hidden.Hidden(row, part, row, row, row.bool(), torch.tensor([[4.0, 4, 2, 10]] * 2))
    found = hidden.occupancy(its, torch.tensor([1.0, 0.6, 0.4, 0.5, 1.0, 0.8]))
    torch.testing.assert_close(found[0], torch.tensor([2.0 / 8, 1.6 / 4, 1.0, 0.5 / 2, 0.5, 1.0 / 10]))
    torch.testing.assert_close(found[1], torch.tensor([0.8 / 8, 0.8 / 4, 0.8, 0, 0, 0]))


def test_rates_never_tell_an_object_of_its_own_trials():
    kind, obj = torch.tensor([0, 0, 0, 1]), torch.tensor([0, 0, 1, 1])
    rates = at_pads.Rates(kind, obj, torch.tensor([True, True, False, True]), 2, 3)
    every = (1 + 1) / (2 + 2)  # of object 1: one of two held
    assert rates.of(torch.tensor([0, 1]), 0).tolist() == pytest.approx([20 * every / 21, (1 + 20 * every) / 21])
    every = (3 + 1) / (4 + 2)
    assert rates.of(torch.tensor([0]), 2).item() == pytest.approx((2 + 20 * every) / 23)


def test_a_ball_bends_alike_everywhere():
    angle = torch.arange(400) * math.pi * (3 - math.sqrt(5))
    z = 1 - 2 * (torch.arange(400) + 0.5) / 400
    normals = torch.stack([(1 - z**2).sqrt() * angle.cos(), (1 - z**2).sqrt() * angle.sin(), z], dim=1)
    bends = at_pads.curvature(Texlets(0.04 * normals, normals))
    torch.testing.assert_close(bends[:, :3], torch.full((400, 3), 25.0), rtol=0.01, atol=0.0)
    assert not bends[:, 3].any()


def test_kinds_of_curvature_part_what_bends_differently():
    flat, round_ = torch.rand(2, 100, 5, generator=torch.Generator().manual_seed(0)).add(
        torch.tensor([0, 40.0])[:, None, None]
    )
    bends = at_pads.Bends.of(torch.cat([flat, round_]), seed=0)
    assert not set(bends.kind(flat).tolist()) & set(bends.kind(round_).tolist())
    assert bends.kind(flat).max() < at_pads.KINDS


def test_shares_and_pairs_of_prototypes():
    place = torch.tensor([at_pads.LOW, at_pads.LOW, at_pads.HIGH, at_pads.BETWEEN])
    met = at_pads.Met(torch.zeros(4, dtype=torch.int64), torch.arange(4), place, 2)
    prototype = torch.tensor([2, 2, 1, 0])
    assert met.shares(prototype, 3).tolist() == [
        [0, pytest.approx(1 / 3), pytest.approx(2 / 3), 0.25, 0.25, 0.5],
        [0] * 6,
    ]
    assert met.pair(prototype, 3).tolist() == [1 * 4 + 2, 3 * 4 + 3]  # the second hand meets nothing


def test_scores_by_object_and_their_paired_interval():
    p, held = np.array([0.9, 0.2, 0.5, 0.5]), np.array([True, False, True, False])
    found = paired.scores(p, held, np.array([0, 0, 1, 1]), np.array([0, 0, 0, 1]), 1)
    assert found["log_loss"] == pytest.approx([-(math.log(0.9) + math.log(0.8)) / 2, math.log(2)])
    assert found["brier"] == pytest.approx([(0.01 + 0.04) / 2, 0.25])
    assert found["auc"] == pytest.approx([1.0, 0.5]) and found["top"].tolist() == [1.0, 0.5]
    assert paired.interval(np.array([1.0, 1.0, np.nan])) == (1.0, 1.0, 1.0)
