"""Settings of `train` and `evaluate`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from spgf_torch.affordance.config import JUDGE, NESTED, RANKINGS, AffordanceConfig
from spgf_torch.features.config import FeatureConfig
from spgf_torch.objects.config import ObjectsConfig
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.prototypes.config import ConstellationConfig, PrototypeConfig
from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import bounded, choice, text
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig


@dataclass
class TrainConfig(ObjectsConfig):
    """`python -m spgf_torch.train`: the paper's experiment."""

    K: int = bounded(1, 1000)
    N: int = bounded(1, 1000)
    folds: int = bounded(2, 50)
    seed: int = bounded(0, 2**31 - 1)
    ranking: str = choice(*RANKINGS, NESTED, JUDGE)
    inner_grasps: int = bounded(10, 1_000_000)
    trials_per_object: int = bounded(1, 1_000_000)
    training_objects: int = bounded(2, 1_000_000)
    final_model: bool = MISSING
    classwise: bool = field(default=False)  # so in older runs, which do not say
    fold_models: bool = MISSING
    bootstrap: int = bounded(100, 1_000_000)
    prototypes_from: str | None = text(None)
    trials: str = text()
    # Older runs do not say: theirs have none.
    judge: str = field(default="none", metadata={"choice": ("none", "learn")})
    own_trials: str | None = text(None)
    judging: dict[str, Any] = field(default_factory=dict)
    random_trials: int = bounded(1, 1_000_000, 300)
    recorded: dict[str, Any] = field(default_factory=dict)
    runner: str = field(default="local", metadata={"choice": ("local", "dask")})
    address: str | None = text(None)
    device: str = text()
    name: str | None = text(None)
    replace: bool = field(default=False)
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    features: FeatureConfig = field(default_factory=FeatureConfig)
    prototypes: PrototypeConfig = field(default_factory=PrototypeConfig)
    constellations: ConstellationConfig = field(default_factory=ConstellationConfig)
    affordance: AffordanceConfig = field(default_factory=AffordanceConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)


@dataclass
class EvaluateConfig(ObjectsConfig):
    """`python -m spgf_torch.evaluate`: the model's best grasps on a folder of meshes, executed."""

    model: str = text()
    judge: str | None = text()
    table: bool = MISSING
    held_out: bool = MISSING
    N: int = bounded(1, 1000)
    candidates: str = choice("proposed", "sampled")
    samples: int = bounded(1, 10_000_000)
    random_trials: int = bounded(1, 1_000_000)
    ranking: str = choice(*RANKINGS)
    engine: str = choice("sapien", "mujoco", "both")
    draws: int = bounded(1, 1000)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
    device: str = text()
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    mujoco: MujocoConfig = field(default_factory=MujocoConfig)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)


# What the names of files of recorded trials end with.
TABLES = (".parquet", ".csv")


def is_recorded(trials: str) -> bool:
    """Whether `trials` names a table of recorded trials; a folder is what `simulate` leaves."""
    return trials.lower().endswith(TABLES)
