"""The phases of a trial by hand: the physics are a script here, what is asked of them is tested."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from trial_objects import box, from_above, from_side

from spgf_torch.hands.hand import Hand
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import Simulator, Trial, sapien

# Steps of 1 ms; a window of stalling is 4 steps, and closing takes 40 at most.
CONFIG = settings(
    EpisodeConfig,
    dt=0.001,
    stall_window=0.004,
    stall_motion=0.001,
    close_time=0.04,
    gravity=10,
    hold_acceleration=3,
    hold_time=0.3,
    shake_acceleration=2,
    shake_time=0.1,
    max_slip=0.02,
    max_rotation_deg=30,
    damping=7,
)


def trial_of(hand: Hand, config: EpisodeConfig = CONFIG, mass: float = 0.2) -> Trial:
    obj = box((0.038, 0.06, 0.1), mass)
    return Trial(Simulator(obj, hand, config), from_above(0.08).astype(np.float64), "WPG")


def test_loads_by_hand(jaw: Hand) -> None:
    """Lifted with 3 m/s2 the object weighs 13 m/s2 in the hand; each direction of shaking comes once, both ways."""
    (lift, hold), *shakes = trial_of(jaw)._loads()
    assert lift.tolist() == [0, 0, -13] and hold == 0.3
    assert [(way.tolist(), time) for way, time in shakes] == [
        ([2, 0, -10], 0.1), ([0, 2, -10], 0.1), ([0, 0, -8], 0.1),
        ([-2, 0, -10], 0.1), ([0, -2, -10], 0.1), ([0, 0, -12], 0.1),
    ]  # fmt: skip


class Script:
    """In place of physics: counts steps, and moves the two fingers to where they are said to be after each."""

    def __init__(self, trial: Trial, fingers: Callable[[int], tuple[float, float]] = lambda step: (0.0, 0.0)) -> None:
        self.steps, self.fingers, self.targets = 0, fingers, ([], [])
        self.forces: list[list[float]] = []
        self.damping: list[tuple[float, float]] = []
        trial.system = self
        trial.articulation = self
        trial.object = self
        trial.proximal_joints = [SimpleNamespace(set_drive_target=goals.append) for goals in self.targets]
        self.linear_damping = self.angular_damping = 0.0

    def step(self) -> None:
        self.steps += 1
        self.damping.append((self.linear_damping, self.angular_damping))

    @property
    def qpos(self) -> np.ndarray:
        return np.array(self.fingers(self.steps), dtype=np.float32)

    def add_force_torque(self, force: np.ndarray, torque: np.ndarray) -> None:
        assert not torque.any()
        self.forces.append(force.tolist())


@pytest.mark.parametrize(("steps", "looks"), [(25, [10, 20, 25]), (20, [10, 20]), (3, [3])])
def test_the_object_is_looked_at_every_ten_steps_and_at_the_end(jaw: Hand, steps: int, looks: list[int]) -> None:
    """It is pushed with mass times acceleration, 0.5 kg and (1, 0, -8) m/s2, before each step."""
    trial, seen = trial_of(jaw, mass=0.5), []
    script = Script(trial)
    trial._failure = lambda start: seen.append(script.steps)
    assert trial._load(np.array([1.0, 0, -8]), steps * 0.001, sapien.Pose()) is None
    assert seen == looks and script.steps == steps and script.forces == [[0.5, 0, -4]] * steps


def test_a_failure_ends_the_load(jaw: Hand) -> None:
    trial = trial_of(jaw)
    script = Script(trial)
    trial._failure = lambda start: "slipped" if script.steps == 20 else None
    assert trial._load(np.zeros(3), 0.05, sapien.Pose()) == "slipped" and script.steps == 20


def test_closing_ends_when_the_fingers_stand_still_for_two_windows(jaw: Hand) -> None:
    """The second finger moves 2 mm in the first window, 0.5 mm in the second, 2 mm in the third, then no more.

    One window of standing still is not enough, so it ends with the fifth; all the while the object is damped.
    """
    at = [0.0, 0.002, 0.0025, 0.0045, 0.0045, 0.0045, 0.0045]
    trial = trial_of(jaw)
    script = Script(trial, lambda step: (0.0, -at[step // 4]))
    trial._close()
    assert script.steps == 20 and script.damping == [(7, 7)] * 20
    assert script.linear_damping == script.angular_damping == 0


def test_closing_ends_with_its_time(jaw: Hand) -> None:
    trial = trial_of(jaw)
    script = Script(trial, lambda step: (0.01 * step, 0.0))
    trial._close()
    assert script.steps == 40


def test_targets_lead_the_fingers_and_never_go_back(jaw: Hand) -> None:
    """0.1 m/s are 0.1 mm a step; 20 N at 2000 N/m lead 10 mm, here 0.5 mm by 1 N.

    The first finger stands at 1 mm in the direction of closing. So its targets go to 1.1, 1.2, ... and stay at 1.5 mm.
    The second one is thrown back from 1 mm to 0 after two steps, and its targets stay where they were.
    """
    trial, sign = trial_of(jaw), jaw.closing
    hand = SimpleNamespace(closing=sign, config=SimpleNamespace(**{**vars(jaw.config), "closing_torque": 1.0}))
    trial.hand = hand
    script = Script(trial, lambda step: (0.001 * sign, 0.001 * sign if step < 2 else 0.0))
    trial._close()
    first, second = (sign * 1000 * np.array(goals) for goals in script.targets)
    np.testing.assert_allclose(first[:7], [1.1, 1.2, 1.3, 1.4, 1.5, 1.5, 1.5], rtol=1e-6)
    np.testing.assert_allclose(second[:5], [1.1, 1.2, 1.2, 1.2, 1.2], rtol=1e-6)


def test_distal_joints_keep_the_pads_parallel(hand: Hand) -> None:
    """Each turns back what the proximal joint of its own finger turns."""
    trial = Trial(Simulator(box((0.038, 0.06, 0.1)), hand, CONFIG), from_side(0.05).astype(np.float64), "WPG")
    q = np.arange(1.0, 1.0 + len(trial.articulation.qpos)) / 10
    trial._turn_distal(q)
    expected = [-float(q[index]) for index in trial.proximal]
    assert len(expected) == 2 and expected[0] != expected[1]
    assert [float(np.ravel(joint.drive_target)[0]) for joint in trial.distal_joints] == pytest.approx(expected)


def turned(T: sapien.Pose, degrees: float, about: np.ndarray) -> sapien.Pose:
    """A pose turned about the world's y axis through a point."""
    half = math.radians(degrees) / 2
    there, back = sapien.Pose(p=about), sapien.Pose(p=-about)
    return there * sapien.Pose(q=[math.cos(half), 0, math.sin(half), 0]) * back * T


