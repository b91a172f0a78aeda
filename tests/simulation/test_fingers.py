"""How the fingers close, by hand: where the joints are after each step is a script here, not physics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spgf_torch.hands.preshape import Closing, Drive
from spgf_torch.hands.robot import Follow
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.fingers import Fingers, moving_joints, resolved

# Steps of 1 ms; a window of stalling is 4 steps, 1 mm in it is motion.
CONFIG = settings(EpisodeConfig, dt=0.001, stall_window=0.004, stall_motion=0.001, stall_share=0.1)

# 0.1 m/s are 0.1 mm a step; 1 N at 2000 N/m leads by 0.5 mm; 40 steps at most.
CLOSING = Closing(({"a": -1.0, "b": -1.0},), {}, effort=1.0, speed=0.1, time=0.04)

Script = Callable[[int], tuple[float, ...]]


def scripted(script: Script, closing: Closing = CLOSING, jaw: bool = True, mimics: tuple[str, ...] = ()) -> Any:
    """Fingers of the joints a, b, ... at the places of `script(step)`; `targets` are what their drives were told."""
    names = "abcdef"[: len(script(0))]
    targets: dict[str, list[float]] = {name: [] for name in names}
    clock = SimpleNamespace(step=0)

    class Articulation:
        def __init__(self) -> None:
            self.active_joints = [
                SimpleNamespace(name=n, set_drive_properties=lambda *drive: None, set_drive_target=targets[n].append)
                for n in names
            ]

        @property
        def qpos(self) -> np.ndarray:
            return np.array(script(clock.step), dtype=np.float32)

        def set_qpos(self, values: list[float]) -> None:
            assert values == [0.0] * len(names)

    def step() -> None:
        clock.step += 1

    preshape: Any = SimpleNamespace(
        closing=closing, jaw=jaw, joints=dict.fromkeys(names, 0.0), drives=dict.fromkeys(names, Drive(2000, 60, 70))
    )
    robot: Any = SimpleNamespace(joints=[SimpleNamespace(name=n, mimic=n in mimics) for n in names])
    fingers: Any = Fingers(Articulation(), robot, preshape, CONFIG, step)
    for told in targets.values():
        assert told == [0.0]  # the open hand
        told.clear()
    fingers.targets, fingers.clock = targets, clock
    return fingers


def test_targets_lead_the_fingers_and_never_go_back() -> None:
    """The first finger stands at 1 mm in the direction of closing: targets go to 1.1, 1.2, ... and stay at 1.5 mm.

    The second one is thrown back from 1 mm to 0 after two steps, and its targets stay where they were.
    """
    fingers = scripted(lambda step: (-0.001, -0.001 if step < 2 else 0.0))
    fingers.close()
    np.testing.assert_allclose(1000 * np.array(fingers.targets["a"][:7]), [-1.1, -1.2, -1.3, -1.4, -1.5, -1.5, -1.5])
    np.testing.assert_allclose(1000 * np.array(fingers.targets["b"][:5]), [-1.1, -1.2, -1.2, -1.2, -1.2])


def test_a_share_of_the_effort_leads_by_less_at_the_same_speed() -> None:
    """0.4 of 1 N at 2000 N/m are 0.2 mm."""
    fingers = scripted(lambda step: (0.0, 0.0), replace(CLOSING, phases=({"a": 0.4, "b": -1.0},)))
    fingers.close()
    np.testing.assert_allclose(1000 * np.array(fingers.targets["a"][:4]), [0.1, 0.2, 0.2, 0.2])
    np.testing.assert_allclose(1000 * np.array(fingers.targets["b"][:4]), [-0.1, -0.2, -0.3, -0.4])


def test_closing_ends_when_the_fingers_stand_still_for_two_windows() -> None:
    """The second finger moves 2 mm in the first window, 0.5 mm in the second, 2 mm in the third, then no more.

    One window of standing still is not enough, so it ends with the fifth.
    """
    at = [0.0, 0.002, 0.0025, 0.0045, 0.0045, 0.0045, 0.0045]
    fingers = scripted(lambda step: (0.0, -at[step // 4]))
    assert fingers.close() == fingers.clock.step == 20


def test_closing_ends_with_its_time() -> None:
    fingers = scripted(lambda step: (-0.01 * step, 0.0))
    assert fingers.close() is None and fingers.clock.step == 40


@pytest.mark.parametrize(("jaw", "end"), [(True, None), (False, 8)])
def test_more_than_a_jaw_stands_still_at_a_tenth_of_its_speed(jaw: bool, end: int | None) -> None:
    """10 m/s are 40 mm a window: 0.9 mm a step are 3.6 mm. A jaw moves as long as it does so by 1 mm."""
    fingers = scripted(lambda step: (0.0009 * step, 0.0), replace(CLOSING, speed=10.0), jaw)
    assert fingers.close() == end


def test_phases_close_in_order_and_hold() -> None:
    """a closes for 6 steps to 6 mm; it stands still twice at step 16, when b begins from 0. a's target stays."""
    phases = ({"a": 1.0}, {"b": 1.0})
    fingers = scripted(
        lambda step: (0.001 * min(step, 6), 0.001 * min(max(step - 16, 0), 3)), replace(CLOSING, phases=phases)
    )
    assert fingers.close() == 28  # b moves in the window to 20; those to 24 and 28 are still
    assert len(fingers.targets["a"]) == 16 and len(fingers.targets["b"]) == 12
    np.testing.assert_allclose(1000 * fingers.targets["b"][0], 0.1)


