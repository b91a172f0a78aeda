"""How the hand of a robot's trial comes: where it and the table are drawn to be, and what it meets there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.config import RobotConfig
from spgf_torch.simulation.draws import Draw, StablePoses, drawn
from spgf_torch.simulation.precheck import ApproachCheck

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand


class Arrival:
    """Of one grasp type on one object."""

    def __init__(self, obj: GraspObject, hand: Hand, config: RobotConfig, grasp_type: str) -> None:
        self.obj, self.config = obj, config
        self.poses = StablePoses.of(obj) if config.rest == "stable" else StablePoses.upright(obj)
        self.check = ApproachCheck(obj, hand.preshapes[grasp_type], config.approach)

    def drawn(self, T_object_tcp: np.ndarray) -> Draw:
        """What is drawn for the grasp at T_object_tcp (4, 4)."""
        return drawn(self.obj, self.poses, T_object_tcp, self.config, self.config.draw)

    def met(self, draw: Draw) -> str | None:
        """What the hand meets on its way, one of `label.CAUSES`; None: it comes freely."""
        return self.check.met(draw.T_object_tcp, draw.up, draw.height)

    def collides(self, T_object_tcp: np.ndarray) -> bool:
        """Whether the hand meets anything, so that the grasp needs no physics."""
        return self.met(self.drawn(T_object_tcp)) is not None