def failure(trial: Trial, move: Callable[[sapien.Pose], sapien.Pose], held: bool) -> str | None:
    trial._held = lambda: held
    start = sapien.Pose([0.01, 0.02, 0.03], [0.6, 0, 0, 0.8])
    trial.object = SimpleNamespace(entity=SimpleNamespace(pose=move(start)))
    return trial._failure(start)


def test_what_counts_as_slipped_dropped_and_rotated(jaw: Hand) -> None:
    """More than 20 mm at the TCP, which is 80 mm above the origin, or more than 30 degrees; both ways.

    About the origin 14 degrees move the TCP by 2 80 sin 7 = 19.5 mm, 15 by 20.9 mm.
    """
    trial: Any = trial_of(jaw)
    tcp, origin = np.array([0, 0, 0.08]), np.zeros(3)
    assert trial.tcp.p.tolist() == pytest.approx(tcp.tolist())
    for sign in (-1, 1):
        for shift, expected in ((0.019, None), (0.021, "slipped")):
            way = sapien.Pose(p=[0, sign * shift, 0])
            assert failure(trial, lambda T, way=way: way * T, held=True) == expected
            assert failure(trial, lambda T, way=way: way * T, held=False) == (expected and "dropped")
        for angle, about, expected in (
            (29, tcp, None), (31, tcp, "rotated"), (14, origin, None), (15, origin, "slipped"), (190, tcp, "rotated")
        ):  # fmt: skip
            moved = failure(trial, lambda T, a=sign * angle, c=about: turned(T, a, c), held=True)
            assert moved == expected
