"""Convex pieces of meshes with walls, and what the check says of good and of wrong pieces."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, cKDTree

from spgf_torch.errors import InputError
from spgf_torch.geometry.convex_pieces import MAX_HULL_VERTICES, convex_pieces
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.shell import PieceCheck, check_pieces, collision_pieces
from spgf_torch.settings import settings

OUTER, INNER, HEIGHT, BOTTOM = 0.040, 0.037, 0.080, 0.003


@pytest.fixture(scope="module")
def config() -> CollisionConfig:
    return settings(CollisionConfig, samples=40_000)


@pytest.fixture(scope="module")
def cup() -> trimesh.Trimesh:
    """A cylindrical cup, 80 mm wide and high, wall and bottom 3 mm."""
    profile = [[0, 0], [OUTER, 0], [OUTER, HEIGHT], [INNER, HEIGHT], [INNER, BOTTOM], [0, BOTTOM]]
    return trimesh.creation.revolve(profile, sections=24)


@pytest.fixture(scope="module")
def bowl() -> trimesh.Trimesh:
    """A hemispherical bowl of radius 30 mm, wall 1 mm: thinner than the faces are extruded."""
    angle = np.linspace(0, np.pi / 2, 8)
    arc = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    arc[0, 0] = 0.0
    return trimesh.creation.revolve(np.concatenate([0.030 * arc, 0.029 * arc[::-1]]), sections=24)


def box() -> trimesh.Trimesh:
    return trimesh.creation.box((0.10, 0.06, 0.04))


def contains(piece: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) bool, by the definition: below every plane of the hull."""
    equations = ConvexHull(piece).equations
    return (points @ equations[:, :3].T + equations[:, 3] <= 0).all(axis=1)


def test_a_box_is_one_piece_with_its_eight_corners(config: CollisionConfig) -> None:
    mesh = box()
    (piece,) = convex_pieces(mesh, settings(CollisionConfig, inset=0.0))
    expected = sorted(map(tuple, np.round(mesh.vertices, 9)))
    assert sorted(map(tuple, np.round(piece, 9))) == expected


def test_a_ball_is_few_pieces_within_the_limit_of_physx(config: CollisionConfig) -> None:
    ball = trimesh.creation.icosphere(4, 0.035)
    pieces, check = collision_pieces(ball, config, "ball")
    assert len(pieces) <= 4 and check.pieces == len(pieces) and check.faces == len(ball.faces)
    assert all(len(piece) <= MAX_HULL_VERTICES for piece in pieces)
    assert check.free_space_kept == 1.0  # no cavity
    assert check.volume_ratio == pytest.approx(1.0, abs=0.05)


@pytest.fixture(scope="module")
def cut(cup: trimesh.Trimesh, config: CollisionConfig) -> tuple[tuple[np.ndarray, ...], PieceCheck]:
    """The cup's pieces and what the check says of them."""
    return collision_pieces(cup, config, "cup")


def test_a_cup_keeps_its_cavity_and_its_volume(cut: tuple[tuple[np.ndarray, ...], PieceCheck]) -> None:
    pieces, check = cut
    assert check.free_space_kept >= 0.95
    assert check.volume_ratio == pytest.approx(1.0, abs=0.15)
    axis = np.stack([np.zeros(50), np.zeros(50), np.linspace(0.006, HEIGHT, 50)], axis=1)
    assert not any(contains(piece, axis).any() for piece in pieces)


def test_pieces_are_the_corners_of_their_hulls_and_the_same_every_time(
    cup: trimesh.Trimesh, config: CollisionConfig, cut: tuple[tuple[np.ndarray, ...], PieceCheck]
) -> None:
    pieces, again = cut[0], convex_pieces(cup, config)
    assert all(len(ConvexHull(piece).vertices) == len(piece) for piece in pieces)
    assert all(np.array_equal(a, b) for a, b in zip(pieces, again, strict=True))


