"""Close a hand without an object: what its description and its URDF come to before anything is grasped."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spgf_torch.hands.hand import Hand
from spgf_torch.simulation.articulation import HandBuilder, physx, sapien
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import configure
from spgf_torch.simulation.fingers import Fingers

REST_STEPS = 50  # in the open hand before it closes
BEYOND = {"prismatic": 0.02, "revolute": 0.2}  # m, rad past its limits: no drive or contact pushes a joint so far


@dataclass(frozen=True)
class FreeClosing:
    """What the joints do (rad or m) when the hand closes on nothing.

    Attributes:
        times: (S,) s since it begins to close.
        joints: joint that moves -> (S,) its values.
        drift: joint that moves -> the farthest it gets from the open hand in `REST_STEPS` steps before.
        still: s until the fingers stand still; None where `closing.time` ends before.
        end: every joint -> its value at the end.
        exploded: joints that left their limits by far, or are nowhere.
    """

    times: np.ndarray = field(repr=False)
    joints: dict[str, np.ndarray] = field(repr=False)
    drift: dict[str, float]
    still: float | None
    end: dict[str, float]
    exploded: tuple[str, ...]


def close_without_object(hand: Hand, grasp_type: str, episode: EpisodeConfig) -> FreeClosing:
    """Hold the open hand for a while, then close it.

    Raises InputError where SAPIEN cannot cook a collision shape.
    """
    configure(episode)
    preshape = hand.preshapes[grasp_type]
    system = physx.PhysxCpuSystem()
    scene = sapien.Scene([system])
    scene.timestep = episode.dt
    material = physx.PhysxMaterial(episode.friction, episode.friction, 0.0)
    articulation = HandBuilder(hand.robot, preshape, material).build(scene)
    path: list[np.ndarray] = []

    def step() -> None:
        system.step()
        path.append(articulation.qpos)

    fingers = Fingers(articulation, hand.robot, preshape, episode, step)
    names = list(fingers.joints)
    fingers.settle(REST_STEPS * episode.dt)
    away = np.abs(np.stack(path) - [preshape.joints[name] for name in names]).max(axis=0)
    path.clear()
    steps = fingers.close()
    values = np.stack(path).astype(np.float64)
    return FreeClosing(
        times=episode.dt * np.arange(1, len(values) + 1),
        joints=dict(zip(names, values.T, strict=True)),
        drift=dict(zip(names, away.tolist(), strict=True)),
        still=None if steps is None else steps * episode.dt,
        end=fingers.values(),
        exploded=tuple(n for n, its in zip(names, values.T, strict=True) if _exploded(hand, n, its)),
    )


def _exploded(hand: Hand, name: str, values: np.ndarray) -> bool:
    joint = hand.robot.joint(name)
    slack = BEYOND["prismatic" if joint.kind == "prismatic" else "revolute"]
    return not np.all((values >= joint.lower - slack) & (values <= joint.upper + slack))  # NaN is not within them
