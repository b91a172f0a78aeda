"""How hand and objects moved during an attempt, for films; imports nothing of physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.hands.kinematics import Kinematics

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand
    from spgf_torch.simulation.fingers import Fingers
    from spgf_torch.simulation.tabletop import Tabletop


@dataclass(frozen=True)
class Motion:
    """Frames of one attempt, of F frames, N objects and L links, in the world.

    Attributes:
        times: (F,) s since the pregrasp.
        objects: (F, N, 4, 4) T_world_object, in the order of the objects given.
        link_names: of the hand's links that have collision shapes.
        links: (F, L, 4, 4) T_world_link. A shape of `Preshape.shapes` on link l stands at
            T_world_link @ inv(T_base_link[l]) @ T_base_tcp, of the open hand's preshape.
    """

    times: np.ndarray
    objects: np.ndarray
    link_names: tuple[str, ...]
    links: np.ndarray


class Recorder:
    """Notes frames while an attempt runs."""

    def __init__(self, hand: Hand, T_world_base: np.ndarray, frame_time: float) -> None:
        """`T_world_base` (4, 4): where the base is before it comes."""
        self._robot, self._T_world_base, self._frame_time = hand.robot, T_world_base, frame_time
        self._time, self._times = 0.0, [0.0] * 0
        self._objects: list[np.ndarray] = []
        self._joints: list[dict[str, float]] = []
        self._ways: list[np.ndarray] = []

    def note(self, seconds: float, tabletop: Tabletop, fingers: Fingers, way: np.ndarray) -> None:
        """So many seconds have passed, and the base has come by `way` (3,) m; a frame where one is due."""
        if self._time >= len(self._times) * self._frame_time - seconds / 2:
            self._times.append(self._time)
            self._objects.append(np.array(tabletop.poses()).reshape(-1, 4, 4))
            self._joints.append(fingers.values())
            self._ways.append(way)
        self._time += seconds

    def motion(self) -> Motion:
        """All frames."""
        names = tuple(dict.fromkeys(collision.link for collision in self._robot.collisions))
        base = np.tile(self._T_world_base, (len(self._times), 1, 1))
        base[:, :3, 3] += np.array(self._ways)
        links = Kinematics(self._robot).along(self._joints)
        poses = np.stack([base @ links[name] for name in names], axis=1)
        return Motion(np.array(self._times), np.array(self._objects), names, poses)
