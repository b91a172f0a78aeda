"""The hand as an articulation: what moves, what is one body, what collides; and trials of hands that are no pinch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from small_hands import FINGER, described, jaw, jaw_preshape, joint, link, robot
from trial_objects import ball, box, from_above

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.articulation import HandBuilder, Inertia, physx, sapien
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import Simulator, Trial, configure
from spgf_torch.simulation.free_closing import close_without_object

EPISODE = settings(EpisodeConfig)
TIPS = {f"{finger}_proximal_joint": -30.0 for finger in ("finger_1", "finger_2", "thumb")}
UPRIGHT = {f"{finger}_distal_joint": f"{finger}_proximal_joint" for finger in ("finger_1", "finger_2", "thumb")}


@pytest.fixture(scope="module")
def three_fingers() -> Hand:
    """The SDH-2: knuckles at 0, two fingers against the thumb; at 60 deg, all three around the palm's axis."""
    preshapes = {
        "cylinder": {
            "hold": {"finger_1_knuckle_joint": 0, "finger_2_knuckle_joint": 0},
            "close": {"finger_1_proximal_joint": 0.5, "finger_2_proximal_joint": 0.5, "thumb_proximal_joint": 1},
            "oppose": [["thumb"], ["first", "second"]],
            "tcp": {"xyz": [-0.0095, 0, 0.2059], "closing": [1, 0, 0]},
        },
        "sphere": {
            "hold": {"finger_1_knuckle_joint": 60, "finger_2_knuckle_joint": 60},
            "close": dict.fromkeys(TIPS, 1.0),
            "touch": 2,
            "tcp": {"xyz": [0, 0, 0.2059], "closing": [1, 0, 0]},
        },
    }
    return load_hand(
        typed(
            HandConfig,
            {
                "name": "three",
                "urdf": "data/hands/sdh2.urdf",
                "fingers": {"first": ["finger_1_tip"], "second": ["finger_2_tip"], "thumb": ["thumb_tip"]},
                "preshapes": {k: {**p, "open": TIPS, "parallel": UPRIGHT} for k, p in preshapes.items()},
                "closing": {"effort": 1.6, "speed": 2.0, "time": 1.5},
            },
        )
    )


def run(hand: Hand, kind: str, obj, T: np.ndarray) -> tuple[str, Trial]:
    trial = Trial(Simulator(obj, hand, EPISODE), T.astype(np.float64), kind)
    return trial.run(), trial


@pytest.mark.parametrize(("kind", "groups"), [("cylinder", {0, 1}), ("sphere", {0, 1, 2})])
def test_three_fingers_hold_a_ball(three_fingers: Hand, kind: str, groups: set[int]) -> None:
    outcome, trial = run(three_fingers, kind, ball(0.0435, 0.3), from_above(0.0435))
    assert outcome == "success" and trial._touching() == groups


def test_three_fingers_drop_what_is_slippery(three_fingers: Hand) -> None:
    simulator = Simulator(ball(0.0435, 0.3), three_fingers, settings(EpisodeConfig, friction=0.05))
    assert simulator.run(from_above(0.0435), "sphere") in ("dropped", "slipped")


def test_a_hand_with_one_jaw_holds_a_block(tmp_path: Path) -> None:
    """The palm's own wall is the other jaw: it is one body with the palm, and its contact counts as that of `wall`."""
    urdf = robot(
        link("wall", FINGER[0], "-0.005 0 0.03"),
        joint("wall_joint", "wall", kind="fixed", at="-0.02 0 0"),
        link("right", FINGER[0], "0.005 0 0.03"),
        joint("right_joint", "right", axis="1 0 0", limit="-0.02 0.05"),
    )
    preshape = {"open": {"right_joint": 0.03}, "close": {"right_joint": -1}, "oppose": [["wall"], ["right"]]}
    preshape["tcp"] = {"xyz": [0.0, 0, 0.04], "closing": [1, 0, 0]}
    fingers = {"wall": ["wall"], "right": ["right"]}
    hand = described(tmp_path, urdf, fingers=fingers, preshapes={"only": preshape})
    outcome, trial = run(hand, "only", box((0.03, 0.04, 0.06)), from_above(0.04))
    assert len(trial.articulation.links) == 2
    assert outcome == "success"


