"""Estimated normals against surfaces whose normals are known; their side; what is refused."""

import re

import numpy as np
import pytest
import torch
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.scene.assembly import texlets_of
from spgf_torch.scene.cloud import Cloud, voxel_means
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.normals import facing, neighbourhoods, oriented, outwardness, principal_normals
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

CONFIG, SENSING = settings(SceneConfig), settings(SensingConfig)
AWAY = np.array([0.1, 0.0, 0.2])  # the ball's centre
Oriented = tuple[np.ndarray, np.ndarray]


def test_points_that_no_viewpoint_sees_are_warned_of(ball: tuple[np.ndarray, np.ndarray]) -> None:
    """A whole ball and one viewpoint: nearly half of it lies behind; with one on either side, nothing does."""
    notes: list[str] = []
    oriented(Cloud(ball[0], None, np.array([[0.1, 0.0, 1.0]]), "ball.npy"), CONFIG, notes)
    assert len(notes) == 1 and re.match(r"warning: ball\.npy: [345]\d% of the points lie behind", notes[0])
    notes.clear()
    oriented(Cloud(ball[0], None, np.array([[0.1, 0.0, 1.0], [0.1, 0.0, -1.0]])), CONFIG, notes)
    oriented(Cloud(ball[0][ball[1][:, 2] > 0.2], None, np.array([[0.1, 0.0, 1.0]])), CONFIG, notes)
    assert not notes


def test_principal_normals_equal_a_slow_loop(rng: np.random.Generator) -> None:
    points = rng.random((200, 3)) * [0.03, 0.03, 0.01]
    index, pitch = neighbourhoods(points, 12, 0.005)
    normals, counted = principal_normals(points, index)
    np.testing.assert_array_equal(counted, (index != np.arange(200)[:, None]).sum(axis=1))
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    fourth = np.minimum(np.sort(apart, axis=1)[:, 4], 0.005)
    np.testing.assert_allclose(pitch, np.median(fourth))
    compared = 0
    for i in range(len(points)):
        near = [j for j in np.argsort(apart[i])[:12] if apart[i, j] <= 0.005]
        assert set(index[i]) == set(near) | {i}
        if len(near) >= 5:
            values, vectors = np.linalg.eigh(np.cov(points[near].T, bias=True))
            if values[0] < 0.9 * values[1]:
                np.testing.assert_allclose(abs(normals[i] @ vectors[:, 0]), 1, atol=1e-6)
                compared += 1
    assert compared > 50


def test_a_ball_seen_from_four_sides(ball: Oriented, views: np.ndarray) -> None:
    """Points 2.4 mm apart, those that no camera sees left out. A point at the border that is first turned the wrong way
    has no neighbours that face as it does, and is dropped."""
    points, truth = ball
    eyes = views + AWAY
    seen = ((eyes[:, None] - points) * truth).sum(axis=-1).max(axis=0) > 0.1 * 0.7
    points = points[seen]
    cloud = oriented(Cloud(points, None, eyes), CONFIG)
    truth = (cloud.points - AWAY) / 0.05
    error = np.rad2deg(np.arccos(np.clip((cloud.normals * truth).sum(axis=1), -1, 1)))
    assert len(points) - len(cloud) < 0.005 * len(points)
    assert np.median(error) < 0.5
    assert (error > 15).mean() < 0.003


def test_one_view_turns_every_normal_to_it(ball: Oriented) -> None:
    points, truth = ball
    eye = np.array([0.1, 0.5, 0.4])
    front = ((eye - points) * truth).sum(axis=1) > 0.05
    cloud = oriented(Cloud(points[front], None, eye[None]), CONFIG)
    assert ((eye - cloud.points) * cloud.normals).sum(axis=1).min() > 0
    assert (cloud.normals * truth[front]).sum(axis=1).min() > 0.9


