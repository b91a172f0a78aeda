"""Settings of `python -m spgf_torch.view`."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.scene.config import SceneConfig
from spgf_torch.settings import bounded


@dataclass
class ViewConfig(SceneConfig):
    """Which folder is watched, which model asked, and where the page is; with the settings of a scene."""

    model: str | None = MISSING
    judge: str | None = MISSING
    N: int = bounded(1, 1000)
    retreat: float = bounded(0.0, 1.0)
    device: str = MISSING
    seed: int = bounded(0, 2**31 - 1)
    host: str = MISSING
    port: int = bounded(1, 65535)
    every: float = bounded(0.01, 60.0)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)