def test_a_mimic_joint_follows_with_ratio_and_offset(tmp_path: Path) -> None:
    """right = 0.5 left + 5 mm, also where the object stops the fingers: with 22 mm from face to face at 11.3 and 10.7.

    Its own drive is as strong as it must be to stand in for the gears.
    """
    urdf = robot(
        link("left", FINGER[0], "-0.005 0 0.03"),
        link("right", FINGER[0], "0.005 0 0.03"),
        joint("left_joint", "left", axis="-1 0 0"),
        joint("right_joint", "right", axis="1 0 0", mimic="left_joint 0.5 0.005"),
    )
    preshape = {"open": {"left_joint": 0.04}, "close": {"left_joint": -1}}
    hand = described(tmp_path, urdf, preshapes={"only": {**preshape, "oppose": [["left"], ["right"]]}})
    assert hand.preshapes["only"].joints == pytest.approx({"left_joint": 0.04, "right_joint": 0.025})
    free = close_without_object(hand, "only", EPISODE)
    assert free.end == pytest.approx({"left_joint": 0.0, "right_joint": 0.005}, abs=2e-4)
    behind = np.abs(free.joints["right_joint"] - (0.5 * free.joints["left_joint"] + 0.005))
    assert behind.max() < 1e-3  # of 2.5 mm/s and more it is a hundredth of a second late at most
    T = np.linalg.inv(hand.preshapes["only"].T_base_tcp)
    outcome, trial = run(hand, "only", box((0.022, 0.04, 0.06)), from_above(0.06 + T[2, 3]))
    left, right = (trial.fingers.values()[name] for name in ("left_joint", "right_joint"))
    assert outcome == "success" and right == pytest.approx(0.5 * left + 0.005, abs=3e-4)


def elbow(folder: Path, degrees: float, kind: str = "revolute") -> Hand:
    """Each finger has an elbow, 30 mm up, that is held or fixed, and a frame without mass behind it."""
    parts = []
    for name, side, sign in (("left", -1, "-1"), ("right", 1, "1")):
        parts += [
            link(f"{name}_arm", "0.01 0.03 0.03", f"{0.005 * side} 0 0.015"),
            link(name, "0.01 0.03 0.05", f"{0.005 * side} 0 0.025", mass=0.4),
            f'<link name="{name}_frame"/>',
            joint(f"{name}_joint", f"{name}_arm", axis=f"{sign} 0 0"),
            joint(f"{name}_elbow", name, kind, f"{name}_arm", "0 0 0.03", axis="0 1 0", limit="-1 1"),
            joint(f"{name}_frame_joint", f"{name}_frame", "fixed", name, "0 0 0.05"),
        ]
    hold = {} if kind == "fixed" else {"left_elbow": degrees, "right_elbow": -degrees}
    preshapes = {"only": {**jaw_preshape(), "hold": hold}}
    return described(
        folder, robot(*parts), preshapes=preshapes, fingers={n: [f"{n}_frame", n] for n in ("left", "right")}
    )


@pytest.mark.parametrize("kind", ["revolute", "fixed"])
def test_a_held_joint_behind_a_moving_one_stays(tmp_path: Path, kind: str) -> None:
    """It is not limp: under load the shapes stand where the kinematics put them for what moves, within 2 mrad and 1 mm.

    Two links of 0.1 and 0.4 kg, the frame without any, are one body of 0.5 kg.
    """
    hand = elbow(tmp_path, 10.0, kind)
    T = np.linalg.inv(hand.preshapes["only"].T_base_tcp)
    outcome, trial = run(hand, "only", box((0.03, 0.06, 0.08), mass=0.4), from_above(0.08 + 0.075 + T[2, 3]))
    assert outcome == "success"
    assert [round(body.mass, 6) for body in trial.articulation.links[1:]] == [0.5, 0.5]
    links = Kinematics(hand.robot).links(trial.fingers.values())
    T_world_base = trial.articulation.links[0].entity.pose.to_transformation_matrix()
    bodies = {body.name: body for body in trial.articulation.links}
    for name in ("left", "right"):
        (upper,) = trial.builder.shapes(trial.articulation, {name})
        made = (
            bodies[f"{name}_arm"].entity.pose.to_transformation_matrix() @ upper.local_pose.to_transformation_matrix()
        )
        wanted = T_world_base @ links[name]
        assert np.linalg.norm(made[:3, :3] - wanted[:3, :3]) / np.sqrt(2) < 2e-3  # rad, of small turns
        middle = wanted[:3, :3] @ [0.005 if name == "right" else -0.005, 0, 0.025] + wanted[:3, 3]
        np.testing.assert_allclose(made[:3, 3], middle, atol=1e-5)


def test_contact_of_what_is_fixed_to_a_fingers_link_counts(tmp_path: Path) -> None:
    """The fingers are named by frames without shapes, behind fixed joints, as in most public URDFs."""
    frames = [
        part
        for name in ("left", "right")
        for part in (f'<link name="{name}_tcp"/>', joint(f"{name}_tcp_joint", f"{name}_tcp", "fixed", name, "0 0 0.05"))
    ]
    fingers = {"left": ["left_tcp"], "right": ["right_tcp"]}
    tcp = {"xyz": [0, 0, 0.04], "closing": [1, 0, 0]}
    hand = described(tmp_path, jaw(*frames), fingers=fingers, preshapes={"only": jaw_preshape(tcp=tcp)})
    outcome, _ = run(hand, "only", box((0.03, 0.04, 0.06)), from_above(0.04))
    assert outcome == "success"


