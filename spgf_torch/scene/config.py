"""Settings of scenes: files, units, cameras, the table, and of `predict`, which reads them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.settings import bounded, choice, defaults_from, text


@dataclass
@defaults_from("scene/tabletop.yaml")
class SceneConfig:
    """User-provided input: files and how they become texlets (lengths in metres, whatever `unit` says)."""

    input: Any = text()
    unit: str = choice("m", "cm", "mm")
    min_extent: float = bounded(0.0001, 1.0)
    max_extent: float = bounded(0.1, 1000.0)
    max_points: int = bounded(1, 1_000_000_000)
    viewpoints: Any = text()
    intrinsics: Any = text()
    poses: Any = text()
    mask: Any = text()
    segments: Any = text()
    depth_scale: float | None = bounded(1e-6, 1.0)
    stride: int | None = text()
    read_as: str = choice("auto", "cloud", "mesh")
    mesh: str = choice("sensed", "whole")
    mesh_pitch: float = bounded(0.0005, 0.01)
    mesh_samples: int = bounded(1000, 20_000_000)
    crop_low: Any = text()
    crop_high: Any = text()
    voxel: float = bounded(0.0005, 0.05)
    table: Any = text()
    table_distance: float = bounded(0.0005, 0.05)
    table_share: float = bounded(0.01, 1.0)
    table_width: float = bounded(0.01, 10.0)
    table_hypotheses: int = bounded(10, 100_000)
    gravity: Any = text()
    border: float = bounded(0.0, 0.5)
    neighbours: int = bounded(5, 200)
    normal_radius: float = bounded(0.001, 0.1)
    min_neighbours: int = bounded(3, 200)


@dataclass
class PredictConfig(SceneConfig):
    """`python -m spgf_torch.predict`: ranked grasps for user-provided input, with the settings of a scene."""

    batch: bool = text()
    model: str | None = text()
    judge: str | None = text()
    N: int = bounded(1, 1000)
    retreat: float = bounded(0.0, 1.0)
    device: str = text()
    seed: int = bounded(0, 2**31 - 1)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)
