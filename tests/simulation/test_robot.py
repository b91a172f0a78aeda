"""The robot's episode: what any change must keep, what is drawn, why trials end, and that they repeat."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from composing import composed
from test_episode import HELD
from trial_objects import ball, box, can, from_above, from_side, grasp

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import root
from spgf_torch.settings import typed
from spgf_torch.simulation.allotment import open_hand
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.draws import StablePoses, drawn
from spgf_torch.simulation.episode import Simulator
from spgf_torch.simulation.execute import Trials
from spgf_torch.simulation.fast_forward import FastForward
from spgf_torch.simulation.label import Label, outcome_of
from spgf_torch.simulation.precheck import ApproachCheck
from spgf_torch.simulation.robot import RobotTrial, RobotTrials
from spgf_torch.simulation.worker import Case, try_chunk

EXACT = {"mass_spread": 0.0, "friction_spread": 0.0, "pose_error": 0.0, "pose_error_deg": 0.0, "rest": "upright"}
EPISODES = ("robot", "robot_fast")
UP = np.array([0.0, 0.0, 1.0])


def episode(name: str = "robot", friction: float = 0.6, **changes: Any) -> EpisodeConfig:
    """As `episode=NAME` sets it, `changes` in what a robot adds."""
    config = typed(EpisodeConfig, composed("simulate", f"episode={name}")["episode"])
    assert config.robot is not None
    return replace(config, friction=friction, robot=replace(config.robot, **changes))


def label(hand: Hand, obj: GraspObject, T: np.ndarray, kind: str, config: EpisodeConfig) -> Label:
    return RobotTrials(obj, hand, config, kind).run(T)


@pytest.mark.parametrize("name", EPISODES)
@pytest.mark.parametrize("case", HELD)
def test_held_while_floating(hand: Hand, case: str, name: str) -> None:
    obj, T, kind, friction = HELD[case]
    end = label(hand, obj, T, kind, episode(name, friction, floating=1, **EXACT))
    assert (end.outcome, end.phase, end.cause, end.lost) == ("success", "held", "none", "") and end.force > 4


@pytest.mark.parametrize("name", EPISODES)
@pytest.mark.parametrize("case", ["ball, 0.5", "rim of a mug", "rim of a jar", "rim of a thin bin"])
def test_held_from_a_table(hand: Hand, case: str, name: str) -> None:
    obj, T, kind, friction = HELD[case]
    assert label(hand, obj, T, kind, episode(name, friction, floating=0, **EXACT)).outcome == "success"


@pytest.mark.parametrize("name", EPISODES)
@pytest.mark.parametrize(
    ("obj", "T", "friction"),
    [(can(), from_side(0.06), 0.05), (ball(), from_above(0.035), 0.05), (can(mass=2.0), from_side(0.06), 0.6)],
    ids=["slippery can", "slippery ball", "2 kg"],
)
def test_what_slips_does_so_as_it_is_lifted(
    hand: Hand, obj: GraspObject, T: np.ndarray, friction: float, name: str
) -> None:
    end = label(hand, obj, T, "WPG", episode(name, friction, floating=1, **EXACT))
    assert end.outcome in ("dropped", "slipped") and end.phase == "lift"


@pytest.mark.parametrize("name", EPISODES)
def test_a_can_squeezed_on_its_edge_is_lost_when_it_is_turned(hand: Hand, name: str) -> None:
    """Upright on a table, 0.4 kg, pads 15 mm below its top: hanging from them it holds; in the middle, always."""
    tall, config = can(0.033, 0.3, 0.4), episode(name, floating=0, **EXACT)
    end = label(hand, tall, from_side(0.285), "WPG", config)
    assert end.outcome == "rotated" and end.phase in ("turn", "shake") and end.force > 4
    assert label(hand, tall, from_side(0.2), "WPG", config).outcome == "success"


@pytest.mark.parametrize("name", EPISODES)
def test_what_is_light_stays_between_stiff_fingers(name: str) -> None:
    """Half a sponge of 12 g between a Panda's, 50 N on 25000 N/m, that meet it 10 deg askew; long sub-steps lose it."""
    panda = load_hand(typed(HandConfig, yaml.safe_load((root() / "conf/hand/panda.yaml").read_text())))
    T = grasp((0.005, 0.004, 0.085), (0, 0, -1), (np.cos(np.radians(10)), np.sin(np.radians(10)), 0))
    config, light = episode(name, floating=1, **EXACT), box((0.045, 0.07, 0.11), 0.006)
    assert label(panda, light, T, "WPG", config).outcome == "success"
    longer = replace(config, dt=0.005, position_iterations=56)
    assert label(panda, light, T, "WPG", longer).outcome != "success"


