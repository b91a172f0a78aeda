"""Where what was looked at ends: by hand on planes, then grasps of whole scenes."""

import numpy as np
import pytest
import torch
import trimesh

from spgf_torch.scene.borders import cut_borders
from spgf_torch.scene.outline import straight_borders
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.cameras import Camera, cast, look_at
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView

NONE = np.zeros((0, 3)), (), np.zeros((0, 4)), 0.005, 0.05


def sheet(x: np.ndarray, y: np.ndarray, z: float = 0.0) -> np.ndarray:
    """(N, 3) points of a plane that faces +z."""
    return np.array([[a, b, z] for a in x for b in y])


def texlets(points: np.ndarray) -> Texlets:
    up = torch.tensor([0.0, 0.0, 1.0]).expand(len(points), 3)
    return Texlets(torch.from_numpy(points).float(), up)


def test_an_edge_is_no_border() -> None:
    plate = texlets(sheet(np.arange(0, 0.1, 0.005), np.arange(0, 0.1, 0.005)))
    assert cut_borders(plate, *NONE).isnan().all()


def test_a_surface_that_goes_on_in_an_obstacle_is_cut() -> None:
    """A plate up to x = 0.095 whose rest, from x = 0.1 on, is an obstacle: only the last row is cut, along +x."""
    plate = texlets(sheet(np.arange(0, 0.0951, 0.005), np.arange(0, 0.1, 0.005)))
    rest = sheet(np.arange(0.1, 0.2, 0.002), np.arange(0, 0.1, 0.002))
    found = cut_borders(plate, rest, *NONE[1:])
    cut = found.isfinite().all(1)
    assert (plate.positions[cut, 0] > 0.0949).all() and cut.sum() == 20
    np.testing.assert_allclose(found[cut][:, 0], 1.0, atol=0.1)
    np.testing.assert_allclose(found[cut].norm(dim=1), 1.0, atol=1e-5)


@pytest.mark.parametrize(
    "rest",
    [
        sheet(np.arange(0.1, 0.2, 0.002), np.arange(0, 0.1, 0.002), -0.012),  # a step down: a true edge
        sheet(np.arange(0.1, 0.102, 0.002), np.arange(0, 0.1, 0.002)),  # a mask that is 5 mm too small
        sheet(np.arange(0.106, 0.2, 0.002), np.arange(0, 0.1, 0.002)),  # another thing, 11 mm apart
    ],
)
def test_what_is_beside_a_true_edge_does_not_cut(rest: np.ndarray) -> None:
    plate = texlets(sheet(np.arange(0, 0.0951, 0.005), np.arange(0, 0.1, 0.005)))
    assert cut_borders(plate, rest, *NONE[1:]).isnan().all()


