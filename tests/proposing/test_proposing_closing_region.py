"""Where a hand closes, by hand: two jaws, one jaw, two fingers against a thumb, three fingers in a circle; mm below."""

import math

import pytest
import torch
import trimesh

from spgf_torch.affordance.sensed_collision import HandVolume, hand_volume
from spgf_torch.errors import InputError
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.closing_region import ClosingRegion, closing_region

Bounds = tuple[float, float]


def box(x: Bounds, y: Bounds, z: Bounds) -> trimesh.Trimesh:
    """A box from its bounds, mm."""
    return trimesh.creation.box(bounds=[[a / 1000 for a in low] for low in zip(x, y, z, strict=True)])


def turned(mesh: trimesh.Trimesh, deg: float, axis: tuple[float, float, float]) -> trimesh.Trimesh:
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(math.radians(deg), axis))


def check(region: ClosingRegion, **expected: float) -> None:
    got = {name: 1000 * getattr(region, name) for name in ("half", "middle", "height", "low", "high")}
    assert got == pytest.approx(expected, abs=1e-3)


PALM = box((-40, 40), (-50, 50), (-120, -60))
THUMB, NEARER = box((-30, -20), (-8, 8), (-40, 12)), box((-6, -4), (-3, 3), (-60, -20))
FIRST, SECOND = box((26, 36), (23, 37), (-30, 20)), box((28, 38), (-37, -23), (-35, 25))
FINGERS = {"palm": PALM, "thumb tip": THUMB, "thumb": NEARER, "first": FIRST, "second": SECOND}
OPPOSED = ({"thumb tip", "thumb"}, {"first", "second"})


def cylinder(**changes: trimesh.Trimesh) -> HandVolume:
    """Two fingers beside the closing axis against a thumb on it, no two faces alike."""
    shapes = FINGERS | changes
    return hand_volume(list(shapes.values()), list(shapes), OPPOSED, 1)


def circle(*radii: float) -> HandVolume:
    """Fingers that are 10 mm thick and 18 mm broad at 180, 60 and -60 deg, their faces at these distances."""
    shapes = [turned(box((r, r + 10), (-9, 9), (-40, 10 + i)), 180 - 120 * i, (0, 0, 1)) for i, r in enumerate(radii)]
    return hand_volume([*shapes, PALM], ["0", "1", "2", "palm"], ({"0"}, {"1"}, {"2"}), 3)


@pytest.mark.parametrize("side", [-1, 1])
def test_one_jaw_by_hand(side: int) -> None:
    """A fixed face 12 mm to one side of the TCP and the open jaw 30 mm to the other, 8 and 10 mm to either side across;
    a box 5 mm away is beside the axis."""
    fixed = box(*([tuple(sorted((-12.0 * side, -22.0 * side)))]), (-8, 8), (-25, 25))  # type: ignore[arg-type]
    jaw = box(*([tuple(sorted((30.0 * side, 40.0 * side)))]), (-10, 10), (-20, 30))  # type: ignore[arg-type]
    region = closing_region(hand_volume([fixed, jaw, box((5, 15), (20, 40), (-25, 25))]))
    check(region, half=21, middle=9 * side, height=8, low=-20, high=25)
    assert region.pads and region.length == pytest.approx(0.045)
    x = torch.tensor([-11.9, -12.1, 29.9, 30.1]) * side / 1000
    assert region.holds(x, torch.zeros(4), torch.zeros(4)).tolist() == [True, False, True, False]


def test_jaws_that_differ_by_rounding_are_even() -> None:
    """An opening is met to a tolerance: 10 and 10.00005 mm are the nearer one to both sides, as a box about the TCP."""
    sides = [box((-20, -10), (-8, 8), (-9, 9)), box((10.00005, 20), (-8, 8), (-9, 9))]
    check(closing_region(hand_volume(sides)), half=10, middle=0, height=8, low=-9, high=9)
    sides[1] = box((10.3, 20), (-8, 8), (-9, 9))
    check(closing_region(hand_volume(sides)), half=10.15, middle=0.15, height=8, low=-9, high=9)