@pytest.mark.parametrize("name", EPISODES)
def test_what_is_missed(hand: Hand, name: str) -> None:
    """In empty space neither finger touches."""
    config = episode(name, floating=1, **EXACT)
    end = label(hand, can(), from_above(0.3), "WPG", config)
    assert end == Label("missed", "close", "nothing", 0.0, "finger_1_tip+finger_2_tip")


def test_collisions_by_hand(jaw: Hand) -> None:
    """A jaw 95 mm wide about a box of 60 mm is free from above; a box of 95 mm cuts it.

    From the side its palm, 60 mm high, needs 30 mm above the table. Under a roof, it has met that on its way.
    """
    check = ApproachCheck(box((0.06, 0.06, 0.1)), jaw.preshapes["WPG"], 0.1)
    assert check.met(from_above(0.08), UP, 0.0) is None and check.met(from_above(0.08), UP, None) is None
    assert ApproachCheck(box((0.095, 0.06, 0.1)), jaw.preshapes["WPG"], 0.1).met(from_above(0.08), UP, 0.0) == "object"
    assert check.met(from_side(0.05), UP, 0.0) is None  # the palm is 6 cm high
    assert check.met(from_side(0.02), UP, 0.0) == "table" and check.met(from_side(0.02), UP, None) is None
    below = grasp((0, 0, 0.02), (0, 0, 1), (1, 0, 0))
    assert check.met(below, UP, 0.0) == "table" and check.met(below, UP, None) is None
    roof = box((0.3, 0.3, 0.01)).parts[0] + np.array([0, 0, 0.25])
    roofed = replace(box((0.06, 0.06, 0.1)), parts=(*box((0.06, 0.06, 0.1)).parts, roof))
    assert ApproachCheck(roofed, jaw.preshapes["WPG"], 0.1).met(from_above(0.08), UP, 0.0) == "way"
    assert ApproachCheck(roofed, jaw.preshapes["WPG"], 0.01).met(from_above(0.08), UP, 0.0) is None


def test_stable_poses_of_a_box() -> None:
    """It rests on each of six faces, most often on the largest; the plane is where the face is."""
    poses = StablePoses.of(box((0.02, 0.06, 0.1)))
    found = {
        tuple(np.round(up).astype(int).tolist()): (h, s)
        for up, h, s in zip(poses.up, poses.height, poses.share, strict=True)
    }
    assert StablePoses.of(box((0.02, 0.06, 0.1))) is poses  # found once for an object
    assert len(found) == 6 and poses.share.sum() == pytest.approx(1)
    for up, height in {(1, 0, 0): -0.01, (-1, 0, 0): -0.01, (0, 1, 0): -0.03, (0, 0, 1): 0.0, (0, 0, -1): -0.1}.items():
        assert found[up][0] == pytest.approx(height, abs=1e-9)
    assert found[1, 0, 0][1] > found[0, 1, 0][1] > found[0, 0, 1][1]


