"""Settings of a model that is made small."""

from __future__ import annotations

from dataclasses import dataclass

from spgf_torch.settings import bounded, defaults_from


@dataclass
@defaults_from("small/levels.yaml")
class SmallConfig:
    """How coarse: how many points stay, levels of probability and support, the highest of these."""

    points: int = bounded(1, 40_000_000)
    probabilities: int = bounded(2, 64)
    supports: int = bounded(1, 64)
    most: float = bounded(1.0, 1e6)
