"""The phases of a trial by hand: the physics are a script here, what is asked of them is tested."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from trial_objects import box, from_above

from spgf_torch.hands.hand import Hand
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import Simulator, Trial, sapien

# Steps of 1 ms; a window of stalling is 4 steps.
CONFIG = settings(
    EpisodeConfig,
    dt=0.001,
    stall_window=0.004,
    stall_motion=0.001,
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
    """In place of physics and of the object: counts steps, and what is done to the object."""

    def __init__(self, trial: Trial) -> None:
        self.steps = 0
        self.forces: list[list[float]] = []
        self.damping: list[tuple[float, float]] = []
        trial.system = trial.object = self
        self.linear_damping = self.angular_damping = 0.0

    def step(self) -> None:
        self.steps += 1
        self.damping.append((self.linear_damping, self.angular_damping))

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


def test_the_object_is_damped_while_the_fingers_close(jaw: Hand) -> None:
    trial = trial_of(jaw)
    script = Script(trial)
    trial._close()
    assert script.damping == [(7, 7)] * script.steps != []
    assert script.linear_damping == script.angular_damping == 0


@pytest.mark.parametrize(("touch", "held"), [(1, True), (2, False)])
def test_enough_groups_of_fingers_must_touch(jaw: Hand, touch: int, held: bool) -> None:
    trial = trial_of(jaw)
    assert trial.touch == 2
    trial.touch, trial._touching = touch, lambda: {1}
    assert trial._held() == held


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
