"""The hand's kinematics against hand-derived numbers, and against SAPIEN's reading of the same URDF."""

import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from trial_objects import jaw_settings, parallel_jaw

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.settings import plain, settings, typed
from spgf_torch.simulation.config import EpisodeConfig


@pytest.mark.parametrize(("kind", "q1"), [("NPG", -0.0497), ("WPG", -0.346)])
def test_preshape_and_tcp_follow_from_the_opening(hand, kind, q1):
    """Pads lie 14.8 mm before the distal axis, knuckles 66 mm apart, proximal links 86.5 mm long.

    opening = 2 (0.033 - 0.0148 - 0.0865 sin q1), so sin q1 = (0.0364 - opening) / 0.173: -0.04971 for 45 mm and
    -0.33873 for 95 mm. The TCP stands 40 mm above the distal axes: 0.0745 + 0.0165 + 0.0865 cos q1 + 0.040.
    """
    preshape = hand.preshapes[kind]
    joints = preshape.joints
    assert joints["finger_1_proximal_joint"] == pytest.approx(q1, abs=5e-4)
    exact = math.asin((0.0364 - hand.preshapes[kind].opening) / 0.173)
    for finger in ("finger_1", "finger_2"):
        assert joints[f"{finger}_proximal_joint"] == pytest.approx(exact, abs=1e-6)
        assert joints[f"{finger}_distal_joint"] == -joints[f"{finger}_proximal_joint"]
        assert joints[f"{finger}_knuckle_joint"] == pytest.approx(math.pi / 2)
    expected = np.array([[0, -1, 0, 0.01905], [1, 0, 0, 0], [0, 0, 1, 0.131 + 0.0865 * math.cos(exact)], [0, 0, 0, 1]])
    np.testing.assert_allclose(preshape.T_base_tcp, expected, atol=2e-7)


def test_pads_meet_where_the_paper_hand_closes(hand):
    """The opening is 0 at sin q1 = 0.0364 / 0.173, q1 = 0.212 (docs/design/simulation.md); positive values close."""
    assert math.asin(0.0364 / 0.173) == pytest.approx(0.212, abs=1e-3)
    assert hand.preshapes["NPG"].closing.phases == ({"finger_1_proximal_joint": 1.0, "finger_2_proximal_joint": 1.0},)


def test_open_hand_leaves_the_space_between_the_pads_free(hand):
    """In the TCP frame the pads' faces lie at +-opening / 2 on x, 24 mm wide on y, and nothing is in between."""
    for kind, preshape in hand.preshapes.items():
        half = hand.preshapes[kind].opening / 2
        pads = [s for s in preshape.shapes if np.abs(s.bounds[:, 0]).min() == pytest.approx(half, abs=1e-6)]
        assert len(pads) == 2
        for pad in pads:
            np.testing.assert_allclose(pad.bounds[:, 1], [-0.012, 0.012], atol=1e-6)
            assert pad.bounds[0, 2] < 0 < pad.bounds[1, 2] < 0.03
        above = [s.bounds for s in preshape.shapes if s.bounds[1, 2] > -0.04]
        assert all(bounds[0, 0] >= half - 1e-6 or bounds[1, 0] <= -half + 1e-6 for bounds in above)


@pytest.mark.parametrize("kind", ["NPG", "WPG"])
def test_sapien_places_links_and_shapes_where_pytorch_kinematics_does(hand, kind):
    """Every moving link's pose, and every corner of every collision shape, within a hundredth of a millimetre."""
    from spgf_torch.simulation import episode
    from spgf_torch.simulation.articulation import HandBuilder

    preshape = hand.preshapes[kind]
    episode.configure(settings(EpisodeConfig))
    material = episode.physx.PhysxMaterial(0.6, 0.6, 0)
    scene = episode.sapien.Scene([episode.physx.PhysxCpuSystem()])
    articulation = HandBuilder(hand.robot, preshape, material).build(scene)
    articulation.set_qpos([preshape.joints[joint.name] for joint in articulation.active_joints])
    corners = []
    for link in articulation.links:
        T_base_link = link.entity.pose.to_transformation_matrix()
        np.testing.assert_allclose(T_base_link, preshape.T_base_link[link.name], atol=1e-5)
        for shape in link.collision_shapes:
            T = T_base_link @ shape.local_pose.to_transformation_matrix()
            signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
            corners.append((signs * shape.half_size) @ T[:3, :3].T + T[:3, 3])
    expected = [s.vertices @ preshape.T_base_tcp[:3, :3].T + preshape.T_base_tcp[:3, 3] for s in preshape.shapes]
    assert len(corners) == len(expected) == 12
    for shape in expected:
        distances = [np.linalg.norm(shape[:, None] - other[None], axis=-1).min(axis=1).max() for other in corners]
        assert min(distances) < 1e-5


def test_hand_travels_to_workers(hand):
    assert pickle.loads(pickle.dumps(hand)).digest == hand.digest


def test_another_gripper_is_another_urdf_and_other_settings(tmp_path: Path):
    """A parallel jaw whose joints open as they grow: each finger stands at half the opening."""
    path = tmp_path / "jaw.urdf"
    path.write_text(parallel_jaw())
    jaw = load_hand(typed(HandConfig, jaw_settings(str(path))))
    assert jaw.preshapes["WPG"].closing.phases == ({"left_joint": -1.0, "right_joint": -1.0},)
    assert jaw.preshapes["WPG"].joints == pytest.approx({"left_joint": 0.0475, "right_joint": 0.0475})
    np.testing.assert_allclose(jaw.preshapes["NPG"].T_base_tcp[:3, 3], [0, 0, 0.1], atol=1e-7)


PINCH = plain(settings(HandConfig))["preshapes"]["NPG"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"urdf": "nowhere.urdf"}, "hand.urdf: expected a URDF file, got nowhere.urdf"),
        ({"root": "wrist"}, "hand.root: expected a link"),
        ({"preshapes": {"NPG": {**PINCH, "opening": 0.5}}}, "NPG.opening: expected 0.000 to 0.209 m, got 0.5"),
        ({"preshapes": {}}, "hand.preshapes: expected one or more, got none"),
        ({"preshapes": {"NPG": {"hold": {"elbow": 3}}}}, "NPG.hold: expected a joint that moves, got elbow"),
        ({"preshapes": {"NPG": {"hold": {"thumb_distal_joint": 91}}}}, "expected -90 to 90 deg, its limits; got 91"),
        ({"fingers": {}}, "hand.fingers: expected two or more, got 0"),
        ({"fingers": {"first": ["finger_1_tip"], "second": ["finger_2_tp"]}}, "did you mean finger_2_tip"),
        ({"closing": {"effort": 2.2}}, "hand.closing.effort: expected at most 2.1, the effort of finger_1_proximal"),
        ({"approach": [0, 0, 0]}, "hand.approach: expected three numbers, not all 0"),
    ],
)
def test_wrong_settings_are_told_in_one_line(change, message):
    with pytest.raises(InputError, match=message):
        load_hand(settings(HandConfig, **change))


def test_damaged_urdf(tmp_path: Path):
    path = tmp_path / "hand.urdf"
    path.write_text("<robot name='x'><link")
    with pytest.raises(InputError, match=r"hand\.urdf: expected a URDF of a hand, got"):
        load_hand(settings(HandConfig, urdf=str(path)))
