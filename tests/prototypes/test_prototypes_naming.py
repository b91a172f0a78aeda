"""Names of prototypes: each family by hand, in degrees; cell 0 is the aligned direction."""

import numpy as np
import pytest

from spgf_torch.prototypes.naming import prototype_names, ring_shape

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
    wall[1, :27] = 90, 180  # a quarter of the ring is enough, and one cell less is not
    assert ring_shape(wall).name == "wall"
    wall[1, 27] = 90, 180
    assert ring_shape(wall).name == "surface"


def test_rim_is_a_wall_that_ends() -> None:
    rim = rings(bottom=(10, 175))
    rim[0, :6] = 90, 90
    shape = ring_shape(rim)
    assert shape.name == "rim" and shape.gap == pytest.approx(6 / 36) and shape.bottom == 1


def test_edge_bends_to_one_side() -> None:
    """Eleven cells around the aligned direction fall away by a right angle: 11 / 36 of the ring bends."""
    edge = rings()
    edge[0, np.r_[-5:6]] = 40, 80
    shape = ring_shape(edge)
    assert (shape.name, shape.range_deg, shape.bend) == ("edge", 80, pytest.approx(11 / 36))
    edge[0, np.r_[-5:6], 0] = -40
    assert ring_shape(edge).name == "inner edge"


def test_corner_bends_in_more_than_220_degrees() -> None:
    corner = rings()
    corner[0, :22] = 40, 60
    assert ring_shape(corner).name == "edge"  # 220 deg
    corner[0, 22] = 40, 60
    assert ring_shape(corner).name == "corner"  # 230 deg


def test_a_side_face_in_the_bottom_ring_bends_too() -> None:
    corner = rings()
    corner[1, :23] = 40, 95
    assert ring_shape(corner).bend == pytest.approx(23 / 36) and ring_shape(corner).name == "corner"


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
    assert [ring_shape(rings(top=(0, a))).bend for a in (30, 29.9)] == [1, 0]
    assert [ring_shape(rings(bottom=(10, a))).bend for a in (119.9, 120)] == [1, 0]
    assert [ring_shape(rings(bottom=(10, a))).other_side for a in (135, 134.9)] == [1, 0]
    assert [ring_shape(rings(top=(a, 0))).name for a in (-5, -4.9)] == ["inner surface", "surface"]


def test_a_ring_that_bends_a_little_to_one_side_is_an_edge() -> None:
    """From -4 on: alpha2 ranges over 30 degrees, or a tenth less, and no cell bends by itself."""
    for to, name in ((26, "edge"), (25.9, "surface")):
        ring = rings(top=(0, -4))
        ring[0, 3] = 0, to
        assert ring_shape(ring).name == name and ring_shape(ring).bend == 0


def test_a_rim_has_its_other_side_in_half_of_the_ring() -> None:
    """One gap in the top ring, the bottom ring open in 18 cells of 36, or in 19."""
    rim = rings(bottom=(10, 175))
    rim[0, 0] = 90, 90
    rim[1, :18] = 90, 180
    assert ring_shape(rim).name == "rim"
    rim[1, 18] = 90, 180
    assert ring_shape(rim).name == "wall"


def test_the_neighbours_of_the_bend_tell_concave_from_convex() -> None:
    """The largest alpha2 is in cell 10; its neighbours are cells 7 to 13, of which cell 12 is a gap.

    So alpha1 is the mean of six: (-8 - 7 - 6 - 5 - 4 - 0) / 6 = -5, and what lies around is not asked.
    """
    ring = rings(top=(50, 0))
    ring[0, 7:14, 0] = -8, -7, -6, -5, -4, 70, 0
    ring[0, 10, 1], ring[0, 12, 1] = 20, 90
    assert ring_shape(ring).alpha1_deg == pytest.approx(-5) and ring_shape(ring).name == "inner surface"
