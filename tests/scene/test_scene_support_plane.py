"""The table is found, removed, kept as a plane, and refused where there is none."""

import re

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.scene.assembly import scene_of_clouds
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.planes import given_plane, height
from spgf_torch.scene.support_plane import find_plane, find_table
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

SENSING = settings(SensingConfig)
EYE = np.array([0.3, -0.4, 0.8])


@pytest.fixture(scope="module")
def tabletop() -> Cloud:
    """A table of 0.5 x 0.4 m at z = 0.1 with 1 mm of noise, half a ball of 50 mm on it, a floor 0.2 m below."""
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.random((6000, 2)) * [0.5, 0.4], rng.normal(0.1, 0.001, 6000)])
    up = rng.normal(size=(3000, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    ball = 0.05 * up * [1, 1, np.nan] + [0.2, 0.2, 0]
    ball[:, 2] = 0.1 + 0.05 * np.abs(up[:, 2])
    floor = np.column_stack([rng.random((500, 2)) - [0.2, 1.0], np.full(500, -0.1)])
    return Cloud(np.concatenate([table, ball, floor]), None, EYE[None])


@pytest.mark.parametrize("table", ["find", [0, 0, 2, -0.2]], ids=["found", "given"])
def test_what_lies_above_the_table_is_kept(table: object, tabletop: Cloud) -> None:
    config = settings(SceneConfig, table=table)
    scene = scene_of_clouds([tabletop], config, SENSING, np.random.default_rng(0))
    assert scene.table is not None
    np.testing.assert_allclose(scene.table, [0, 0, 1, -0.1], atol=1e-3)
    above = height(scene.texlets.positions.double().numpy(), scene.table)
    assert above.min() > config.table_distance - 1e-6
    assert np.linalg.norm(scene.texlets.positions.numpy() - [0.2, 0.2, 0.1], axis=1).max() < 0.055
    below = [re.search(r"^table \(.* points on it and (\d+) below removed of", note) for note in scene.notes]
    assert [450 < int(match[1]) <= 500 for match in below if match] == [True]


def test_the_same_generator_finds_the_same_table(tabletop: Cloud) -> None:
    config = settings(SceneConfig)
    first, again = (find_plane(tabletop.points, EYE, config, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_the_side_of_the_objects(tabletop: Cloud) -> None:
    """That of the camera; without one, that of most points beside the plane; a camera below it is refused."""
    config, rng = settings(SceneConfig), np.random.default_rng(0)
    assert find_plane(tabletop.points, EYE, config, rng)[2] > 0
    assert find_plane(tabletop.points, None, config, rng)[2] > 0
    with pytest.raises(
        InputError, match=r"viewpoints: expected on the side .* got \(0\.3, -0\.4, -0\.8\) m, 0\.9.* m below it"
    ):
        find_plane(tabletop.points, EYE * [1, 1, -1], config, rng, np.array([0.0, 0, 1]))


def test_a_tilted_table_in_a_moved_frame(tabletop: Cloud) -> None:
    """A plane n . x + d = 0 moved by R, t is (R n) . x + d - (R n) . t = 0."""
    turn, shift = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([0.1, 0.2, 0.3])
    moved = find_plane(
        tabletop.points @ turn.T + shift, EYE @ turn.T + shift, settings(SceneConfig), np.random.default_rng(0)
    )
    np.testing.assert_allclose(moved, [1, 0, 0, -0.1 - 0.1], atol=1e-3)


def test_a_box_alone_has_no_table(rng: np.random.Generator) -> None:
    """The largest side of a box holds most of its points, but is no table."""
    side = np.column_stack([rng.random((2000, 2)) * 0.15, np.zeros(2000)])
    box = np.concatenate([side, np.roll(side, 1, axis=1), np.roll(side, 2, axis=1)])
    with pytest.raises(
        InputError, match=r"table: expected a plane with 20% of the points and 0\.2 m wide, got at best"
    ):
        find_plane(box, None, settings(SceneConfig), rng)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((2, 3)), "got 2 points"),
        (np.arange(30.0)[:, None] * [[1, 2, 3]], "points on one line"),
        (np.random.default_rng(0).random((3000, 3)), "got at best"),
    ],
)
def test_no_plane(points: np.ndarray, message: str, rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match=message):
        find_plane(points, None, settings(SceneConfig), rng)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([0, 0, 0, 1], r"table: expected a normal \(a, b, c\) other than 0"),
        ([0, 0, 1], "table: expected 4 finite numbers"),
        ([0, 0, 1, float("nan")], "table: expected 4 finite numbers"),
        ({"a": 1}, "table: expected 4 numbers"),
    ],
)
def test_planes_that_are_none(values: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        given_plane(values)


@pytest.mark.parametrize(
    ("table", "message"),
    [("floor", r"table: expected null, find or \[a,b,c,d\], got floor"), ([0, 0, 1, -5], "above the plane, got none")],
)
def test_tables_that_leave_nothing(table: object, message: str, tabletop: Cloud) -> None:
    with pytest.raises(InputError, match=message):
        scene_of_clouds([tabletop], settings(SceneConfig, table=table), SENSING, np.random.default_rng(0))


UP = np.array([0.0, 0, 1])


def sheet(width: float, depth: float, at: tuple[float, float, float], seed: int = 0) -> np.ndarray:
    """A level sheet with 1 mm of noise, a point a 3 mm square."""
    rng, count = np.random.default_rng(seed), int(width * depth / 9e-6)
    return np.column_stack([(rng.random((count, 2)) - 0.5) * [width, depth], rng.normal(0, 0.001, count)]) + at


def box(width: float, depth: float, tall: float, at: tuple[float, float]) -> np.ndarray:
    """Top and two sides of a box that stands at z = 0."""
    x, y = at
    top = sheet(width, depth, (x, y, tall))
    front = sheet(width, tall, (0, 0, 0))[:, [0, 2, 1]] + [x, y - depth / 2, tall / 2]
    right = sheet(depth, tall, (0, 0, 0))[:, [2, 0, 1]] + [x + width / 2, y, tall / 2]
    return np.concatenate([top, front, right])


def moved(points: np.ndarray, x: float, y: float, z: float) -> np.ndarray:
    return points + np.array([x, y, z])


def around(points: np.ndarray, low: list[float], high: list[float]) -> np.ndarray:
    """The points outside of a box of two corners, those that are hidden in or under it."""
    return points[~((points >= low) & (points <= high)).all(axis=1)]


CUP = box(0.06, 0.06, 0.1, (-0.22, -0.2))
TABLE = around(sheet(0.7, 0.6, (0, 0, 0)), [-0.2, -0.2, -1], [0.2, 0.2, 0.01])


@pytest.mark.parametrize(
    "points",
    [
        np.concatenate([TABLE, box(0.4, 0.4, 0.2, (0, 0)), CUP]),
        np.concatenate([TABLE, box(0.4, 0.4, 0.03, (0, 0)), CUP]),
        np.concatenate([sheet(0.5, 0.5, (0, 0, 0)), CUP, sheet(1.5, 1.5, (0, 0.3, 0.2))[:, [0, 2, 1]]]),
        np.concatenate([sheet(0.4, 0.4, (0, 0, 0)), moved(CUP, 0.1, 0.1, 0), sheet(1.5, 1.5, (0, 0.8, -0.7))]),
    ],
    ids=["big-box", "book", "wall", "floor"],
)
def test_the_plane_that_things_stand_on(points: np.ndarray) -> None:
    points = points if points[:, 2].max() < 0.6 else points[points[:, 2] > -0.8]
    found = find_plane(points, EYE, settings(SceneConfig), np.random.default_rng(0), UP)
    np.testing.assert_allclose(found, [0, 0, 1, 0], atol=5e-3)


@pytest.mark.parametrize("storey", [-0.35, 0.0, 0.35])
def test_the_board_under_the_target(storey: float) -> None:
    boards = [sheet(0.7, 0.3, (0, 0, z)) for z in (-0.35, 0.0, 0.35)]
    target = moved(box(0.06, 0.06, 0.1, (0, 0)), 0, 0, storey)
    points = np.concatenate([*boards, moved(CUP, 0, 0.15, -0.35), target])
    named = np.arange(len(points)) >= len(points) - len(target)
    found = find_table(points, EYE + UP, settings(SceneConfig), np.random.default_rng(0), UP, named)
    np.testing.assert_allclose(found.plane, [0, 0, 1, -storey], atol=5e-3)
    assert not found.doubts


def test_a_second_wide_plane_is_told() -> None:
    points = np.concatenate(
        [sheet(0.5, 0.5, (0, 0, 0)), CUP, sheet(0.5, 0.5, (0.6, 0, -0.15)), moved(CUP, 0.7, 0, -0.15)]
    )
    found = find_table(points, EYE, settings(SceneConfig), np.random.default_rng(0), UP)
    assert any("is a wide plane as well" in doubt for doubt in found.doubts)


def test_a_steep_table_is_told(tabletop: Cloud) -> None:
    turn = np.array([[1, 0, 0], [0, np.cos(0.7), -np.sin(0.7)], [0, np.sin(0.7), np.cos(0.7)]])
    tilted = Cloud(tabletop.points @ turn.T, None, EYE[None] @ turn.T)
    scene = scene_of_clouds([tilted], settings(SceneConfig, table="find"), SENSING, np.random.default_rng(0))
    assert any(note.startswith("warning: table: tilted 40 deg") for note in scene.notes)
