"""Closing up to just before the fingers meet anything: the same for all grasps of a type, so it is simulated once.

Until then nothing that could be grasped acts on the fingers, and nothing on the object: where it floats it stands still
and on a table it rests. Geometry says when that ends, and whether it ever does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import fcl
import numpy as np

from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.simulation.articulation import HandBuilder, physx, sapien
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import configure
from spgf_torch.simulation.fingers import Begun, Fingers
from spgf_torch.simulation.precheck import PreCheck, hull

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand


@dataclass(frozen=True)
class _Stretch:
    """A stretch of closing: what the moving shapes pass, as a search tree and by their corners (V, 3), TCP frame, m."""

    passed: fcl.CollisionObject
    corners: np.ndarray


class FastForward:
    """The closing of one open hand on nothing, in stretches of a window of stalling; of a hand of one phase."""

    @staticmethod
    def of(hand: Hand, grasp_type: str, config: EpisodeConfig) -> FastForward:
        """The same for all objects: made once in a process."""
        return _made(_Key(f"{hand.digest} {grasp_type} {config}", hand, grasp_type, config))

    def __init__(self, hand: Hand, grasp_type: str, config: EpisodeConfig) -> None:
        configure(config)
        material = physx.PhysxMaterial(config.friction, config.friction, 0.0)
        builder = HandBuilder(hand.robot, hand.preshapes[grasp_type], material)
        system = physx.PhysxCpuSystem()
        scene = sapien.Scene([system])
        scene.timestep = config.dt
        preshape, articulation = hand.preshapes[grasp_type], builder.build(scene)
        window, steps = max(1, round(config.stall_window / config.dt)), 0
        self.begun: list[Begun] = []
        bodies: list[dict[str, np.ndarray]] = []

        def note() -> None:
            self.begun.append(Begun(steps, articulation.qpos, articulation.qvel, dict(fingers.aims)))
            bodies.append({link.name: _matrix(link.entity_pose) for link in articulation.links[1:]})

        def step() -> None:
            nonlocal steps
            if steps % window == 0:
                note()
            system.step()
            steps += 1

        fingers = Fingers(articulation, hand.robot, preshape, config, step)
        fingers.close()
        note()
        T = np.linalg.inv(preshape.T_base_tcp)
        moving = [
            (np.asarray(shape.vertices), body)
            for shape, link in zip(preshape.shapes, preshape.shape_links, strict=True)
            if (body := builder.body_of(link)) in bodies[0]
        ]
        places = [
            [
                _moved(T @ there[body] @ np.linalg.inv(bodies[0][body]) @ np.linalg.inv(T), points)
                for points, body in moving
            ]
            for there in bodies
        ]
        self.stretches = [_stretch(*pair) for pair in pairwise(places)]

    def until(self, check: PreCheck, T_object_tcp: np.ndarray, up: np.ndarray, height: float | None) -> Begun | None:
        """Where the fingers are before they could meet object or table (`ApproachCheck.met`); None: they never do."""
        along, level = up @ T_object_tcp[:3, :3], up @ T_object_tcp[:3, 3]
        for index, stretch in enumerate(self.stretches):
            low = height is not None and float((stretch.corners @ along).min()) + level < height
            if low or check.cuts(stretch.passed, T_object_tcp):
                return self.begun[max(0, index - 1)]
        return None


@dataclass(frozen=True)
class _Key:
    """`name` stands for what is not compared."""

    name: str
    hand: Hand = field(compare=False)
    grasp_type: str = field(compare=False)
    config: EpisodeConfig = field(compare=False)


@lru_cache(maxsize=8)
def _made(key: _Key) -> FastForward:
    return FastForward(key.hand, key.grasp_type, key.config)


def _stretch(before: list[np.ndarray], after: list[np.ndarray]) -> _Stretch:
    passed = [hull(np.concatenate(pair)) for pair in zip(before, after, strict=True)]
    corners = np.concatenate([np.asarray(mesh.vertices)[np.unique(mesh.faces)] for mesh in passed])
    return _Stretch(fcl.CollisionObject(triangle_tree(passed)), corners)


def _moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def _matrix(pose: sapien.Pose) -> np.ndarray:
    return pose.to_transformation_matrix().astype(np.float64)
