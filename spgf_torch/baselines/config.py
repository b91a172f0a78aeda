"""Settings of `python -m spgf_torch.baseline`; the values and their reasons stand in `conf/baseline.yaml`."""

from __future__ import annotations

from dataclasses import dataclass, field

from spgf_torch.affordance.config import NESTED
from spgf_torch.errors import InputError
from spgf_torch.objects.config import ObjectsConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import bounded, choice, text
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig

# What a network's logits can rank grasps by: of the rankings of votes, those that need nothing else (`folds.scores`).
RANKINGS = ("calibrated", "log_odds", "log_odds_free")
WIDEST = 8192  # channels of a layer
DEEPEST = 16  # layers


@dataclass
class NetworkConfig:
    """A PointNet: how a point is written, what it goes through alone, and what the maximum over points goes through."""

    frequencies: int = bounded(0, 10)
    widths: list[int] = field(default_factory=list)
    head: list[int] = field(default_factory=list)


@dataclass
class AugmentConfig:
    """What training clouds are changed by, anew each time; standard deviations of normal noise."""

    points: int = bounded(1, 100_000)
    mirror: bool = field(default=False)
    rotation_deg: float = bounded(0.0, 180.0)
    shift: float = bounded(0.0, 0.1)
    jitter: float = bounded(0.0, 0.1)


@dataclass
class LearningConfig:
    """How long and how fast a network learns, and what stops it."""

    grasps_per_epoch: int = bounded(1, 100_000_000)
    epochs: int = bounded(1, 100_000)
    patience: int = bounded(1, 100_000)
    batch_size: int = bounded(1, 1_000_000)
    rate: float = bounded(1e-7, 1.0)
    weight_decay: float = bounded(0.0, 10.0)
    inner_share: float = bounded(0.01, 0.9)
    inner_grasps: int = bounded(1, 1_000_000)


@dataclass
class BaselineConfig(ObjectsConfig):
    """`python -m spgf_torch.baseline`: a network in the place of descriptor and votes."""

    N: int = bounded(1, 1000)
    folds: int = bounded(2, 50)
    seed: int = bounded(0, 2**31 - 1)
    ranking: str = choice(*RANKINGS, NESTED)
    trials_per_object: int = bounded(1, 1_000_000)
    bootstrap: int = bounded(100, 1_000_000)
    trials: str = text()
    export: str = text()
    checkpoints: str = text()
    device: str = text()
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)


def check_network(config: NetworkConfig) -> None:
    """Raises InputError in one line for layers of no or of too many channels."""
    for name, least in (("widths", 1), ("head", 0)):
        layers = getattr(config, name)
        if not least <= len(layers) <= DEEPEST or not all(1 <= width <= WIDEST for width in layers):
            raise InputError(
                f"network.{name}: expected {least} to {DEEPEST} layers of 1 to {WIDEST} channels, got {layers}"
            )
