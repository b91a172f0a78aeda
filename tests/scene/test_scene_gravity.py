"""What is taken for up, and how sure of it."""

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.gravity import Gravity, gravity_of
from spgf_torch.sensing.cameras import look_at
from spgf_torch.settings import settings

ELSEWHERE = np.array([[0.3, -0.4, 0.5]])


def up(
    viewpoints: np.ndarray | None = None, turns: list[np.ndarray] | None = None, ahead: float = 0.0, **given
) -> Gravity:
    found = gravity_of(settings(SceneConfig, **given), viewpoints, turns or (), ahead)
    assert found is not None
    return found


def test_null_lets_hands_come_from_anywhere() -> None:
    assert gravity_of(settings(SceneConfig, gravity=None), ELSEWHERE) is None


def test_a_given_direction_is_turned_round_and_scaled() -> None:
    found = up(gravity=[0, -2, 0])
    np.testing.assert_allclose(found.up, [0, 1, 0])
    assert found.within_deg == 0 and found.steepest == pytest.approx(np.sin(np.deg2rad(10)))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([0, 0, 0], "gravity: expected a direction other than 0"),
        ([0, 1], "gravity: expected 3 finite numbers"),
        ("down", r"gravity: expected auto, null or \[x,y,z\], got down"),
    ],
)
def test_directions_that_are_none(given: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        gravity_of(settings(SceneConfig, gravity=given), None)


def test_clouds_seen_from_elsewhere_than_their_origin_have_z_up() -> None:
    for viewpoints in (ELSEWHERE, None):
        np.testing.assert_array_equal(up(viewpoints).up, [0, 0, 1])


def test_a_cloud_in_its_cameras_frame_has_an_upright_picture() -> None:
    """y is down and z ahead in an optical frame, y up and z back in OpenGL's: up is half-way between up and back."""
    half = np.sqrt(0.5)
    np.testing.assert_allclose(up(np.zeros((1, 3)), ahead=1.0).up, [0, -half, -half])
    np.testing.assert_allclose(up(np.zeros((1, 3)), ahead=-1.0).up, [0, half, half])
    assert up(np.zeros((1, 3)), ahead=1.0).within_deg == 30
    assert up(np.zeros((1, 3))).up.tolist() == [0, 0, 1]  # a robot's base, which sees nothing ahead of its z


@pytest.mark.parametrize("elevation", [15, 30, 45, 60, 75])
def test_cameras_that_look_down_know_up_within_30_deg(elevation: float) -> None:
    """In a frame that is turned any way: the camera's own frame, where up is R^T z."""
    eye = np.array([np.cos(np.deg2rad(elevation)), 0.2, np.sin(np.deg2rad(elevation))])
    R = look_at(eye, np.array([0, 0.2, 0.0]))[:3, :3]
    found = up(turns=(np.eye(3),))
    assert found.up @ (R.T @ [0, 0, 1]) >= np.cos(np.deg2rad(30.01))
    np.testing.assert_array_equal(up(turns=(R,)).up, [0, 0, 1])


def test_poses_in_a_frame_whose_z_is_not_up_are_doubted() -> None:
    """Lying frames, OpenGL's and inverted poses: z stays up, and the disagreement is said. Rolled cameras by 45 deg and
    cameras all around are not."""
    R = look_at(np.array([0.5, 0, 0.5]), np.zeros(3))[:3, :3]
    lying = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z of the world becomes y of the input
    for turn in (lying @ R, R @ np.diag([1.0, -1, -1]), R @ np.diag([-1.0, -1, 1])):
        found = up(turns=(turn,))
        assert found.up.tolist() == [0, 0, 1] and "deg apart" in found.doubt
    around = tuple(
        look_at(np.array([x, y, 0.1]), np.zeros(3))[:3, :3] for x, y in ((1, 0), (-1, 0.1), (0, 1), (0.1, -1))
    )
    roll = np.deg2rad(45)
    rolled = R @ np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    for turns in ((R,), (rolled,), around):
        assert up(turns=turns).doubt == ""
