"""Sections, profiles and handles: sizes and volumes derived by hand, pieces that tile what the surface encloses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from spgf_torch.objects.library import mesh_of
from spgf_torch.objects.lofts import (
    SEGMENTS,
    Handle,
    Solid,
    bent_of,
    convex_stretches,
    inner_profile,
    loft,
    oval_section,
    rectangle_section,
    round_section,
    shell_of,
    solid_of,
)

TAN = np.tan(np.pi / SEGMENTS)


def parts_volume(solid: Solid) -> float:
    return sum(ConvexHull(part).volume for part in solid.parts)


def assert_tiled(solid: Solid) -> None:
    """A closed surface in one piece, and hulls that together have its volume and lie on or inside it."""
    mesh = mesh_of(solid)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
    assert mesh.volume == pytest.approx(parts_volume(solid), rel=1e-9)
    corners = np.concatenate(solid.parts)
    np.testing.assert_allclose(corners.min(axis=0), mesh.bounds[0], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), mesh.bounds[1], atol=1e-9)


def test_round_section_has_its_facets_at_the_radius() -> None:
    """s is the distance of the facets, so that the corners stand at s / cos(pi / n); facet 0 faces +x."""
    ring = round_section().ring(0.04, 0.1)
    np.testing.assert_allclose(np.linalg.norm(ring[:, :2], axis=1), 0.04 / np.cos(np.pi / SEGMENTS))
    np.testing.assert_allclose(ring[[-1, 0], 0], 0.04)
    np.testing.assert_allclose(ring[:, 2], 0.1)


def test_oval_section_has_its_width_and_depth() -> None:
    ring = oval_section(0.5).ring(0.04, 0.0)
    np.testing.assert_allclose(np.ptp(ring, axis=0), [0.08, 0.04, 0.0], atol=1e-12)


def test_rectangle_grows_by_s_on_every_side() -> None:
    """A 60 x 40 mm rectangle grown by 5 mm is 70 x 50 mm; its rounded corners stay on the same sides."""
    for corner in (0.0, 0.01):
        ring = rectangle_section(0.06, 0.04, corner).ring(0.005, 0.0)
        np.testing.assert_allclose(np.ptp(ring, axis=0), [0.07, 0.05, 0.0], atol=1e-12)
    sharp = rectangle_section(0.06, 0.04, 0.0).ring(0.0, 0.0)[:, :2]
    assert {tuple(corner) for corner in np.round(sharp, 9)} == {(x, y) for x in (-0.03, 0.03) for y in (-0.02, 0.02)}


def test_frustum_volume() -> None:
    """An n-gon with facets at s has the area n s^2 tan(pi/n); a frustum has h/3 (A1 + A2 + sqrt(A1 A2))."""
    solid = solid_of(round_section(), np.array([[0.03, 0.0], [0.05, 0.08]]))
    area = SEGMENTS * TAN * np.array([0.03, 0.05]) ** 2
    assert mesh_of(solid).volume == pytest.approx(0.08 / 3 * (area.sum() + np.sqrt(area.prod())))
    assert len(solid.parts) == 1


def test_profile_that_starts_on_the_axis_closes_to_a_point() -> None:
    """A double cone of radius s and height h has a third of the prism's volume."""
    solid = solid_of(round_section(), np.array([[0.0, 0.0], [0.03, 0.05], [0.0, 0.1]]))
    assert mesh_of(solid).volume == pytest.approx(SEGMENTS * TAN * 0.03**2 * 0.1 / 3)
    assert mesh_of(solid).is_watertight


def test_stretches_are_cut_where_the_profile_turns_inwards() -> None:
    """A bottle: bulging body and shoulder, then the neck, where the line from the shoulder turns upwards again."""
    bottle = np.array([[0.03, 0.0], [0.033, 0.01], [0.033, 0.13], [0.014, 0.19], [0.014, 0.21]])
    body, neck = convex_stretches(bottle)
    np.testing.assert_array_equal(body, bottle[:4])
    np.testing.assert_array_equal(neck, bottle[3:])


@pytest.mark.parametrize("aspect", [1.0, 0.6])
def test_waisted_solid_is_tiled(aspect: float) -> None:
    chain = np.array([[0.03, 0], [0.04, 0.02], [0.025, 0.06], [0.035, 0.1], [0.02, 0.1], [0.022, 0.13], [0.0, 0.14]])
    solid = solid_of(oval_section(aspect), chain)
    assert len(solid.parts) == 3
    assert_tiled(solid)