def test_a_wall_thinner_than_the_extrusion_stays_within_the_tolerance(
    bowl: trimesh.Trimesh, config: CollisionConfig
) -> None:
    """Both ways. No point of a piece is farther outside the mesh than the tolerance, and half of it more between the
    points that are kept free; no surface point is farther from every piece than the tolerance and, at an edge, the
    insets of both its faces."""
    pieces = convex_pieces(bowl, config)
    rng = np.random.default_rng(0)
    in_pieces = np.concatenate([rng.dirichlet(np.full(len(piece), 0.5), 100) @ piece for piece in pieces])
    radius = np.linalg.norm(in_pieces, axis=1)
    assert (0.029 - radius).max() < 1.5 * config.tolerance
    assert (radius - 0.030).max() < 1e-6  # the outside is convex: nothing stands out there

    surface = trimesh.sample.sample_surface(bowl, 2000, seed=0)[0]
    above = [surface @ hull.equations[:, :3].T + hull.equations[:, 3] for hull in map(ConvexHull, pieces)]
    nearest = np.min([planes.max(axis=1) for planes in above], axis=0)
    assert nearest.max() < config.tolerance + 2 * config.inset


def test_one_hull_over_a_cup_is_found_out(cup: trimesh.Trimesh, config: CollisionConfig) -> None:
    """Hull: R^2 h = 40^2 80 = 128000. Cup: less r^2 (h - b) = 37^2 77 = 105413, that is 22587 (mm3 / pi; both are the
    same prism of 24 sides). Ratio 5.667; every point of the cavity is in the hull."""
    check = check_pieces(cup, (cup.convex_hull.vertices,), config)
    assert check.volume_ratio == pytest.approx(5.667, rel=0.05)
    assert check.free_space_kept == 0.0


def test_missing_pieces_are_found_out(config: CollisionConfig) -> None:
    """Without pieces only what lies deeper than 2.5 mm counts: 95 x 55 x 35 of 100 x 60 x 40 mm, 76.2 %."""
    check = check_pieces(box(), (), settings(CollisionConfig, thickness=0.0025, samples=40_000))
    assert check.volume_ratio == pytest.approx(0.762, abs=0.01)
    assert check.free_space_kept == 1.0


def test_the_cavity_reaches_the_walls_but_not_the_sliver_under_the_hull(config: CollisionConfig) -> None:
    """A box with a pyramidal dent of 3 mm has no cavity of 5 mm depth: filling the dent costs nothing. With a limit of
    1 mm the dent counts, and the whole hull fills it."""
    mesh = box().subdivide().subdivide()
    mesh.vertices[cKDTree(mesh.vertices).query([0, 0, 0.02])[1], 2] -= 0.003
    hull = (mesh.convex_hull.vertices,)
    assert check_pieces(mesh, hull, settings(CollisionConfig, samples=40_000)).free_space_kept == 1.0
    fine = settings(CollisionConfig, samples=40_000, cavity_depth=0.001)
    assert check_pieces(mesh, hull, fine).free_space_kept == 0.0


def test_a_coarse_tolerance_is_halved_until_the_check_passes(cup: trimesh.Trimesh) -> None:
    coarse = {"tolerance": 0.003, "samples": 40_000}
    _, check = collision_pieces(cup, settings(CollisionConfig, attempts=3, **coarse), "cup.ply")
    assert check.volume_ratio == pytest.approx(1.0, abs=0.15)
    with pytest.raises(InputError, match=r"^cup.ply: expected collision pieces within 15% .* got volume x\d.* 3 mm$"):
        collision_pieces(cup, settings(CollisionConfig, attempts=1, **coarse), "cup.ply")


def test_slivers_do_not_stop_the_pieces(config: CollisionConfig) -> None:
    """A vertex 0.1 nm off an edge's middle makes two triangles without height; the box stays one piece."""
    mesh = box()
    a, b = mesh.edges_unique[0]
    middle = (mesh.vertices[a] + mesh.vertices[b]) / 2
    vertices = np.concatenate([mesh.vertices, [middle + 1e-10]])
    split = []
    for face in mesh.faces.tolist():
        if {a, b} <= set(face):
            split += [
                [len(vertices) - 1 if v == a else v for v in face],
                [len(vertices) - 1 if v == b else v for v in face],
            ]
        else:
            split.append(face)
    split.append([a, b, len(vertices) - 1])
    assert len(convex_pieces(trimesh.Trimesh(vertices, split, process=False), config)) == 1
