"""Settings of `python -m spgf_torch.serve`."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.settings import bounded, text


@dataclass
class ServeConfig:
    """Which model answers, where, and how much a request may ask of it."""

    model: str | None = text()
    judge: str | None = text()
    retreat: float = bounded(0.0, 1.0)
    device: str = text()
    top: int = bounded(1, 1000)
    host: str = text()
    port: int = bounded(0, 65535)
    largest_mb: float = bounded(0.001, 4096.0)
    max_points: int = bounded(1, 1_000_000_000)
    memory_gb: float = bounded(0.1, 10_000.0)
    seconds: float = bounded(0.01, 86_400.0)
    at_once: int = bounded(1, 10_000)
    wait_seconds: float = bounded(0.01, 86_400.0)
    head_seconds: float = bounded(0.1, 3600.0)
    body_seconds: float = bounded(0.1, 3600.0)
    connections: int = bounded(1, 10_000)
    stop_seconds: float = bounded(0.1, 3600.0)
    kept: int = bounded(1, 1000)
    quiet: bool = MISSING
    proposing: ProposingConfig = field(default_factory=ProposingConfig)
