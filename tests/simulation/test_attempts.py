"""Attempts in clutter: what is lifted and why not, what is left, and that an attempt is the same to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clutter_scenes import FAST, arrangement, poses, small_things, standing, told
from omegaconf import OmegaConf
from scipy.spatial.transform import Rotation
from test_episode import HELD
from trial_objects import box, can, cup, from_above, from_side, grasp

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.library import load_object
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.arrangements import Placed, arranged, settled
from spgf_torch.simulation.attempts import Attempt, Attempts
from spgf_torch.simulation.clutter_config import AttemptConfig
from spgf_torch.simulation.fingers import Fingers
from spgf_torch.simulation.table import read_table
from spgf_torch.simulation.touching import TABLE

BRICK = box((0.038, 0.06, 0.1))


def of(hand: Hand, **changes) -> Attempts:
    return Attempts(hand, FAST, settings(AttemptConfig, **changes), arrangement())


@pytest.fixture(scope="module")
def panda() -> Hand:
    return load_hand(typed(HandConfig, OmegaConf.to_container(OmegaConf.load(root() / "conf/hand/panda.yaml"))))


@pytest.fixture(scope="module")
def three_fingers() -> Hand:
    return load_hand(typed(HandConfig, OmegaConf.to_container(OmegaConf.load(root() / "conf/hand/sdh2_fingers.yaml"))))


@pytest.fixture(scope="module")
def mimic() -> Hand:
    return load_hand(typed(HandConfig, OmegaConf.to_container(OmegaConf.load(root() / "conf/hand/robotiq_2f.yaml"))))


def tried(attempts: Attempts, placed: list[Placed], target: Placed, T_object_tcp: np.ndarray, kind: str) -> Attempt:
    return attempts.run(placed, target.T_world_object @ T_object_tcp, kind)


@pytest.mark.parametrize("case", ["ball, 0.5", "rim of a mug", "rim of a jar", "rim of a thin bin"])
def test_what_holds_in_a_trial_is_lifted(hand, case):
    obj, T, kind, friction = HELD[case]
    attempts = Attempts(hand, replace(FAST, friction=friction), settings(AttemptConfig), arrangement())
    target = standing(obj, 0.03, -0.02)
    end = tried(attempts, [target], target, T, kind)
    assert (end.outcome, end.cause, end.taken, end.gripped, end.placed) == ("success", "none", 0, (0,), ())
    assert 0 < end.seconds < 60


def test_exactly_one_is_lifted_and_the_others_stay(hand):
    """The middle one of three, from above; the others are 13 and 15 cm away and do not move at all."""
    placed = [standing(can(), -0.13), standing(BRICK), standing(cup(), 0.0, 0.15)]
    end = tried(of(hand), placed, placed[1], from_above(0.08), "WPG")
    assert (end.outcome, end.taken, end.touched, end.gripped, end.disturbed, end.lost) == (
        "success",
        1,
        (),
        (1,),
        (),
        (),
    )
    assert poses(end.placed) == poses((placed[0], placed[2]))


@pytest.mark.parametrize(
    ("robot", "kind"), [("panda", "WPG"), ("three_fingers", "cylinder_tip"), ("mimic", "pinch_wide")]
)
def test_any_hand_lifts(request, robot, kind):
    """A jaw that slides, three fingers, and one of knuckles that follow another."""
    hand, target = request.getfixturevalue(robot), standing(can(), 0.02, 0.03)
    end = tried(of(hand), [target], target, from_above(0.1), kind)
    assert (end.outcome, end.cause, end.taken) == ("success", "none", 0)


def test_air_is_empty(hand):
    target = standing(can())
    end = tried(of(hand), [target], target, from_above(0.3), "WPG")
    assert (end.outcome, end.cause, end.taken, end.touched, end.gripped) == ("failed", "empty", None, (), ())
    assert poses(end.placed) == poses((target,))


def test_a_neighbour_in_the_way(hand):
    """A pregrasp within a neighbour; one above it, through which the fingers come; the table in their way."""
    low, tall = standing(box((0.04, 0.06, 0.05))), standing(replace(box((0.06, 0.06, 0.2)), name="tall"), 0.075)
    end = tried(of(hand), [low, tall], low, from_above(0.03), "WPG")
    assert (end.outcome, end.cause, end.touched, end.taken) == ("failed", "pregrasp", (1,), None)
    less = standing(replace(box((0.06, 0.06, 0.09), mass=2.0), name="less"), 0.075)
    end = tried(of(hand), [low, less], low, from_above(0.03), "WPG")
    assert (end.cause, end.touched, end.taken) == ("approach", (1,), None)
    end = tried(of(hand), [low], low, from_above(-0.05, x=0.15), "WPG")
    assert (end.cause, end.touched) == ("table", (TABLE,))


def test_an_approach_that_does_not_stop_pushes_on(panda):
    """A light box stands in the way of one finger: the hand stops there, or pushes it 5 cm on and takes the can."""
    target, light = standing(can()), standing(box((0.03, 0.03, 0.08), mass=0.02), -0.055, -0.04)
    stopped = tried(of(panda), [target, light], target, from_side(0.06), "WPG")
    assert (stopped.cause, stopped.touched, stopped.gripped, stopped.disturbed) == ("approach", (1,), (), ())
    pushed = tried(of(panda, stop_at_contact=False), [target, light], target, from_side(0.06), "WPG")
    assert (pushed.outcome, pushed.taken, pushed.touched[0], pushed.disturbed) == ("success", 0, 1, (1,))


def test_what_slips_is_dropped(panda):
    slippery = Attempts(panda, replace(FAST, friction=0.05), settings(AttemptConfig), arrangement())
    target = standing(can(mass=0.8))
    end = tried(slippery, [target], target, from_side(0.06), "WPG")
    assert (end.outcome, end.cause, end.gripped, len(end.placed)) == ("failed", "dropped", (0,), 1)


def test_two_that_are_lifted_are_no_success(panda):
    """Two boxes side by side between the fingers."""
    pair = [standing(replace(box((0.025, 0.04, 0.08)), name=name), x) for name, x in (("a", -0.0126), ("b", 0.0126))]
    end = of(panda).run(pair, standing(BRICK).T_world_object @ from_above(0.06), "WPG")
    assert (end.outcome, end.cause, end.taken, end.gripped, len(end.placed)) == ("failed", "several", None, (0, 1), 2)


def test_what_leant_on_it_is_disturbed_and_what_ends_outside_is_lost(panda):
    """A plate that leans on a box, 15 deg off the vertical, falls flat, outwards by 4 cm, as the box is lifted."""
    target, lean = standing(replace(BRICK, name="target"), 0.0, 0.1), np.radians(15)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("x", -lean).as_matrix()
    T[1, 3] = 0.07 - 0.09 * np.sin(lean) - 0.006
    leaning = settled([target, Placed(box((0.08, 0.005, 0.09), mass=0.05), T)], arrangement())
    assert leaning[1].T_world_object[2, 2] == pytest.approx(np.cos(lean), abs=0.05)
    grasp_at = leaning[0].T_world_object @ from_above(0.06)
    end = of(panda).run(leaning, grasp_at, "WPG")
    assert (end.outcome, end.taken, end.gripped, end.disturbed, end.lost) == ("success", 0, (0,), (1,), ())
    assert end.placed[0].centre[2] == pytest.approx(0.0025, abs=0.001)
    narrow = Attempts(panda, FAST, settings(AttemptConfig), arrangement(lost=0.08))
    end = narrow.run(leaning, grasp_at, "WPG")
    assert (end.outcome, end.disturbed, end.lost, end.placed) == ("success", (), (1,), ())


def test_an_attempt_is_the_same_in_any_order(hand, panda):
    """Whatever ran before, with another hand, and with a film or without."""
    placed = arranged(small_things(), 4, 2, arrangement())
    attempts, other = of(hand), of(panda)
    grasps = [each.T_world_object @ from_above(each.obj.mesh.extents[2] - 0.02, 0.005) for each in placed]
    first = [told(attempts.run(placed, T, "WPG")) for T in grasps]
    other.run(placed, grasps[0], "NPG")
    again = [told(of(hand).run(placed, T, "WPG", film=True)) for T in reversed(grasps)]
    assert again[::-1] == first
    assert len({str(end) for end in first}) > 1


# object of data/trials -> rows of it that held while floating, and that geometry lets come above a table
SHIPPED = {"carton_rice": (1010, 1025, 1040, 1060), "carton_milk": (1012, 1022, 1032, 1037), "canister": (25, 44)}


def squeezed(hand: Hand) -> list[str]:
    """Causes of these grasps, of boxes and a can that stand."""
    causes = []
    for name, rows in SHIPPED.items():
        table = read_table(root() / "data/trials" / f"{name}.parquet")
        target = standing(load_object(root() / "data/objects" / f"{name}.yaml"))
        for row in rows:
            T, kind = table.T_object_tcp[row].numpy(), table.grasp_types[int(table.grasp_type[row])]
            causes.append(tried(of(hand), [target], target, T, kind).cause)
    return causes


def test_nothing_is_dropped_for_want_of_squeeze(hand, monkeypatch):
    assert squeezed(hand) == ["none"] * 10
    monkeypatch.setattr(Fingers, "squeeze", Fingers.keep_linked)  # targets frozen once the hand has closed
    assert squeezed(hand).count("dropped") >= 5


def test_retreat(panda):
    """Up is up; back is along the approach where that is steep: 40 deg off the vertical, it is 9.6 cm aside."""
    c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
    target = standing(can(0.025, 0.12, 0.1))
    T = target.T_world_object @ grasp((0, 0, 0.09), (0, s, -c), (1, 0, 0))
    for retreat, way in (("up", [0, 0, 0.15]), ("back", [0, -0.15 * s, 0.15 * c])):
        motion = of(panda, retreat=retreat).run([target], T, "WPG", film=True).motion
        assert motion is not None
        hand_at = motion.links[:, motion.link_names.index("panda_hand"), :3, 3]
        settled_at = motion.times > motion.times[-1] - 0.1
        lowest = hand_at[np.argmin(hand_at[:, 2])]
        assert np.allclose(hand_at[settled_at] - lowest, way, atol=0.002)


def test_the_motion_of_a_film(panda):
    target, other = standing(can(), 0.02), standing(replace(BRICK, name="other"), 0.0, 0.15)
    T = target.T_world_object @ from_above(0.1)
    end = of(panda, frame_time=0.05).run([target, other], T, "WPG", film=True)
    motion, preshape = end.motion, panda.preshapes["WPG"]
    assert end.outcome == "success" and motion is not None
    frames, links = len(motion.times), len(motion.link_names)
    assert np.allclose(np.diff(motion.times), 0.05) and 25 < frames < 60
    assert motion.objects.shape == (frames, 2, 4, 4) and motion.links.shape == (frames, links, 4, 4)
    assert set(motion.link_names) == set(preshape.shape_links)
    start = T @ np.linalg.inv(preshape.T_base_tcp)
    start[2, 3] += 0.1
    for k, name in enumerate(motion.link_names):  # open, 10 cm above
        assert np.allclose(motion.links[0, k], start @ preshape.T_base_link[name], atol=2e-4)
    left, right = (motion.link_names.index(f"panda_{side}finger") for side in ("left", "right"))
    apart = np.linalg.norm(motion.links[:, left, :3, 3] - motion.links[:, right, :3, 3], axis=1)
    assert apart[0] == pytest.approx(0.08, abs=1e-3) and apart[-1] == pytest.approx(0.066, abs=2e-3)  # the can's width
    assert (
        motion.objects[-1, 0, 2, 3] == pytest.approx(0.15, abs=0.005)
        and np.ptp(motion.objects[:, 1], axis=0).max() == 0
    )