def test_two_fingers_against_a_thumb_by_hand() -> None:
    """The thumb's face at x = -20, the nearer finger's at 26: the fingers are beside the axis, which they do not meet.
    Across, the thumb reaches 8 mm to either side, the fingers 37; along the approach the thumb from -40 to 12 mm, one
    finger or the other from -35 to 25. What of the thumb lies far behind the TCP is left out."""
    region = closing_region(cylinder())
    check(region, half=23, middle=3, height=8, low=-35, high=12)
    assert not region.pads
    alone = closing_region(hand_volume([PALM, THUMB]))  # without groups all that is on the axis is what there is
    check(alone, half=20, middle=0, height=8, low=-40, high=12)


def test_an_inclined_finger_by_hand() -> None:
    """A bar 10 mm thick turned by 45 deg about y at x = -30: its face is at x = -30 + 5 sqrt(2) - z there, within 10
    mm of the TCP's height -12.93 at the most."""
    bar = turned(box((-5, 5), (-8, 8), (-60, 60)), -45, (0, 1, 0)).apply_translation((-0.03, 0, 0))
    region = closing_region(cylinder(**{"thumb tip": bar}))
    face = 30 - 5 * math.sqrt(2) - 10
    assert [1000 * region.half, 1000 * region.middle] == pytest.approx([(26 + face) / 2, (26 - face) / 2], abs=1e-3)


def test_three_fingers_in_a_circle_by_hand() -> None:
    """The nearest of three faces bounds the box to both sides: a thing in the middle is as far from all."""
    region = closing_region(circle(25, 28, 30))
    check(region, half=25, middle=0, height=9, low=-40, high=10)
    assert not region.pads
    again = closing_region(circle(30, 25, 28))
    check(again, half=25, middle=0, height=9, low=-40, high=10)


def test_fingers_that_end_before_the_tcp() -> None:
    """A thumb that ends 10 mm behind the TCP is measured where it ends."""
    short = box((-30, -22), (-6, 6), (-40, -10))
    shapes = {name: mesh for name, mesh in FINGERS.items() if name != "thumb"} | {"thumb tip": short}
    region = closing_region(hand_volume(list(shapes.values()), list(shapes), ({"thumb tip"}, {"first", "second"})))
    check(region, half=24, middle=2, height=6, low=-35, high=-10)


@pytest.mark.parametrize(
    ("volume", "told"),
    [
        (hand_volume([box((-9, 9), (20, 30), (-5, 5))]), "expected pads on the closing axis"),
        (hand_volume([THUMB], ["thumb"], ({"thumb"}, {"finger"})), "got none of group 2"),
        (hand_volume([FIRST, SECOND], ["1", "2"], ({"1"}, {"2"})), "on different sides of the TCP"),
    ],
    ids=["nothing on the axis", "a group without shapes", "groups on one side"],
)
def test_a_hand_that_closes_on_nothing_is_told(volume: HandVolume, told: str) -> None:
    with pytest.raises(InputError, match=told):
        closing_region(volume)


def test_something_to_close_on_between_any_fingers() -> None:
    """Between jaws 60 mm broad a point 25 mm across counts; between a thumb 8 mm to either side and two fingers one
    14 mm across; along the approach always up to 15 mm."""
    broad = hand_volume([box((-30, -20), (-30, 30), (-40, 40)), box((26, 36), (-30, 30), (-40, 40))])
    clearance = Clearance({"wrap": cylinder(), "grip": broad}, 0.005, 0.015)
    assert clearance.grasp_types == ("grip", "wrap")
    T, types = torch.eye(4).repeat(2, 1, 1), torch.tensor([0, 1])
    for point, closes in (
        ((0.0, 25.0, 0.0), [True, False]),
        ((0.0, 14.0, 0.0), [True, True]),
        ((0.0, 0.0, 16.0), [False, False]),
        ((25.9, 0.0, 0.0), [True, True]),
        ((26.1, 0.0, 0.0), [False, False]),
        ((-20.1, 0.0, 0.0), [False, False]),
    ):
        assert clearance.closes_on_points(torch.tensor([point]) / 1000, T, types).tolist() == closes
    assert clearance.symmetry(torch.tensor([1, 0, 1])).tolist() == [1, 2, 1]