def test_draws_lie_in_their_ranges_and_follow_from_the_pose() -> None:
    config = episode(floating=0.25).robot
    assert config is not None
    obj, T = box((0.02, 0.06, 0.1)), from_above(0.08)
    poses = StablePoses.of(obj)
    draws = [drawn(obj, poses, T, config, number) for number in range(400)]
    again = drawn(obj, poses, T, config, 7)
    assert again.mass == draws[7].mass and np.array_equal(again.T_object_tcp, draws[7].T_object_tcp)
    moved = T.copy()
    moved[0, 3] = np.nextafter(moved[0, 3], np.float32(1))
    assert drawn(obj, poses, moved, config, 7).mass != again.mass
    for name, spread in (("mass", 0.5), ("friction", 0.3)):
        values = np.array([getattr(draw, name) for draw in draws])
        assert 1 - spread <= values.min() < 1 - 0.9 * spread and 1 + 0.9 * spread < values.max() <= 1 + spread
    shifts = np.array([np.linalg.norm(draw.T_object_tcp[:3, 3] - T[:3, 3]) for draw in draws])
    assert shifts.max() <= 0.003 + 1e-9 and np.median(shifts) == pytest.approx(0.003 * 0.5 ** (1 / 3), rel=0.05)
    cosines = [(np.trace(draw.T_object_tcp[:3, :3].T @ T[:3, :3]) - 1) / 2 for draw in draws]
    assert 4.5 < np.degrees(np.arccos(min(cosines))) <= 5 + 1e-3
    floating = np.mean([draw.height is None for draw in draws])
    assert floating == pytest.approx(0.25, abs=0.08)
    widest = poses.share[np.abs(poses.up[:, 0]) > 0.5].sum()
    assert np.mean([abs(draw.up[0]) > 0.5 for draw in draws]) == pytest.approx(widest, abs=0.08)


def test_a_budget_counts_what_meets_nothing_on_its_way(jaw: Hand) -> None:
    """From above free; from the side, 5 mm too low for the palm, only the table forbids it."""
    obj, config = box((0.06, 0.06, 0.1)), episode(floating=0, **EXACT)
    needs = [not open_hand(obj, Trials(jaw, config), "WPG")(T) for T in (from_above(0.08), from_side(0.025))]
    assert needs == [True, False]
    bare = replace(config, robot=None)
    assert not open_hand(obj, Trials(jaw, bare), "WPG")(from_side(0.025))


def test_gravity_is_turned_by_a_right_angle_at_a_time(jaw: Hand) -> None:
    """From above, gravity is along the approach at first: +z of the TCP, then -x, -y, -z, x, y."""
    config = episode(floating=0, **EXACT)
    trials = RobotTrials(box((0.038, 0.06, 0.1)), jaw, config, "WPG")
    T, robot = from_above(0.08), config.robot
    assert robot is not None
    draw = drawn(trials.arrival.obj, trials.arrival.poses, T, robot, 0)
    (phase, lift), *moves = RobotTrial(Simulator(trials.arrival.obj, jaw, config), draw, "WPG")._moves()
    assert phase == "lift" and len(lift) == 100 and np.allclose(lift, [0, 0, -12.81])
    assert [phase for phase, _ in moves] == ["turn", "shake"] * 6
    ends = np.array([turn[-1] for _, turn in moves[::2]]) @ T[:3, :3]
    z, x, y = np.array([0, 0, 1]), np.array([1, 0, 0]), np.array([0, 1, 0])
    assert np.allclose(ends, 9.81 * np.array([z, -x, -y, -z, x, y]), atol=1e-5)
    for (_, turn), (_, shake) in zip(moves[::2], moves[1::2], strict=True):
        assert np.allclose(np.linalg.norm(turn, axis=1), 9.81) and len(turn) == 20
        assert np.allclose(shake, turn[-1] * 14.81 / 9.81) and len(shake) == 40


def test_the_table_bears_the_object_and_sinks(jaw: Hand) -> None:
    """After 100 steps at 3 m/s2, 0.2 s, it is 60 mm lower; with nothing to hold it, the object lies on it before."""
    config = episode(floating=0, **EXACT)
    trials = RobotTrials(box((0.038, 0.06, 0.1)), jaw, config, "WPG")
    assert config.robot is not None
    draw = drawn(trials.arrival.obj, trials.arrival.poses, from_above(0.3), config.robot, 0)
    trial = RobotTrial(trials.simulator, draw, "WPG")
    for _ in range(100):
        trial._step()
    assert abs(trial.object.entity.pose.p[2]) < 5e-4
    trial.sunk = 100
    top = trial._table_pose(3.0).p[2] + 0.05
    assert top == pytest.approx(-0.06, abs=1e-6)


