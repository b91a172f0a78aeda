"""Settings of `report` and `compare`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from spgf_torch.affordance.config import JUDGE, NESTED, RANKINGS
from spgf_torch.settings import bounded, choice, text


@dataclass
class ReportConfig:
    """`python -m spgf_torch.report`: Table 1, figures and a page from runs of train."""

    runs: Any = text()
    ranking: str = choice(NESTED, *RANKINGS, JUDGE)
    rankings: list[str] = field(default_factory=list)
    show: int | None = field(default=None)
    pictured: int | None = bounded(1, 1000)
    fold: int | None = bounded(0, 1000)
    objects: int = bounded(1, 100)
    worst: int = bounded(1, 100)
    grasps: int = bounded(2, 1000)
    precision: int = bounded(1, 10_000)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)


@dataclass
class CompareConfig:
    """`python -m spgf_torch.compare`: descriptors and the learned baseline side by side."""

    runs: Any = text()
    baseline: Any = text()
    reference: str = text()
    ranking: str = choice(NESTED, *RANKINGS)
    rankings: list[str] = field(default_factory=list)
    K: int = bounded(1, 1000)
    trials_per_object: int | None = field(default=None)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
