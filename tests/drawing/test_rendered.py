"""The renderer: where things appear, what hides what, and where the lamp does not reach, worked out by hand."""

import gc
import weakref
from typing import Any

import numpy as np
import pytest
import trimesh

from spgf_torch.drawing.rendered import LAMP, SKY, Solid, camera_at, rendered
from spgf_torch.drawing.style import LIGHT

FACES = np.array([[0, 1, 2], [0, 2, 3]])
EYE, TARGET = np.array([0.0, -1.0, 1.0]), np.zeros(3)  # looks along (0, 1, -1), 0.2 m wide at the target


def square(x: float, y: float, z: float, half: float, colour: str) -> Solid:
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    return Solid(corners + np.array([x, y, z]), FACES, colour)


def picture(solids: list[Solid], samples: int = 1) -> np.ndarray:
    return np.asarray(rendered(solids, camera_at(EYE, TARGET, (101, 101), 0.2), samples)).astype(int)


def test_where_a_square_appears() -> None:
    """101 pixels are 0.2 m at the distance of sqrt 2, the middle one is 50. A square from x = 0.02 to 0.04 lies 10.1 to
    20.2 pixels right of it; its depth y = -0.01 to 0.01 is seen at 45 deg: 5.05 / sqrt 2 = 3.6 pixels up and down."""
    seen = picture([square(0.03, 0, 0, 0.01, "#ff0000")])
    red = (seen[..., 1] == 0) & (seen[..., 0] > 0)
    rows, columns = np.nonzero(red)
    assert (columns.min(), columns.max()) == (61, 70)
    assert (rows.min(), rows.max()) == (47, 53)
    assert (seen[0, 0] == 255).all()


def test_light_and_shadow() -> None:
    """The floor faces up and has SKY + LAMP LIGHT_z of its colour. A plate 20 mm above it keeps the lamp from the floor
    where the way to the lamp passes it: around (0, 0, 0.02) - 0.02 LIGHT / LIGHT_z."""
    floor, plate = square(0, 0, 0, 0.1, "#808080"), square(0, 0, 0.02, 0.005, "#0000ff")
    seen = picture([floor, plate])
    lit = round(128 * (SKY + LAMP * LIGHT[2]))
    assert abs(seen[50, 90, 0] - lit) <= 1
    x, y = -0.02 * LIGHT[:2] / LIGHT[2]
    place = camera_at(EYE, TARGET, (101, 101), 0.2)
    at = place.K @ (place.T_object_camera[:3, :3].T @ (np.array([x, y, 0]) - EYE))
    u, v = np.round(at[:2] / at[2]).astype(int)
    assert abs(seen[v, u, 0] - round(128 * SKY)) <= 1
    dark = (abs(seen[..., 0] - 128 * SKY) <= 1).sum()
    assert dark == pytest.approx(
        (0.01 * 101 / 0.2) ** 2 / np.sqrt(2), rel=0.35
    )  # as large as the plate, seen at 45 deg


def test_what_is_nearer_hides_what_is_behind() -> None:
    """In either order, and a surface is lit on both sides."""
    below, above = square(0, 0, 0, 0.05, "#ff0000"), square(0, -0.02, 0.02, 0.01, "#0000ff")  # on the line of sight
    for solids in ([below, above], [above, below]):
        assert picture(solids)[50, 50, 0] == 0
    turned = Solid(below.vertices, below.faces[:, ::-1], below.colour)
    np.testing.assert_array_equal(picture([turned]), picture([below]))


def test_more_samples_smooth_the_edges() -> None:
    """The mean over pixels stays, and colours between paper and square appear."""
    solids = [square(0.013, 0.004, 0, 0.031, "#ff0000")]
    coarse, fine = picture(solids), picture(solids, 3)
    assert fine.mean() == pytest.approx(coarse.mean(), rel=0.01)
    assert len(np.unique(coarse[..., 1])) == 2 < len(np.unique(fine[..., 1]))


def test_scenes_of_rays_are_let_go_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand of embree's scenes end a process, so none may wait for the garbage collector."""
    made: list[weakref.ref] = []
    kind = trimesh.ray.ray_pyembree.RayMeshIntersector

    def noted(self: Any, *given: Any, **named: Any) -> None:
        made.append(weakref.ref(self))
        begin(self, *given, **named)

    begin = kind.__init__
    monkeypatch.setattr(kind, "__init__", noted)
    gc.disable()
    try:
        picture([square(0, 0, 0, 0.01, "#ff0000")])
        assert made and all(reference() is None for reference in made)
    finally:
        gc.enable()


def test_a_solid_is_moved() -> None:
    """A quarter turn about z, then 0.1 m along x: (1, 2, 3) goes to (-2 + 0.1, 1, 3)."""
    T = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    moved = Solid(np.array([[1.0, 2, 3]]), FACES, "#ff0000").placed(T)
    np.testing.assert_allclose(moved.vertices, [[-1.9, 1, 3]])