def test_mass_and_friction_are_those_drawn(jaw: Hand) -> None:
    config = episode(floating=1, rest="upright")
    trials = RobotTrials(box((0.038, 0.06, 0.1), 0.4), jaw, config, "WPG")
    assert config.robot is not None
    draw = drawn(trials.arrival.obj, trials.arrival.poses, from_above(0.08), config.robot, 3)
    trial = RobotTrial(trials.simulator, draw, "WPG")
    assert trial.object.mass == pytest.approx(0.4 * draw.mass) and draw.mass != 1
    assert np.allclose(trial.object.inertia, np.linalg.eigvalsh(trials.arrival.obj.inertia) * draw.mass, rtol=1e-5)
    assert trial.object.collision_shapes[0].physical_material.dynamic_friction == pytest.approx(0.6 * draw.friction)


def test_trials_repeat_in_any_order(hand: Hand) -> None:
    """To the last digit of the force, also where the draws of trials in between changed friction."""
    trials = RobotTrials(ball(), hand, episode(), "WPG")
    poses = [from_above(height) for height in (0.035, 0.04, 0.03)]
    first = [trials.run(T).word for T in poses]
    assert [trials.run(T).word for T in reversed(poses)] == first[::-1]
    assert any(word.startswith("success") for word in first)


def test_a_worker_says_why(hand: Hand) -> None:
    config = episode(floating=1, **EXACT)
    T = np.stack([from_above(0.035), from_above(0.3)]).astype(np.float32)
    ended = try_chunk(Case.of(ball(), Trials(hand, config), "WPG"), T)
    assert [outcome_of(word or "") for word in ended.outcomes] == ["success", "missed"]
    assert Label.of(ended.outcomes[1] or "").cause == "nothing"


@pytest.mark.parametrize("width", [0.019, 0.06])
def test_fast_forward_stops_before_anything_is_met(jaw: Hand, width: float) -> None:
    """Joints of the jaw are where its pads are, m from the middle; a window of 20 ms at 0.1 m/s is 2 mm.

    A box is met by a pad in one window, and closing goes on from the beginning of the one before that.
    """
    config = episode("robot", floating=1, **EXACT)
    forward = FastForward.of(jaw, "WPG", config)
    assert forward is FastForward.of(jaw, "WPG", config)
    check = ApproachCheck(box((width, 0.06, 0.1)), jaw.preshapes["WPG"], 0.1)
    begun = forward.until(check.there, from_above(0.08), UP, None)
    assert begun is not None and begun.steps % 10 == 0 and begun.steps > 0
    assert all(0.0018 < q - width / 2 < 0.0042 for q in begun.qpos)
    assert all(q > begun.aims[name] for q, name in zip(begun.qpos, ("left_joint", "right_joint"), strict=True))
    assert forward.until(check.there, from_above(0.3), UP, None) is None
    low = forward.until(check.there, from_above(0.3), UP, 0.295)  # the tips reach 10 mm beyond the TCP
    assert low is not None and low.steps == 0


def test_words_of_labels() -> None:
    end = Label("dropped", "shake", "none", 2.3125, "left/tip+right")
    assert end.word == "dropped/shake/none/2.312/left/tip+right"
    assert Label.of(end.word) == replace(end, force=2.312) and Label.of("missed") == Label("missed")
    told = [
        Label("collision", "approach", "way"),
        Label("missed", "close", "one_side", lost="a"),
        end,
        Label("rotated", "turn"),
    ]
    assert [each.told for each in told] == [
        "collision (way)", "missed (one side)", "dropped (shake, without left/tip, right)", "rotated (turn)",
    ]  # fmt: skip
    with pytest.raises(ValueError, match="no label"):
        Label.of("dropped/flown/none/0/")
