"""Names of prototypes: each family by hand, in degrees; cell 0 is the aligned direction."""

import numpy as np
import pytest

from spgf_torch.prototypes.naming import mirror_twins, prototype_names, ring_shape

CELLS = 36


def rings(top: tuple[float, float] = (0, 0), bottom: tuple[float, float] = (90, 180)) -> np.ndarray:
    """Both layers the same all around; by default a flat surface: a flat top ring, a bottom ring of gaps."""
    ring = np.zeros((2, CELLS, 2))
    ring[0], ring[1] = top, bottom
    return ring


def test_flat_and_round_surfaces() -> None:
    assert ring_shape(rings()).name == "surface"
    assert ring_shape(rings(top=(15, 25))).name == "surface"  # a sphere bends everywhere alike
    assert ring_shape(rings(top=(-15, 25))).name == "inner surface"


def test_wall_shows_its_other_side() -> None:
    wall = rings(bottom=(10, 175))
    assert ring_shape(wall).name == "wall" and ring_shape(wall).other_side == 1
    wall[1, :18] = 90, 180  # half of the ring is enough, and one cell less is not
    assert ring_shape(wall).name == "wall"
    wall[1, 18] = 90, 180
    assert ring_shape(wall).name == "mixed"


def test_mixed_shows_the_other_side_in_some_cells() -> None:
    """Two of 36 cells are more than a twentieth, one is not; at the foot of a wall they belong."""
    mixed = rings()
    mixed[1, :2] = 10, 175
    assert ring_shape(mixed).name == "mixed"
    mixed[0, np.r_[-5:6]] = -40, 80
    assert ring_shape(mixed).name == "inner edge"
    mixed = rings()
    mixed[1, 0] = 10, 175
    assert ring_shape(mixed).name == "surface"


def test_rim_is_a_wall_that_ends() -> None:
    rim = rings(bottom=(10, 175))
    rim[0, :4] = 90, 90
    shape = ring_shape(rim)
    assert shape.name == "rim" and shape.gap == pytest.approx(4 / 36)
    rim[0, 3] = 0, 0  # 3 of 36 cells are less than a tenth
    assert ring_shape(rim).name == "wall"


def test_edge_bends_to_one_side() -> None:
    """Eleven cells around the aligned direction fall away by a right angle."""
    edge = rings()
    edge[0, np.r_[-5:6]] = 40, 80
    shape = ring_shape(edge)
    assert (shape.name, shape.range_deg, shape.least_deg, shape.alpha1_deg) == ("edge", 80, 0, pytest.approx(40))
    edge[0, np.r_[-5:6], 0] = -40
    assert ring_shape(edge).name == "inner edge"


def test_cap_falls_away_all_around() -> None:
    cap = rings(top=(20, 35))
    cap[0, :10] = 40, 80
    assert ring_shape(cap).name == "cap" and ring_shape(cap).least_deg == 35
    cap[0, 20] = 20, 34
    assert ring_shape(cap).name == "edge"
    cap[0, 20] = 90, 90  # a gap is no direction
    assert ring_shape(cap).name == "cap"


def test_twins_are_mirror_images() -> None:
    """A bend to cells 1 to 4 and one to cells -1 to -4; what is like its own mirror image has no twin."""
    left, right, even = rings(), rings(), rings()
    left[0, 1:5], right[0, -4:] = (30, 60), (30, 60)
    even[0, np.r_[-2:3]] = 30, 60
    assert mirror_twins(np.stack([left, even, right])) == {0: 2, 2: 0}
    right[1] = 10, 175  # another shape altogether: mirrored it stays as far away as half of what it was
    assert mirror_twins(np.stack([left, even, right])) == {}


def test_rings_may_start_anywhere() -> None:
    edge = rings()
    edge[0, np.r_[-5:6]] = 40, 80
    assert {ring_shape(np.roll(edge, k, axis=1)).name for k in range(CELLS)} == {"edge"}


def test_names_carry_their_ids() -> None:
    assert prototype_names(np.stack([rings(), rings(bottom=(10, 175)), rings()])) == [
        "surface 0",
        "wall 1",
        "surface 2",
    ]


def test_a_ring_of_gaps_alone_has_a_name() -> None:
    assert ring_shape(rings(top=(90, 90))).name == "surface"


def test_the_thresholds_are_those_that_the_rule_gives() -> None:
    """In degrees: each is met, and missed by a tenth."""
    assert [ring_shape(rings(top=(a, 0))).gap for a in (60, 59.9)] == [1, 0]
    assert [ring_shape(rings(bottom=(10, a))).other_side for a in (135, 134.9)] == [1, 0]
    assert [ring_shape(rings(top=(a, 0))).name for a in (-5, -4.9)] == ["inner surface", "surface"]


def test_a_ring_that_bends_a_little_to_one_side_is_an_edge() -> None:
    """From -4 on: alpha2 ranges over 30 degrees, or a tenth less."""
    for to, name in ((26, "edge"), (25.9, "surface")):
        ring = rings(top=(0, -4))
        ring[0, 3] = 0, to
        assert ring_shape(ring).name == name


def test_the_neighbours_of_the_bend_tell_concave_from_convex() -> None:
    """The largest alpha2 is in cell 10; its neighbours are cells 7 to 13, of which cell 12 is a gap.

    So alpha1 is the mean of six: (-8 - 7 - 6 - 5 - 4 - 0) / 6 = -5, and what lies around is not asked.
    """
    ring = rings(top=(50, 0))
    ring[0, 7:14, 0] = -8, -7, -6, -5, -4, 70, 0
    ring[0, 10, 1], ring[0, 12, 1] = 20, 90
    assert ring_shape(ring).alpha1_deg == pytest.approx(-5) and ring_shape(ring).name == "inner surface"


@pytest.mark.parametrize(("height", "twins"), [(4.4, {0: 1, 1: 0}), (4.5, {})])
def test_twins_come_to_half_of_their_distance_once_one_is_mirrored(height: float, twins: dict[int, int]) -> None:
    """2 in cell 1, and in cell -1 of the other 4.4: 4.83 apart, mirrored 2.4. With 4.5 4.92 and 2.5, more than half."""
    rings = np.zeros((2, 1, 8, 2))
    rings[0, 0, 1, 1], rings[1, 0, -1, 1] = 2, height
    assert mirror_twins(rings) == twins
