"""What a hand keeps clear of: obstacles with a margin, the table on the whole way, and the way from below."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from spgf_torch.affordance.sensed_collision import hand_volume
from spgf_torch.proposing.clearance import Clearance, Plane, Surroundings

CUBE = hand_volume([trimesh.creation.box([0.02, 0.02, 0.02])])  # 1 cm to each side of the TCP
CLEAR = Clearance({"NPG": CUBE, "WPG": CUBE}, 0.0, 0.015, 0.004)
ONE = torch.zeros(1, dtype=torch.int64)


def pose(approach: tuple[float, float, float], place: tuple[float, float, float] = (0, 0, 0)) -> torch.Tensor:
    """(1, 4, 4) with z of the TCP along the approach."""
    z = np.array(approach) / np.linalg.norm(approach)
    x = np.cross(z, [0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), place
    return torch.from_numpy(T).float()[None]


@pytest.mark.parametrize(("away", "free"), [(0.009, False), (0.0135, False), (0.0145, True)])
def test_obstacles_are_kept_clear_of_by_the_margin(away: float, free: bool) -> None:
    """The cube ends at 10 mm, the margin at 14: by the face, and no farther at the corner of two faces."""
    for direction in ([1.0, 0, 0], [0, -1.0, 0], [0, 0, 1.0]):
        point = away * torch.tensor([direction])
        assert bool(CLEAR.free_of_obstacles(point, pose((0, 0, 1)), ONE)) == free
        assert bool(CLEAR.free_of_points(point, pose((0, 0, 1)), ONE)) == (away > 0.01)
    assert bool(CLEAR.free_of_obstacles(torch.zeros(0, 3), pose((0, 0, 1)), ONE))


@pytest.mark.parametrize(
    ("approach", "height", "free"),
    [
        ((0, 0, -1), 0.011, True),  # from above: the way lies above the grasp
        ((0, 0, -1), 0.009, False),
        ((1, 0, 0), 0.011, True),  # level
        ((0, 0, 1), 0.05, False),  # from below: 10 cm back the hand is under the table
        ((0, 0, 1), 0.111, True),
    ],
)
def test_the_hand_is_above_the_table_on_its_whole_way(
    approach: tuple[float, float, float], height: float, free: bool
) -> None:
    table = Plane.of((0, 0, 1), 0.0)
    assert bool(CLEAR.free_of_plane(table, pose(approach, (0, 0, height)), ONE, retreat=0.1)) == free


def test_from_below_is_by_the_approach() -> None:
    around = Surroundings(up=(torch.tensor([0.0, 0, 1]), float(np.sin(np.deg2rad(10)))))
    for angle, below in ((-90, False), (0, False), (9, False), (11, True), (90, True)):
        rise = np.deg2rad(angle)
        assert bool(around.from_below(pose((np.cos(rise), 0, np.sin(rise))))) == below
    assert not Surroundings().from_below(pose((0, 0, 1))).any()


def test_obstacles_out_of_reach_are_let_go() -> None:
    around = Surroundings(torch.tensor([[0.1, 0, 0], [0.35, 0, 0], [-0.21, 0, 0]]))
    assert around.near(torch.tensor([[0.0, 0, 0], [0.1, 0, 0]]), 0.2).obstacles[:, 0].tolist() == pytest.approx([0.1])
    assert len(around.near(torch.tensor([[0.0, 0, 0], [0.2, 0, 0]]), 0.22).obstacles) == 3


def test_one_obstacle_a_cell() -> None:
    points = torch.tensor([[0.001, 0, 0], [0.002, 0, 0], [0.009, 0, 0], [-0.001, 0, 0]])
    sparse = Surroundings(points).sparse(0.008)
    assert sorted(sparse[:, 0].tolist()) == pytest.approx([-0.001, 0.001, 0.009])


@pytest.mark.parametrize(
    ("point", "there", "on_way"),
    [
        ((0, 0, -0.105), True, False),  # the cube reaches to 110 mm behind the TCP when it sets out
        ((0.009, -0.009, -0.05), True, False),
        ((0.011, 0, -0.05), True, True),
        ((0, 0, -0.112), True, True),
        ((0, 0, 0.011), True, True),
        ((0, 0, 0.009), False, False),
    ],
)
def test_all_that_the_hand_sweeps_on_its_way_keeps_clear(point: tuple, there: bool, on_way: bool) -> None:
    swept, T = replace(CLEAR, obstacle_clearance=0.0, way=0.1), pose((1, 0, 0))
    at = torch.tensor([point], dtype=torch.float32) @ T[0, :3, :3].T
    assert bool(CLEAR.free_of_points(at, T, ONE)) == there
    for test in (swept.free_of_points, swept.free_of_obstacles, replace(swept, unseen_on_way=True).free_of_hidden):
        assert bool(test(at, T, ONE)) == on_way
    assert bool(swept.free_of_hidden(at, T, ONE)) == there


def test_a_wedge_sweeps_its_hull_alone() -> None:
    """A roof that rises from z = 0 at x = 0 to z = 10 mm at x = 20 mm, 10 mm back: above the slope nothing is swept."""
    corners = np.array([[x, y, z] for y in (-0.01, 0.01) for x, z in ((0, 0), (0.02, 0), (0.02, 0.01))])
    wedge = Clearance({"NPG": hand_volume([trimesh.Trimesh(corners).convex_hull])}, 0.0, 0.015, way=0.01)
    for x, z, free in [(0.01, 0.004, False), (0.01, 0.006, True), (0.01, -0.009, False), (0.01, -0.011, True)]:
        assert bool(wedge.free_of_points(torch.tensor([[x, 0, z]]), torch.eye(4)[None], ONE)) == free
    far = max(np.linalg.norm([0.02, 0.01, 0.01]), np.linalg.norm([0.02, 0.01, -0.01]))
    assert wedge.reach == pytest.approx(far, abs=1e-6)


def test_places_of_failures_and_what_is_given_up_for_lack_of_others() -> None:
    up = (torch.tensor([0.0, 0, 1]), 0.1)
    around = Surroundings(failed=torch.tensor([[0.1, 0, 0], [0, 0.2, 0]]), failed_radius=0.03, up=up)
    places = torch.tensor([[0.129, 0, 0], [0.131, 0, 0], [0, 0.2, 0.029]])
    assert around.failed_at(places).tolist() == [True, False, True]
    assert not Surroundings().failed_at(places).any()
    assert [(len(each.failed), each.up is not None) for each in around.relaxed()] == [(2, True), (0, True), (0, False)]
    assert len(list(Surroundings().relaxed())) == 1