def test_time_that_the_first_phase_takes_is_missing_in_the_second() -> None:
    fingers = scripted(lambda step: (0.01 * step, 0.0), replace(CLOSING, phases=({"a": 1.0}, {"b": 1.0})))
    assert fingers.close() is None and fingers.targets["b"] == []


def test_a_joint_follows_by_ratio_and_offset_while_its_driver_moves() -> None:
    """b = -0.5 a + 2 mm: at each step the target is told from where the driver stood before it."""
    closing = replace(CLOSING, phases=({"a": 1.0},), follow={"b": Follow("a", -0.5, 0.002)})
    fingers = scripted(lambda step: (0.001 * step, 0.0), closing)
    fingers.close()
    np.testing.assert_allclose(1000 * np.array(fingers.targets["b"][:3]), [2, 1.5, 1], rtol=1e-6)


@pytest.mark.parametrize(("mimics", "told"), [((), 0), (("b",), 1)])
def test_under_load_only_the_mechanism_follows(mimics: tuple[str, ...], told: int) -> None:
    """A `<mimic>` is gears or a linkage; that pads stay parallel is control, which is frozen for the lift."""
    closing = replace(CLOSING, phases=({"a": 1.0},), follow={"b": Follow("a", -1.0, 0.0)})
    fingers = scripted(lambda step: (0.003, 0.0), closing, mimics=mimics)
    fingers.keep_linked()
    np.testing.assert_allclose(fingers.targets["b"], [-0.003] * told, rtol=1e-6)
    fingers.settle(0.002)
    assert len(fingers.targets["b"]) == told + 2


def test_rules_of_rules_lead_to_the_driver() -> None:
    """c = 2 b + 1 and b = 3 a - 0.5 are c = 6 a + 0."""
    rules = {"c": Follow("b", 2.0, 1.0), "b": Follow("a", 3.0, -0.5)}
    assert resolved(rules) == {"c": Follow("a", 6.0, 0.0), "b": Follow("a", 3.0, -0.5)}


def test_what_follows_a_joint_that_is_held_stands_still() -> None:
    follow = {"b": Follow("a", 1.0, 0.0), "d": Follow("held", 1.0, 0.0)}
    preshape: Any = SimpleNamespace(closing=replace(CLOSING, phases=({"a": 1.0}, {"e": 1.0}), follow=follow))
    assert moving_joints(preshape) == {"a", "b", "e"}
