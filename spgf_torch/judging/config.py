"""Settings of learning a judge."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.objects.config import ObjectsConfig
from spgf_torch.proposing.config import HypothesesConfig, ProposingConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import bounded, choice, defaults_from, left_out, text
from spgf_torch.simulation.clutter_config import ArrangementConfig, AttemptConfig
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig


@dataclass
@defaults_from("learning/trees.yaml")
class TreesConfig:
    """Boosted trees of a judge (scikit-learn's HistGradientBoostingClassifier)."""

    trees: int = bounded(1, 10_000)
    rate: float = bounded(0.001, 1.0)
    leaves: int = bounded(2, 1000)
    least: int = bounded(1, 100_000)
    l2: float = bounded(0.0, 1e6)


@dataclass
class ContextConfig:
    """Tables full of things that a judge learns in (conf/context/tabletop.yaml)."""

    number: int = bounded(1, 1000)
    rounds: int = bounded(1, 10)
    measured: int = bounded(0, 1000)
    first: int = bounded(0, 2**31 - 1)
    first_measured: int = bounded(0, 2**31 - 1)
    count: int = bounded(1, 50)
    best: int = bounded(1, 100)
    random: int = bounded(0, 1000)
    surveyed: int = bounded(0, 100_000)
    views: list[int] = text()
    packed: ArrangementConfig = field(default_factory=ArrangementConfig)
    pile: ArrangementConfig = field(default_factory=ArrangementConfig)
    attempt: AttemptConfig = field(default_factory=AttemptConfig)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)


@dataclass
class JudgeConfig(ObjectsConfig):
    """`python -m spgf_torch.judge`: a hand's judge of grasp hypotheses."""

    known: str | None = text()
    trials: str | None = text()
    own_trials: str | None = text()
    candidates: int = bounded(1, 1_000_000)
    rounds: int = bounded(1, 10)
    best: int = bounded(1, 1000)
    random: int = bounded(0, 1000)
    one_view: int = bounded(1, 100)
    four_views: int = bounded(0, 100)
    surveyed: int = bounded(0, 100_000)
    looks: int = bounded(0, 100)
    lowest_deg: float = bounded(-89.0, 89.0)
    highest_deg: float = bounded(-89.0, 89.0)
    folds: int = bounded(2, 50)
    fold_judges: bool = MISSING
    form: str = choice("trees", "logistic")
    sure: float = bounded(0.0, 1.0)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
    runner: str = choice("local", "dask")
    address: str | None = text()
    time_limit: float = bounded(0.1, 86_400.0)
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    learning: TreesConfig = field(default_factory=TreesConfig)
    context: ContextConfig | None = left_out()
    scene_trials: str | None = text()