def view(width: int) -> DepthView:
    """An image 1 m above z = 0, 10 mm a pixel there, its first column's left side at x = 0."""
    K = np.array([[100.0, 0, -0.5], [0, 100.0, 49.5], [0, 0, 1.0]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 1.0)
    return DepthView.of(np.ones((100, width)), Camera(K, T, width, 100))


def test_nothing_is_gripped_near_the_border_of_an_image() -> None:
    """The image ends at x = 0: texlets nearer than 50 mm are flagged; in a second, wider image they are not."""
    strip = texlets(sheet(np.arange(0.0025, 0.2, 0.005), np.array([0.0])))
    found = cut_borders(strip, NONE[0], (view(100),), *NONE[2:])
    assert ((found == 0).all(1) == (strip.positions[:, 0] < 0.05)).all()
    moved = view(100)
    other = DepthView(moved.depth, moved.K, moved.rotation, moved.eye + torch.tensor([-0.5, 0, 0]))
    assert cut_borders(strip, NONE[0], (moved, other), *NONE[2:]).isnan().all()


def test_a_frame_is_straight_long_and_wide() -> None:
    """A plane of 400 x 300 mm, seen from 1 m above: four planes through the eye, each with all points on one side."""
    points = sheet(np.arange(0, 0.4001, 0.005), np.arange(0, 0.3001, 0.005))
    eye = np.array([0.2, 0.15, 1.0])
    planes = straight_borders(points, eye, np.zeros(3))
    assert len(planes) == 4 and (points @ planes[:, :3].T + planes[:, 3] < 1e-6).all()
    np.testing.assert_allclose(planes[:, :3] @ eye + planes[:, 3], 0, atol=1e-9)
    right = planes[planes[:, 0].argmax()]
    np.testing.assert_allclose(np.array([0.4, 0.1, 0.0]) @ right[:3] + right[3], 0, atol=1e-6)
    afar = straight_borders(points, None, np.array([0, 0, 1.0]))
    assert sorted(np.round(afar[:, 3], 3).tolist()) == [-0.4, -0.3, 0.0, 0.0]
    assert not len(straight_borders(points[:, [0, 1, 2]] * 0.5, eye, np.zeros(3)))  # 200 x 150 mm: a thing


def test_a_side_that_faces_over_an_outline_is_a_true_edge() -> None:
    """A sheet that ends at x = 0.4: cut there if nothing is seen beyond; an edge where a wall faces +x."""
    flat = sheet(np.arange(0.2, 0.4001, 0.005), np.arange(0, 0.3, 0.005))
    plane = np.array([[1.0, 0, 0, -0.4]])
    found = cut_borders(texlets(flat), NONE[0], (), plane, 0.005, 0.05)
    assert ((found == 0).all(1).numpy() == (flat[:, 0] > 0.3501)).all()
    wall = np.array([[0.4, b, -c] for b in np.arange(0, 0.3, 0.005) for c in np.arange(0.005, 0.05, 0.005)])
    normals = np.concatenate([np.tile([0, 0, 1.0], (len(flat), 1)), np.tile([1.0, 0, 0], (len(wall), 1))])
    both = Texlets(*(torch.from_numpy(a).float() for a in (np.concatenate([flat, wall]), normals)))
    assert cut_borders(both, NONE[0], (), plane, 0.005, 0.05).isnan().all()


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    thing = trimesh.creation.box(size)
    thing.apply_translation(at)
    return thing


def image(*things: trimesh.Trimesh) -> tuple[np.ndarray, Camera]:
    K = np.array([[130.0, 0, 63.5], [0, 130.0, 47.5], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0.0, -0.4, 0.4]), np.array([0.0, 0, 0.05])), 128, 96)
    return cast(trimesh.util.concatenate(things), camera)[0], camera


def test_scenes_carry_their_borders() -> None:
    """A plate through the whole image is cut at its borders; a crop box cuts it too; a box in the middle is whole."""
    table, plate, block = (
        box((2, 2, 0.02), (0, 0, -0.01)),
        box((2, 0.2, 0.01), (0, 0, 0.1)),
        box((0.05,) * 3, (0, 0, 0.025)),
    )
    depth, camera = image(table, plate)
    known = depth, camera.K, camera.T_object_camera
    scene = Scene.from_depth(*known, table=[0, 0, 1, 0])
    assert scene.borders is not None and any("borders: " in note for note in scene.notes)
    cut, x = scene.borders.isfinite().all(1), scene.texlets.positions[:, 0]
    assert cut[x.abs() > x.abs().max() - 0.04].all() and not cut[x.abs() < 0.1].any()
    cropped = Scene.from_depth(*known, table=[0, 0, 1, 0], crop_low=[-0.05, -1, -1], crop_high=[0.05, 1, 1])
    assert cropped.borders is not None
    at = cropped.borders.isfinite().all(1)
    assert at.sum() > 10 and (cropped.texlets.positions[at, 0].abs() > 0.035).all()
    whole, camera = image(table, block)
    assert Scene.from_depth(whole, camera.K, camera.T_object_camera, table=[0, 0, 1, 0]).borders is None