def test_what_overlaps_does_not_jam_or_explode(tmp_path: Path) -> None:
    """A finger that reaches into the palm, and two that overlap in the open hand: all move as if alone.

    Without that they are thrown apart: PhysX pushes what overlaps out of each other.
    """
    urdf = jaw(
        link("third", "0.01 0.03 0.08", "-0.008 0.01 0.02"),  # 20 mm into the palm, 7 mm into the left finger
        joint("third_joint", "third", axis="-1 0 0"),
    )
    preshape = jaw_preshape(oppose=[["left", "third"], ["right"]])
    preshape["open"] = {**preshape["open"], "third_joint": 0.03}
    preshape["close"] = {**preshape["close"], "third_joint": -0.5}
    fingers = {"left": ["left"], "third": ["third"], "right": ["right"]}
    hand = described(tmp_path, urdf, fingers=fingers, preshapes={"only": preshape})
    free = close_without_object(hand, "only", EPISODE)
    assert max(free.drift.values()) < 1e-6 and not free.exploded and free.still
    assert free.joints["third_joint"][100] == pytest.approx(free.joints["left_joint"][100], abs=2e-3)


def test_pieces_of_a_mesh_file_are_the_fingers_shapes(tmp_path: Path) -> None:
    """An L of 60 and 30 mm, cut into convex pieces: each stands in its place, and the foot, not the hull, holds."""
    outline = np.array([(0, 0), (0.01, 0), (0.01, 0.06), (-0.02, 0.06), (-0.02, 0.05), (0, 0.05)])
    corners = np.concatenate([np.insert(outline, 1, y, axis=1) for y in (-0.015, 0.015)])
    cap = np.array([(0, 1, 2), (0, 2, 5), (2, 3, 5), (3, 4, 5)])
    sides = [((k, n, k + 6), (n, n + 6, k + 6)) for k in range(6) for n in [(k + 1) % 6]]
    faces = np.concatenate([cap, cap[:, ::-1] + 6, np.reshape(sides, (-1, 3))[:, ::-1]])
    hook = trimesh.Trimesh(corners, faces)
    assert hook.is_volume and hook.volume == pytest.approx(0.03 * (0.01 * 0.06 + 0.02 * 0.01))
    hook.export(tmp_path / "hook.stl")
    box_ = f'<origin xyz="0.005 0 0.03"/><geometry><box size="{FINGER[0]}"/></geometry>'
    urdf = jaw().replace(box_, '<origin xyz="0.02 0 0"/><geometry><mesh filename="hook.stl"/></geometry>')
    hand = described(tmp_path, urdf, preshapes={"only": jaw_preshape()})
    pieces = [shape for shape in hand.robot.collisions if shape.link == "right"]
    assert len(pieces) >= 2 and all(piece.cut for piece in pieces)
    configure(EPISODE)
    builder = HandBuilder(hand.robot, hand.preshapes["only"], physx.PhysxMaterial(0.6, 0.6, 0))
    articulation = builder.build(sapien.Scene([physx.PhysxCpuSystem()]))
    shapes = builder.shapes(articulation, {"right"})
    assert len(shapes) == len(pieces) and not builder.shapes(articulation, {"none"})
    for shape, piece in zip(shapes, pieces, strict=True):
        T = shape.local_pose.to_transformation_matrix()
        made = np.asarray(shape.vertices) * shape.scale @ T[:3, :3].T + T[:3, 3]
        bounds = np.stack([made.min(axis=0), made.max(axis=0)])
        np.testing.assert_allclose(bounds, piece.mesh.bounds + np.array([0.02, 0, 0]), atol=1e-5)


def test_inertia_of_parts_by_hand() -> None:
    """1 kg at x = 0 and 3 kg at x = 4: the centre is at 3, and 1 * 9 + 3 * 1 = 12 kg m2 are added about y and z.

    The second part is turned by a quarter about z, which exchanges its moments about x and y.
    """
    first = Inertia(1.0, np.zeros(3), np.diag([1.0, 2.0, 3.0]))
    T = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1])
    T[0, 3] = 4.0
    whole = Inertia.together([first, Inertia(3.0, np.zeros(3), np.diag([5.0, 7.0, 9.0])).moved(T)])
    assert whole.mass == 4.0
    np.testing.assert_allclose(whole.centre, [3, 0, 0], atol=1e-12)
    np.testing.assert_allclose(whole.tensor, np.diag([1 + 7, 2 + 5 + 12, 3 + 9 + 12]), atol=1e-12)