def test_inner_profile_keeps_the_wall() -> None:
    """Each inner stretch is parallel to the outer one, `wall` away; it starts on the floor and ends at the rim."""
    outer = np.array([[0.03, 0.0], [0.05, 0.03], [0.045, 0.08], [0.06, 0.12]])
    inner = inner_profile(outer, 0.004, 0.006)
    assert inner[0, 1] == pytest.approx(0.006) and inner[-1, 1] == pytest.approx(0.12)
    for i in range(3):
        along = (outer[i + 1] - outer[i]) / np.linalg.norm(outer[i + 1] - outer[i])
        for gap in outer[i : i + 2] - inner[i : i + 2]:
            assert gap[0] * along[1] - gap[1] * along[0] == pytest.approx(0.004)


@pytest.mark.parametrize("section", [round_section(), rectangle_section(0.02, 0.03, 0.0)])
def test_shell_is_tiled_by_its_floor_and_wall_pieces(section) -> None:
    """Volume: outer frusta less the cavity, each the loft of its own profile."""
    outer = np.array([[0.03, 0.0], [0.05, 0.03], [0.045, 0.08], [0.06, 0.12]])
    shell = shell_of(section, outer, 0.003, 0.004)
    assert len(shell.parts) == 1 + 3 * len(section.corners)
    assert_tiled(shell)
    cavity = mesh_of(Solid(loft(section, inner_profile(outer, 0.003, 0.004)), ()))
    filled = mesh_of(Solid(loft(section, outer), ()))
    assert mesh_of(shell).volume == pytest.approx(filled.volume - cavity.volume)


def test_mug_handle_is_a_loop_that_tiles() -> None:
    """One hole (Euler number 0), on a straight and on a conical wall; the bar is as wide as the wall's facet."""
    for top in (0.04, 0.045):
        outer = np.array([[0.035, 0.0], [0.04, 0.01], [top, 0.09]])
        mug = shell_of(round_section(), outer, 0.004, 0.005, Handle(0.02, 0.08, 0.03, 0.008, True))
        assert_tiled(mug)
        mesh = mesh_of(mug)
        assert mesh.euler_number == 0
        middle = np.interp(0.05, outer[:, 1], outer[:, 0])
        assert mesh.bounds[1, 0] == pytest.approx(middle + 0.03)
        bar = mesh.vertices[mesh.vertices[:, 0] > top + 0.02]
        assert 2 * TAN * 0.04 <= np.ptp(bar[:, 1]) <= 2 * TAN * top + 1e-12


def test_pan_stick_adds_its_bar() -> None:
    """The bar of a cylinder of radius s: a facet 2 s tan(pi/n) wide, 15 mm high, 100 mm long; no hole."""
    outer = np.array([[0.06, 0.0], [0.06, 0.08]])
    plain = shell_of(round_section(), outer, 0.002, 0.003)
    pan = shell_of(round_section(), outer, 0.002, 0.003, Handle(0.05, 0.065, 0.1, 0.01, False))
    assert_tiled(pan)
    assert mesh_of(pan).euler_number == 2
    assert mesh_of(pan).volume - mesh_of(plain).volume == pytest.approx(2 * 0.06 * TAN * 0.015 * 0.1)


def test_bent_bar_of_one_radius() -> None:
    """Pappus for a chain of prisms cut by planes: area x 2 bend tan(step / 2) for each of the steps.

    Every piece is a slice of a straight 12-gon prism between two planes through the bend's axis; its volume is the
    area of the cross-section square to it times its length at the centroid. The rings are regular 12-gons in the
    cutting planes, so that the square section is squeezed by cos(step / 2) and the length is the chord
    2 bend sin(step / 2): the product is area x bend x sin(step).
    """
    bar = bent_of(np.full(5, 0.01), bend=0.1, angle=np.pi / 2)
    area = 12 / 2 * 0.01**2 * np.sin(2 * np.pi / 12)
    mesh = mesh_of(bar)
    assert mesh.is_watertight and len(bar.parts) == 4
    assert mesh.volume == pytest.approx(parts_volume(bar))
    assert mesh.volume == pytest.approx(4 * area * 0.1 * np.sin(np.pi / 8))


def test_bent_bar_of_changing_radius_is_tiled() -> None:
    assert_tiled(bent_of(np.array([0.004, 0.012, 0.018, 0.017, 0.006]), bend=0.09, angle=1.5))
