"""No border between the fingers: one point and one hand, by hand."""

import pytest
import torch

from spgf_torch.proposing.borders import Borders, clear_of_borders
from spgf_torch.proposing.closing_region import ClosingRegion

REGION = ClosingRegion(0.03, 0.01, -0.01, 0.01)
FAR = torch.tensor([[0.0, 0.0, 0.004]])  # a texlet at the TCP that is on no border


def clear(point: tuple[float, float, float], beyond: tuple[float, float, float]) -> bool:
    borders = Borders(torch.tensor([point]), torch.tensor([beyond]), FAR)
    return bool(clear_of_borders(borders, torch.eye(4)[None], torch.zeros(1, dtype=torch.int64), [REGION]))


@pytest.mark.parametrize(
    ("point", "beyond", "free"),
    [
        ((0.02, 0.0, 0.0), (1.0, 0.0, 0.0), False),  # what a pad would meet
        ((0.0, 0.0, -0.04), (0.0, 0.0, -1.0), False),  # passed on the way
        ((0.0, 0.014, 0.0), (0.0, 1.0, 0.0), False),  # beside the pads
        ((0.0, 0.0, 0.005), (0.0, 0.0, 1.0), True),  # ahead: the hand does not reach it
        ((0.0, 0.0, -0.02), (0.0, 0.0, 1.0), False),  # passed already
        ((0.0, 0.0, 0.005), (0.0, 0.8, 0.6), True),  # 53 deg off the approach: ahead still
        ((0.0, 0.0, 0.005), (0.0, 0.9, 0.44), False),  # 64 deg: beside
        ((0.0, 0.0, 0.005), (0.0, 0.0, 0.0), False),  # nobody has looked beyond
        ((0.04, 0.0, 0.0), (1.0, 0.0, 0.0), True),  # outside of the finger
        ((0.0, 0.02, 0.0), (0.0, 1.0, 0.0), True),
        ((0.0, 0.0, -0.06), (0.0, 0.0, -1.0), True),  # behind the fingers
    ],
)
def test_a_border_between_the_fingers(
    point: tuple[float, float, float], beyond: tuple[float, float, float], free: bool
) -> None:
    assert clear(point, beyond) == free


def test_a_hand_whose_nearest_texlet_is_at_the_end_of_the_image() -> None:
    """0.05 m from the nearest texlet, on none between the fingers: refused only where nobody has looked beyond."""
    at = torch.tensor([[0.05, 0.0, 0.0]])
    for beyond, free in (((0.0, 0.0, 0.0), False), ((1.0, 0.0, 0.0), True)):
        borders = Borders(at, torch.tensor([beyond]), torch.tensor([[0.0, 0.0, 0.2]]))
        assert bool(clear_of_borders(borders, torch.eye(4)[None], torch.zeros(1).long(), [REGION])) == free


def test_no_borders_leave_all() -> None:
    assert Borders.of(torch.zeros(3, 3), None) is None
    assert Borders.of(torch.zeros(3, 3), torch.full((3, 3), torch.nan)) is None
    assert clear_of_borders(None, torch.eye(4).repeat(5, 1, 1), torch.zeros(5).long(), [REGION]).all()
