"""Settings of trials in MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass

from spgf_torch.settings import bounded, defaults_from


@dataclass
@defaults_from("mujoco/contacts.yaml")
class MujocoConfig:
    """How MuJoCo makes contacts (docs/design/simulation.md); the episode is `simulation.config.EpisodeConfig`'s."""

    dt: float = bounded(1e-5, 0.02)
    time_constant: float = bounded(0.01, 100.0)
    damping_ratio: float = bounded(0.1, 100.0)
    impedance: float = bounded(0.01, 0.9999)
    impratio: float = bounded(0.1, 10_000.0)
    torsion: float = bounded(0.0, 0.1)