def test_both_sides_of_a_thin_wall(seen_tray: Oriented, views: np.ndarray) -> None:
    """Walls of 3 mm, 2.4 mm between points. Away from corners and rim 0.2 % of the normals are off by more than 20 deg
    (measured); with these, whose strips are narrower than a neighbourhood, 10 %, and 3 % are on the wrong side. Each
    side of each wall gets its texlets."""
    points, truth = seen_tray
    dense = voxel_means(Cloud(points, truth, views), CONFIG.voxel)
    cloud = oriented(Cloud(dense.points, None, views), CONFIG)
    cosine = (cloud.normals * dense.normals[_same(dense.points, cloud.points)]).sum(axis=1)
    x = np.abs(cloud.points)
    wall = (x[:, 2] < 0.015) & ((x[:, 0] < 0.038) | (x[:, 1] < 0.03))
    assert wall.sum() > 3000
    assert (cosine[wall] < np.cos(np.deg2rad(20))).mean() < 0.01
    assert (cosine < np.cos(np.deg2rad(20))).mean() < 0.15
    assert (cosine < 0).mean() < 0.05
    given, estimated = (
        texlets_of(Cloud(points, normals, views), CONFIG, SENSING, np.random.default_rng(0))
        for normals in (truth, None)
    )
    for axis, half in ((0, 0.05), (1, 0.04)):
        for side in (-1, 1):
            both = [_on_wall(t.positions.numpy(), t.normals.numpy(), axis, side, half) for t in (given, estimated)]
            assert both[0] > 20
            assert both[1] > 0.8 * both[0]


def _same(points: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Where `some` of the points stand among them."""
    place = {tuple(point): i for i, point in enumerate(points)}
    return np.array([place[tuple(point)] for point in some])


def _on_wall(x: np.ndarray, n: np.ndarray, axis: int, side: int, half: float) -> int:
    """Texlets within 4 mm of the walls at +-half that face `side` along `axis`."""
    return int(((np.abs(x[:, axis]) > half - 0.004) & (n[:, axis] * side > 0.8)).sum())


def test_the_second_round_parts_the_sides_of_a_sheet() -> None:
    """Two sheets 3 mm apart at random places: the first round is torn between them, the second looks at one alone."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.random((3000, 2)) * 0.08, np.repeat([0.0, 0.003], 1500)])
    truth = np.column_stack([np.zeros((3000, 2)), np.repeat([-1.0, 1.0], 1500)])
    index, _ = neighbourhoods(points, CONFIG.neighbours, CONFIG.normal_radius)
    rough, _ = principal_normals(points, index)
    rough *= np.sign((rough * truth).sum(axis=1))[:, None]
    fine, alike = principal_normals(points, index, rough)
    assert ((rough * truth).sum(axis=1) < np.cos(np.deg2rad(5))).mean() > 0.3
    assert ((fine * truth).sum(axis=1)[alike >= 5] < np.cos(np.deg2rad(5))).mean() < 0.03


def test_hidden_is_the_depth_behind_the_surface_in_front() -> None:
    """Sheets at z = 0 and z = -5 mm under one view: the lower lies 5 mm behind; with a view from below, none does."""
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(40)), axis=-1).reshape(-1, 2) * 2e-3 - 0.04
    sheets = np.concatenate([np.column_stack([grid, np.full(len(grid), z)]) for z in (0.0, -0.005)])
    normals = np.tile([0.0, 0, 1], (len(sheets), 1))
    above, below = np.array([[0.0, 0, 0.5]]), np.array([[0.0, 0, -0.5]])
    turned, hidden = facing(sheets, normals, above, 0.002)
    np.testing.assert_allclose(hidden, np.repeat([0, 0.005], len(grid)), atol=1e-9)
    np.testing.assert_array_equal(turned, normals)
    turned, hidden = facing(sheets, normals, np.concatenate([below, above]), 0.002)
    np.testing.assert_allclose(hidden, 0, atol=1e-9)
    np.testing.assert_array_equal(turned[:, 2], np.repeat([1, -1], len(grid)))


def test_outliers_go(ball: Oriented) -> None:
    points, normals = ball
    stray = np.concatenate([points, [[0.1, 0, 0.4], [0.1, 0.001, 0.4]]])
    for given in (None, np.concatenate([normals, [[0, 0, 1.0]] * 2])):
        viewpoint = [0.1, 0, 1.2] if given is None else None
        seen = stray[:, 2] > 0.22 if given is None else np.ones(len(stray), bool)
        cloud = Cloud(stray[seen], given, None if viewpoint is None else np.array([viewpoint]))
        assert len(oriented(cloud, CONFIG)) == len(cloud) - 2


