"""Which engine's trials an evaluation runs. Loads no engine: workers do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.simulation.worker import TrialFunction, TrialMaker, Trials, physics

if TYPE_CHECKING:
    from spgf_torch.objects.grasp_object import GraspObject

SAPIEN, MUJOCO = "sapien", "mujoco"
NAMES = {SAPIEN: "SAPIEN", MUJOCO: "MuJoCo"}


@dataclass(frozen=True)
class MujocoPhysics:
    """Makes the trial on an object: the same pre-check of collisions, then the episode in MuJoCo."""

    config: MujocoConfig

    def __call__(self, obj: GraspObject, trials: Trials, grasp_type: str) -> TrialFunction:
        from spgf_torch.second_engine.trial import MujocoSimulator
        from spgf_torch.simulation.precheck import PreCheck

        check = PreCheck(obj, trials.hand.preshapes[grasp_type])
        simulator = MujocoSimulator(obj, trials.hand, grasp_type, trials.episode, self.config)
        return lambda T: "collision" if check.collides(T) else simulator.run(T)


def makers(engine: str, config: MujocoConfig) -> dict[str, TrialMaker]:
    """Engine -> what makes its trials, of `engine`: sapien, mujoco or both."""
    every: dict[str, TrialMaker] = {SAPIEN: physics, MUJOCO: MujocoPhysics(config)}
    return every if engine == "both" else {engine: every[engine]}
