"""Settings of clearing clutter."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.objects.config import ObjectsConfig
from spgf_torch.proposing.config import HypothesesConfig, ProposingConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import bounded, choice, text
from spgf_torch.simulation.clutter_config import ArrangementConfig, AttemptConfig
from spgf_torch.simulation.config import EpisodeConfig

OURS, RANDOM, ANTIPODAL, NETWORK = "ours", "random", "antipodal", "contact_graspnet"
GIVEN, FIND = "given", "find"


@dataclass
class ClutterConfig(ObjectsConfig):
    """`python -m spgf_torch.clutter`: scenes, who plans, and how rounds go."""

    method: str = choice(OURS, RANDOM, ANTIPODAL, NETWORK)
    model: str | None = text()
    judge: str | None = text()
    held_out: bool = MISSING
    scenes: int = bounded(1, 100_000)
    count: int = bounded(1, 50)
    views: int = bounded(1, 24)
    table: str = choice(GIVEN, FIND)
    failures: int = bounded(1, 1000)
    remember: bool = MISSING
    least_probability: float = bounded(0.0, 1.0)
    film: int | None = bounded(0, 100_000)
    cgn: str | None = text()
    beside: list[str] | None = text()
    out: str | None = text()
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
    time_limit: float = bounded(1.0, 86_400.0)
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    arrangement: ArrangementConfig = field(default_factory=ArrangementConfig)
    attempt: AttemptConfig = field(default_factory=AttemptConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
