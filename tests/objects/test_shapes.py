"""Shapes from their dimensions: volumes and inertia derived by hand, and dimensions that make no shape."""

from __future__ import annotations

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import Description, build
from spgf_torch.objects.lofts import SEGMENTS
from spgf_torch.objects.shapes import SHAPES
from spgf_torch.settings import typed

TAN = np.tan(np.pi / SEGMENTS)


def make(shape: str, mass: float = 0.2, **dimensions) -> GraspObject:
    return build(Description(name="thing", category="boxes", mass=mass, shape=shape, dimensions=dimensions))


def test_box_inertia() -> None:
    """A cuboid about its centre: m / 12 (y^2 + z^2) about x, and so on; the centre is half its height up."""
    box = make("box", mass=0.3, size=[0.06, 0.04, 0.10])
    expected = 0.3 / 12 * np.array([0.04**2 + 0.1**2, 0.06**2 + 0.1**2, 0.06**2 + 0.04**2])
    np.testing.assert_allclose(box.inertia, np.diag(expected), atol=1e-12)
    np.testing.assert_allclose(box.com, [0, 0, 0.05], atol=1e-12)
    assert box.mesh.volume == pytest.approx(0.06 * 0.04 * 0.1)


def test_round_shell_inertia() -> None:
    """Outer prism less cavity. About z an n-gon prism of facet distance a has m a^2 (1/2 + t^2/6), t = tan(pi/n):

    the triangle between the centre and a facet, |y| <= t x up to x = a, has the area a^2 t and the integral of
    x^2 + y^2 over it is a^4 (t/2 + t^3/6).
    """
    cup = make("round_shell", mass=0.2, profile=[[0.04, 0], [0.04, 0.09]], wall=0.003, base=0.005)
    volumes = SEGMENTS * TAN * np.array([0.04**2 * 0.09, 0.037**2 * 0.085])
    about_z = np.array([0.04, 0.037]) ** 2 * (1 / 2 + TAN**2 / 6)
    density = 0.2 / (volumes[0] - volumes[1])
    assert cup.mesh.volume == pytest.approx(volumes[0] - volumes[1])
    assert cup.inertia[2, 2] == pytest.approx(density * (volumes * about_z) @ [1, -1])
    assert cup.com[2] == pytest.approx((volumes * [0.045, 0.005 + 0.0425]) @ [1, -1] / (volumes @ [1, -1]))


def test_ellipsoid_is_as_large_as_its_size_and_close_to_the_round_one() -> None:
    """The extents are met; inside the 20-gon and 10 bands are up to 4 % of the volume, 4/3 pi abc."""
    egg = make("ellipsoid", size=[0.09, 0.07, 0.08])
    np.testing.assert_allclose(egg.mesh.extents, [0.09, 0.07, 0.08], rtol=1e-9)
    assert egg.mesh.volume == pytest.approx(np.pi / 6 * 0.09 * 0.07 * 0.08, rel=0.04)
    assert len(egg.parts) == 1 and len(egg.parts[0]) <= 255


def test_bevelled_box() -> None:
    """The bevelled slab on either end is the integral of (x - 2 s)(y - 2 s) over s from 0 to c."""
    x, y, z, c = 0.09, 0.06, 0.04, 0.006
    slab = x * y * c - (x + y) * c**2 + 4 * c**3 / 3
    assert make("box", size=[x, y, z], edge=c).mesh.volume == pytest.approx(x * y * (z - 2 * c) + 2 * slab)


def test_box_shell_volume() -> None:
    """Straight walls: the outer block less the cavity."""
    tray = make("box_shell", size=[0.2, 0.15, 0.07], wall=0.006, base=0.005)
    assert tray.mesh.volume == pytest.approx(0.2 * 0.15 * 0.07 - 0.188 * 0.138 * 0.065)
    assert len(tray.parts) == 5


@pytest.mark.parametrize(
    ("shape", "dimensions", "key"),
    [
        ("round_solid", {"profile": [[0.03, 0]]}, "profile"),
        ("round_solid", {"profile": [[0.03, 0], [0.03]]}, "profile"),
        ("round_solid", {"profile": [[0.03, 0], ["wide", 0.1]]}, "profile"),
        ("round_solid", {"profile": [[0.03, 0], [-0.01, 0.1]]}, "profile"),
        ("round_solid", {"profile": [[0.03, 0], [float("nan"), 0.1]]}, "profile"),
        ("round_solid", {"profile": [[0.03, 0], [0.03, float("nan")]]}, "profile"),
        ("round_solid", {"profile": [[0.03, 0.1], [0.03, 0]]}, "profile"),
        ("round_solid", {"profile": [[30, 0], [30, 100]]}, "profile"),
        ("round_solid", {}, "profile"),
        ("round_shell", {"profile": [[0.03, 0], [0.03, 0.1]], "wall": 0.04, "base": 0.005}, "wall"),
        ("round_shell", {"profile": [[0.03, 0], [0.03, 0.1]], "wall": 0.003, "base": 0.099, "radius": 1}, "radius"),
        ("round_shell", {"profile": [[0.03, 0], [0.03, 0.05]], "wall": 0.003, "base": 0.06}, "base"),
        ("round_shell", {"profile": [[0.03, 0], [0.03, 0.1]], "wall": -0.003, "base": 0.005}, "wall"),
        ("box", {"size": [0.1, 0.1]}, "size"),
        ("box", {"size": [0.1, -0.1, 0.1]}, "size"),
        ("box", {"size": [100, 100, 100]}, "size"),
        ("box", {"size": [0.1, 0.1, 0.02], "edge": 0.01}, "edge"),
        ("box", {"size": [0.1, 0.1, 0.02], "corner": 0.05}, "corner"),
        ("box_shell", {"size": [0.1, 0.1, 0.1], "wall": 0.06, "base": 0.002}, "wall"),
        ("box_shell", {"size": [0.1, 0.1, 0.1], "wall": 0.004, "base": 0.002, "corner": 0.003}, "wall"),
        ("box_shell", {"size": [0.1, 0.1, 0.1], "wall": 0.004, "base": 0.099, "taper": "wide"}, "taper"),
        ("bent", {"radii": [0.01, 0.02], "bend": 0.1, "angle_deg": 90}, "radii"),
        ("bent", {"radii": [0.01, 0.2, 0.01], "bend": 0.1, "angle_deg": 90}, "radii"),
    ],
)
def test_dimensions_that_make_no_shape(shape: str, dimensions: dict, key: str) -> None:
    with pytest.raises(InputError, match=key) as error:
        typed(SHAPES[shape], dimensions).solid()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "change", [{"high": 0.2}, {"low": 0.005}, {"thickness": 0.03}, {"reach": 0.004}, {"thickness": 0.0}]
)
def test_handles_that_do_not_fit(change: dict) -> None:
    """Above the rim, across a bend of the wall, without room for a finger, thicker than it reaches, without any."""
    handle = {"low": 0.02, "high": 0.07, "reach": 0.03, "thickness": 0.007, **change}
    mug = {"profile": [[0.03, 0], [0.04, 0.01], [0.04, 0.09]], "wall": 0.004, "base": 0.005, "handle": handle}
    with pytest.raises(InputError, match="handle"):
        typed(SHAPES["round_shell"], mug).solid()
