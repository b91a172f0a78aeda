"""What the script of a grasp page is given, worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from asymmetric import GRIPPERS, asymmetric
from shown_grasps import CENTRE, ball, beside, shown_grasps, voters
from test_packed import unpacked

from spgf_torch.drawing.grasp_content import EACH, REST, TARGET, VOTES, eyes, page_content
from spgf_torch.drawing.grasp_scene import Beside, look
from spgf_torch.scene.sensed import Sensed


def content(grasps: list, given: Beside | None = None, points: np.ndarray | None = None) -> dict:
    seen, normals = ball()
    return page_content(
        seen if points is None else points, normals, grasps, GRIPPERS, look(normals), [], given or Beside()
    )


def test_poses_are_about_the_middle_of_the_targets() -> None:
    """The TCP stands in the middle of the ball, up to where its outermost points happen to lie; it waits 60 mm back."""
    found = content([asymmetric()])
    np.testing.assert_allclose(found["origin"], CENTRE, atol=0.002)
    grasp = found["grasps"][0]
    np.testing.assert_allclose(grasp["pose"][3::4], CENTRE - found["origin"], atol=1e-5)
    assert grasp["pose"][:3] == [0, -0.866025, 0.5] and grasp["back"] == 0.06
    assert grasp["voted"] == [[7, 30], [3, 12]] and grasp["judged"] is None


def test_a_hand_stands_once_with_its_way_to_closed() -> None:
    """Two boxes of 8 corners and 12 triangles; half-way (step 4 of 8) the left one is 20 mm further along +x."""
    hand = content(shown_grasps(), beside())["hands"]["WPG"]
    assert hand["corners"] == [0, 8, 16] and hand["faces"] == [0, 12, 24] and hand["steps"] == 9
    corners = unpacked(hand["vertices"]).reshape(16, 3)
    np.testing.assert_allclose([corners[:, 0].min(), corners[:, 2].max()], [-0.05, 0.015], atol=1e-7)
    moves = unpacked(hand["moves"]).reshape(9, 2, 3, 4)
    np.testing.assert_allclose(moves[4, :, :, 3], [[0.02, 0, 0], [-0.02, 0, 0]], atol=1e-7)
    still = content([asymmetric()])["hands"]["WPG"]
    assert still["steps"] == 1 and unpacked(still["triangles"]).max() == 7


def test_votes_of_the_best_grasps_are_kept_the_strongest_first() -> None:
    found = content(shown_grasps())
    assert [grasp["votes"] for grasp in found["grasps"]] == [
        {"first": 0, "count": 3, "left": 0},
        {"first": 3, "count": 1, "left": 0},
        *[{"first": 4, "count": 0, "left": 0}] * 2,
    ]
    assert unpacked(found["votes"]["gain"]).tolist() == [1.5, -0.5, 0.25, 0.5]
    assert unpacked(found["votes"]["prototype"]).tolist() == [3, 7, 3, 3]
    assert unpacked(found["votes"]["probability"]).tolist() == [191] * 4  # 0.75 of 255
    assert sorted(found["prototypes"]) == ["3", "7"]
    assert content([asymmetric()])["votes"] == {}


def test_a_page_holds_so_many_votes_and_no_more() -> None:
    many = [replace(asymmetric(), voters=voters(list(np.linspace(1, 2, EACH + 5)))) for _ in range(VOTES // EACH + 1)]
    votes = [grasp["votes"] for grasp in content(many)["grasps"]]
    assert votes[0] == {"first": 0, "count": EACH, "left": 5}
    assert votes[-1] == {"first": VOTES, "count": 0, "left": EACH + 5}
    assert sum(vote["count"] for vote in votes) == VOTES


def test_clouds_keep_their_colours_and_lie_where_they_were() -> None:
    given = beside()
    target, rest = content(shown_grasps(), given)["clouds"]
    seen = given.sensed
    assert unpacked(target["colours"]).tolist() == seen.colours[seen.target].ravel().tolist()
    assert unpacked(rest["colours"]).tolist() == seen.colours[~seen.target].ravel().tolist()
    places = unpacked(rest["points"]).reshape(-1, 3) * rest["points"]["step"] + content(shown_grasps(), given)["origin"]
    np.testing.assert_allclose(places, seen.points[~seen.target], atol=1e-5)
    facing = unpacked(target["normals"]).reshape(-1, 3) / 127
    outwards = (seen.points[seen.target] - CENTRE) / 0.04
    assert np.einsum("pc,pc->p", facing, outwards).min() > 0.9


def test_without_colours_the_table_is_no_obstacle() -> None:
    """Of what was sensed the floor is drawn as the table alone; of obstacles each point is."""
    given = beside()
    bare = replace(
        given, sensed=replace(given.sensed, colours=None), obstacles=np.array([[0.2, 0.2, 0.3], [0.0, 0.2, 0.3]])
    )
    target, rest = content(shown_grasps(), bare)["clouds"]
    assert "colours" not in target and len(unpacked(rest["points"])) == 6
    assert len(content(shown_grasps(), replace(bare, obstacles=np.zeros((0, 3))))["clouds"]) == 1


def test_large_clouds_are_thinned_what_is_near_first() -> None:
    points, _ = ball(TARGET + 100)
    around = np.tile(CENTRE, (REST + 50, 1)) + np.random.default_rng(0).uniform(-3, 3, (REST + 50, 3))
    around[-7:] = CENTRE + 0.05
    every, target = np.concatenate([points, around]), np.arange(TARGET + REST + 150) < TARGET + 100
    given = Beside(sensed=Sensed(every, target, np.zeros((len(every), 3), np.uint8)))
    mine, rest = (unpacked(cloud["points"]).reshape(-1, 3) for cloud in content([], given)["clouds"])
    assert len(mine) == TARGET and len(rest) == REST
    step = content([], given)["clouds"][1]["points"]["step"]
    assert (np.linalg.norm(rest * step - 0.05, axis=1) < 0.01).sum() >= 7


def test_the_table_reaches_around_the_targets() -> None:
    """Under the ball of 40 mm about (0.1, 0.2): 80 mm more to every side, at the height 0.25."""
    found = content(shown_grasps(), beside())
    corners = np.array(found["table"]) + found["origin"]
    np.testing.assert_allclose(corners[:, 2], 0.25, atol=2e-5)
    np.testing.assert_allclose(np.ptp(corners, axis=0)[:2], 0.24, atol=0.004)
    assert content([])["table"] is None


def test_a_camera_is_a_pyramid_towards_what_it_sees() -> None:
    """It looks along +y of the input: its right is +x, its down -z; the image reaches 0.5 to the sides at 1 m."""
    axes = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    reach = np.array([[-0.5, -0.25], [0.5, 0.25]])
    found = content([], Beside(cameras=((np.array([0.1, -0.3, 0.3]), axes, reach), (CENTRE, None, None))))
    whole, place = found["cameras"]
    corners = np.array(whole["corners"]) - whole["eye"]
    np.testing.assert_allclose(corners[0], [-0.02, 0.04, 0.01], atol=1e-5)  # left top: 0.04 (-0.5, 1, 0.25)
    np.testing.assert_allclose(corners[2], [0.02, 0.04, -0.01], atol=1e-5)
    assert "corners" not in place


def test_eyes_are_directions() -> None:
    found = eyes(look(np.tile([0.0, -0.6, 0.8], (9, 1))))
    assert sorted(found) == ["above", "back", "front", "left", "right"]
    for towards in found.values():
        assert np.linalg.norm(towards) == pytest.approx(1)
    assert found["above"][2] > 0.99 and found["left"] @ found["right"] < 0.6 and found["front"] @ found["back"] < 0
