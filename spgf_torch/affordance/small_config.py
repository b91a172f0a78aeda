"""Settings of a model that is made small, and of `pack`, which keeps one."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.settings import bounded, defaults_from, text


@dataclass
@defaults_from("small/levels.yaml")
class SmallConfig:
    """How coarse: how many points stay, levels of probability and support, the highest of these."""

    points: int = bounded(1, 40_000_000)
    probabilities: int = bounded(2, 64)
    supports: int = bounded(1, 64)
    most: float = bounded(1.0, 1e6)


@dataclass
class PackConfig:
    """`python -m spgf_torch.pack`: which model, where to, how small."""

    model: str = text()
    judge: str | None = text()
    name: str | None = text()
    out: str | None = text()
    whole: bool = MISSING
    replace: bool = MISSING
    small: SmallConfig = field(default_factory=SmallConfig)
