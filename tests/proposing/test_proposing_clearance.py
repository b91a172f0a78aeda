"""What the open hand would touch, by hand."""

import pytest
import torch
from proposing_models import VOLUMES, two_fingers

from spgf_torch.errors import InputError
from spgf_torch.proposing.clearance import Clearance, Plane, hull_corners

DOWN = torch.diag(torch.tensor([1.0, -1, -1, 1]))  # approach straight down


def at(height: float, T: torch.Tensor = DOWN) -> torch.Tensor:
    T = T.clone()
    T[2, 3] = height
    return T


def test_corners_of_the_hand() -> None:
    """Fingers 10 mm thick and 50 mm apart: their outer faces at x = +-35 mm make the hull."""
    corners = hull_corners(two_fingers(0.05))
    expected = {(x, y, z) for x in (-35, 35) for y in (-10, 10) for z in (-40, 10)}
    assert {tuple(c) for c in (corners * 1000).round().int().tolist()} == expected


def test_a_table_by_hand() -> None:
    """Fingertips reach 10 mm beyond the TCP. Straight down, with 5 mm of clearance above a table at z = 0.1, the TCP
    may be at 115 mm and not at 114; from the side, with the fingers' narrow sides down, 10 mm of half width count."""
    clearance, table = Clearance(VOLUMES, 0.005, 0.015), Plane.of((0, 0, 1), 0.1)
    sideways = torch.tensor([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    T = torch.stack([at(0.1151), at(0.1149), at(0.1151, sideways), at(0.1149, sideways)])
    for kind in (0, 1):
        found = clearance.free_of_plane(table, T, torch.full((4,), kind))
        assert found.tolist() == [True, False, True, False]


def test_each_type_has_its_own_opening() -> None:
    """A point 15 mm beside the TCP is inside a finger of the narrow hand and between those of the wide one."""
    clearance, T = Clearance(VOLUMES, 0.0, 0.015), torch.eye(4).repeat(2, 1, 1)
    free = clearance.free_of_points(torch.tensor([[0.015, 0.0, 0.0]]), T, torch.tensor([0, 1]))
    assert free.tolist() == [False, True]


def test_something_to_close_on() -> None:
    """Between the pads are |x| up to half the opening, and 15 mm across and along the approach."""
    clearance, T, both = Clearance(VOLUMES, 0.0, 0.015), torch.eye(4).repeat(2, 1, 1), torch.tensor([0, 1])
    assert [round(1000 * region.half, 3) for region in clearance.regions] == [10, 25]
    for point, closes in (
        ((0.0, 0.014, -0.014), [True, True]),
        ((0.0, 0.016, 0.0), [False, False]),
        ((0.0, 0.0, 0.016), [False, False]),
        ((0.015, 0.0, 0.0), [False, True]),
    ):
        assert clearance.closes_on_points(torch.tensor([point]), T, both).tolist() == closes
        assert clearance.closes_on_points(torch.tensor([point, (1.0, 1.0, 1.0)]), T, both).tolist() == closes
    assert clearance.closes_on_points(torch.zeros(0, 3), T, both).all()


@pytest.mark.parametrize("normal", [(0, 0, 2), (0, 0, 0), (0, 1), (float("nan"), 0, 1)])
def test_a_plane_without_a_unit_normal_is_refused(normal: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="plane: expected a unit normal"):
        Plane.of(torch.tensor(normal), 0.0)
