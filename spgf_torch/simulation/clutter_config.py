"""Settings of clutter: how objects come to lie together on a table, and how a hand tries one grasp there."""

from __future__ import annotations

from dataclasses import dataclass

from spgf_torch.settings import bounded, choice, defaults_from, text

PACKED, PILE = "packed", "pile"


@dataclass
@defaults_from("arrangement/packed.yaml")
class ArrangementConfig:
    """Objects on a table: where they are put, and the physics in which they come to rest (conf/arrangement)."""

    kind: str = choice(PACKED, PILE)
    scale: list[float] = text()
    workspace: float = bounded(0.05, 2.0)
    lost: float = bounded(0.05, 2.0)
    middle: float = bounded(0.0, 2.0)
    gap: float = bounded(0.0, 0.1)
    tries: int = bounded(1, 10_000)
    stance: float = bounded(0.0, 0.1)
    drop: float = bounded(0.0, 1.0)
    drop_spread: float = bounded(0.0, 1.0)
    drop_time: float = bounded(0.0, 10.0)
    wall: float = bounded(0.0, 2.0)
    dt: float = bounded(1e-4, 0.02)
    position_iterations: int = bounded(1, 255)
    velocity_iterations: int = bounded(1, 255)
    contact_offset: float = bounded(1e-5, 0.05)
    friction: float = bounded(0.0, 5.0)
    depenetration: float = bounded(0.01, 100.0)
    gravity: float = bounded(0.1, 100.0)
    linear_damping: float = bounded(0.0, 100.0)
    angular_damping: float = bounded(0.0, 100.0)
    rest_speed: float = bounded(1e-5, 1.0)
    rest_spin: float = bounded(1e-4, 10.0)
    rest_window: float = bounded(0.01, 10.0)
    rest_time: float = bounded(0.0, 60.0)


@dataclass
@defaults_from("attempt/lift.yaml")
class AttemptConfig:
    """One grasp in clutter: approach, closing, lifting, and what counts as what (conf/attempt/lift.yaml)."""

    approach: float = bounded(0.0, 1.0)
    approach_speed: float = bounded(0.01, 5.0)
    stop_at_contact: bool = text()
    touch_impulse: float = bounded(0.0, 1.0)
    wait: float = bounded(0.0, 10.0)
    retreat: str = choice("up", "back")
    lift: float = bounded(0.01, 1.0)
    lift_time: float = bounded(0.05, 10.0)
    hold_time: float = bounded(0.0, 10.0)
    lifted: float = bounded(0.0, 1.0)
    disturbed: float = bounded(0.0, 1.0)
    arm_stiffness: float = bounded(1.0, 1e6)
    arm_damping: float = bounded(0.0, 1e5)
    arm_effort: float = bounded(0.1, 1e5)
    arm_mass: float = bounded(0.01, 100.0)
    frame_time: float = bounded(0.001, 1.0)
