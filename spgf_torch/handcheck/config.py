"""Settings of the command `hand`."""

from __future__ import annotations

from dataclasses import dataclass, field

from spgf_torch.hands.config import HandConfig
from spgf_torch.settings import text
from spgf_torch.simulation.config import EpisodeConfig


@dataclass
class HandCheckConfig:
    """`python -m spgf_torch.hand`: check and draw a hand, or propose a description of a bare URDF."""

    urdf: str | None = text()
    root: str | None = text()
    packages: dict[str, str] = field(default_factory=dict)
    page: bool = True
    simulate: bool = True
    hand: HandConfig = field(default_factory=HandConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
