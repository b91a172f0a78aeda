"""What is drawn of a cluttered table: fewer faces, tiles, and the shapes that move with a hand's links."""

import numpy as np
import pytest
import trimesh
from clutter_rounds import OBJECTS, hand

from spgf_torch.drawing.clutter_scene import FACES, HALF, coarse, link_solids, object_solids, open_hand, table_solids


def test_a_surface_with_few_faces_stays_as_it_is() -> None:
    box = OBJECTS[0].mesh
    vertices, faces = coarse(np.asarray(box.vertices), np.asarray(box.faces), 12)
    assert vertices is box.vertices or np.array_equal(vertices, box.vertices)
    assert np.array_equal(faces, box.faces)


def test_a_fine_surface_becomes_coarse() -> None:
    """A ball of 0.1 m with 5120 faces: fewer than asked for, more than half of the shape, no face twice or flat."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    vertices, faces = coarse(np.asarray(ball.vertices), np.asarray(ball.faces), 600)
    assert 200 < len(faces) <= 600
    radius = np.linalg.norm(vertices, axis=1)
    assert radius.max() <= 0.1 + 1e-9 and radius.min() > 0.09  # a mean of points of a cell lies within the ball
    assert len({tuple(sorted(face)) for face in faces.tolist()}) == len(faces)
    assert all(len(set(face)) == 3 for face in faces.tolist())
    kept = trimesh.Trimesh(vertices, faces)
    assert kept.area == pytest.approx(ball.area, rel=0.05)


def test_two_corners_in_a_cell_become_their_mean() -> None:
    """A square of 1 m, two corners 10 mm apart, at most one face: in the coarsest of cells, 1/6 m, they are one."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0.99, 1, 0.002]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    found, kept = coarse(vertices, faces, 1)
    assert len(kept) == 1 and sorted(map(tuple, np.round(found, 6).tolist())) == [
        (0, 0, 0),
        (0.995, 1, 0.001),
        (1, 0, 0),
    ]


def test_the_table_is_whole_and_in_two_colours() -> None:
    tiles = [trimesh.Trimesh(solid.vertices, solid.faces, process=False) for solid in table_solids()]
    assert sum(tile.area for tile in tiles) == pytest.approx((2 * HALF) ** 2)
    assert all((tile.face_normals[:, 2] > 0.99).all() and tile.area == pytest.approx(0.08) for tile in tiles)
    assert len({tuple(tile.triangles_center[0].round(4)) for tile in tiles}) == 2


def test_links_that_move_carry_what_is_fixed_to_them() -> None:
    """With all links named, and with rigid bodies alone, the open hand's shapes lie where its preshape has them."""
    preshape = hand().preshapes["NPG"]
    expected = open_hand(hand(), "NPG", "#000000")
    bodies = hand().robot.bodies()
    for names in (list(hand().robot.links), sorted(set(bodies.values()))):
        solids = link_solids(hand(), names)
        T_tcp = [np.linalg.inv(preshape.T_base_tcp) @ preshape.T_base_link[name] for name in names]
        placed = [solid.placed(T) for solid, T in zip(solids, T_tcp, strict=True) if solid is not None]
        found = np.concatenate([solid.vertices for solid in placed])
        assert sum(len(solid.faces) for solid in placed) == len(expected.faces)
        order, wanted = (points[np.lexsort(points.round(6).T)] for points in (found, expected.vertices))
        np.testing.assert_allclose(order, wanted, atol=1e-6)


def test_links_without_shapes_and_shapes_without_links() -> None:
    palm, nothing = link_solids(hand(), ["palm", "mount"])
    assert palm is not None and nothing is None
    assert len(palm.faces) < len(open_hand(hand(), "NPG", "#000000").faces)


def test_each_object_has_a_colour_of_its_own() -> None:
    solids = object_solids(OBJECTS)
    assert len({solid.colour for solid in solids}) == 3 and all(len(solid.faces) <= FACES for solid in solids)