def test_sparse_clouds_with_normals_keep_their_texlets(ball: Oriented) -> None:
    """5 mm between points (every third), seldom two a texlet: three quarters of the whole cloud's."""
    sparse, dense = (
        texlets_of(Cloud(ball[0][::step], ball[1][::step]), CONFIG, SENSING, np.random.default_rng(0))
        for step in (3, 1)
    )
    assert len(sparse) > 0.7 * len(dense)


@pytest.mark.parametrize("estimated", [False, True])
def test_a_moved_cloud_gives_moved_texlets(estimated: bool, ball: Oriented) -> None:
    """Voxels too small to merge anything keep the order, so that the same generator thins alike."""
    points, normals = ball
    eye = np.array([[0.1, 0.1, 0.9]])
    up = normals[:, 2] > 0.2
    T = trimesh.transformations.rotation_matrix(2.0, [0.3, -0.5, 0.8], [0.2, 0, 0.1])
    T[:3, 3] += [0.5, -0.2, 0.1]
    config = settings(SceneConfig, voxel=0.0005)
    still, moved = (
        texlets_of(
            Cloud(
                points[up] @ R.T + t,
                None if estimated else normals[up] @ R.T,
                eye @ R.T + t if estimated else None,
            ),
            config,
            SENSING,
            np.random.default_rng(3),
        )
        for R, t in ((np.eye(3), np.zeros(3)), (T[:3, :3], T[:3, 3]))
    )
    turn, shift = torch.from_numpy(T[:3, :3]).float(), torch.from_numpy(T[:3, 3]).float()
    torch.testing.assert_close(moved.positions, still.positions @ turn.T + shift, atol=2e-6, rtol=0)
    torch.testing.assert_close(moved.normals, still.normals @ turn.T, atol=1e-4, rtol=0)


def test_neither_normals_nor_viewpoint(ball: Oriented) -> None:
    with pytest.raises(InputError, match=r"mug: expected normals or a viewpoint .*give viewpoints=\[\[x,y,z\],"):
        oriented(Cloud(ball[0], name="mug"), CONFIG)


def test_a_viewpoint_among_the_points(ball: Oriented) -> None:
    with pytest.raises(InputError, match=r"viewpoint outside of the points, got \(0\.1, 0, 0\.2\) m with 50% of them"):
        oriented(Cloud(ball[0], None, np.array([[0.1, 0, 0.2]])), CONFIG)


def test_points_too_far_apart(ball: Oriented) -> None:
    with pytest.raises(InputError, match=r"others of their side within 0\.01 m, got 100% with fewer; give a larger"):
        texlets_of(Cloud(10 * ball[0], None, np.array([[0.0, 0, 9]])), CONFIG, SENSING, np.random.default_rng(0))


def test_normals_that_point_inwards(ball: Oriented, seen_tray: Oriented, views: np.ndarray) -> None:
    points, normals = ball
    oriented(Cloud(points, normals), CONFIG)
    with pytest.raises(
        InputError, match="expected normals out of the surface, got the outermost ones pointing inwards"
    ):
        oriented(Cloud(points, -normals), CONFIG)
    for cloud, n in ((seen_tray[0][::4], seen_tray[1][::4]), (points, normals)):
        oriented(Cloud(cloud, n, views + AWAY), CONFIG)
        with pytest.raises(
            InputError, match=r"expected normals towards the viewpoints, got \d+% that point away; flip"
        ):
            oriented(Cloud(cloud, -n, views + AWAY), CONFIG)


def test_the_inside_of_a_bowl_needs_a_viewpoint(ball: Oriented) -> None:
    points, normals = ball
    down = normals[:, 2] < 0
    with pytest.raises(InputError, match=r"or give viewpoints=\[\[x,y,z\],\.\.\.\] if this is the inside of something"):
        oriented(Cloud(points[down], -normals[down]), CONFIG)
    inside = oriented(Cloud(points[down], -normals[down], np.array([[0.1, 0.0, 0.9]])), CONFIG)
    np.testing.assert_array_equal(inside.normals, -normals[down])


def test_outwardness(ball: Oriented) -> None:
    """1 for a ball; 0 for a plane, whose outermost points face with as many directions as against."""
    assert outwardness(*ball) > 0.99
    flat = np.column_stack([np.random.default_rng(0).random((500, 2)), np.zeros(500)])
    assert abs(outwardness(flat, np.tile([0.0, 0, 1], (500, 1)))) < 0.05
