"""Settings of `python -m spgf_torch.export`; the values and their reasons stand in `conf/export.yaml`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING

from spgf_torch.errors import InputError
from spgf_torch.objects.config import ObjectsConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import bounded, text

FORMATS = ("acronym", "graspgen", "webdataset", "isaac", "graspnet")


@dataclass
class SamplesConfig:
    """Ready training samples: how much of the sensed cloud, and how many in a shard."""

    points: int = bounded(1, 100_000)
    radius: float = bounded(0.01, 10.0)
    per_shard: int = bounded(1, 1_000_000)


@dataclass
class ExportConfig(ObjectsConfig):
    """`python -m spgf_torch.export`: a trial table as a data set."""

    format: Any = text()
    trials: str = text()
    out: str | None = text()
    overwrite: bool = MISSING
    folds: int = bounded(2, 50)
    seed: int = bounded(0, 2**31 - 1)
    license: str | None = text()
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    samples: SamplesConfig = field(default_factory=SamplesConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)


def wanted_formats(value: Any) -> list[str]:
    """The formats that `format=` names, one or a list, in the order of `FORMATS`. InputError lists the known ones."""
    named = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    unknown = [word for word in named if word not in FORMATS]
    if unknown or not named:
        got = unknown[0] if unknown and unknown[0] is not None else "none"
        raise InputError(f"format: expected one of {', '.join(FORMATS)}, or a list [a,b] of them; got {got}")
    return [known for known in FORMATS if known in named]
