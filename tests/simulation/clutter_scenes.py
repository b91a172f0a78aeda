"""Settings and scenes that the tests of clutter share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from trial_objects import ball, box, can, cup

from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import settings
from spgf_torch.simulation.arrangements import Placed
from spgf_torch.simulation.attempts import Attempt
from spgf_torch.simulation.clutter_config import ArrangementConfig
from spgf_torch.simulation.config import EpisodeConfig

FAST = settings(EpisodeConfig, dt=0.005, position_iterations=56)  # episode=fast


def arrangement(**changes: Any) -> ArrangementConfig:
    return replace(settings(ArrangementConfig), **changes)


def small_things() -> list[GraspObject]:
    """Three that stand and one that rolls, each with a name of its own."""
    brick = replace(box((0.05, 0.03, 0.08)), name="brick")
    return [can(0.025, 0.09), brick, cup(0.035, 0.07), ball(0.03)]


def standing(obj: GraspObject, x: float = 0.0, y: float = 0.0) -> Placed:
    """With the origin of its frame on the table at (x, y)."""
    T = np.eye(4)
    T[:2, 3] = x, y
    return Placed(obj, T)


def poses(placed: tuple[Placed, ...]) -> list[tuple[str, bytes]]:
    """To compare to the bit."""
    return [(each.obj.name, each.T_world_object.tobytes()) for each in placed]


def told(attempt: Attempt) -> tuple:
    """All of an attempt but its seconds and its motion, to compare to the bit."""
    named = (attempt.outcome, attempt.cause, attempt.taken, attempt.touched, attempt.gripped)
    return (*named, attempt.disturbed, attempt.lost, poses(attempt.placed))
