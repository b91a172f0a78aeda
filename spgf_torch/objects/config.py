"""Settings of objects: folders of meshes or descriptions, their collision pieces, and objects drawn from families."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.hands.config import HandConfig
from spgf_torch.settings import bounded, choice, defaults_from, text

CLASSES = ("containers", "boxes", "curved")


@dataclass
@defaults_from("collision/shell.yaml")
class CollisionConfig:
    """Scanned meshes: their convex collision pieces, the check of these, and what a mesh may be."""

    tolerance: float = bounded(0.00005, 0.05)
    inset: float = bounded(0.0, 0.01)
    thickness: float = bounded(0.0002, 0.05)
    max_edge: float = bounded(0.0005, 0.5)
    attempts: int = bounded(1, 10)
    samples: int = bounded(1000, 10_000_000)
    cavity_depth: float = bounded(0.0, 1.0)
    volume_tolerance: float = bounded(0.0, 1.0)
    free_space_kept: float = bounded(0.0, 1.0)
    density: float = bounded(1.0, 20_000.0)
    wall_density: float = bounded(1.0, 20_000.0)
    min_extent: float = bounded(0.0001, 1.0)
    max_extent: float = bounded(0.01, 100.0)
    max_hole: float = bounded(0.0, 0.1)


@dataclass
class ObjectsConfig:
    """A folder of objects, for every command that takes one: descriptions, or meshes and how they are read."""

    objects: str = text()
    unit: str = choice("auto", "m", "cm", "mm")
    category: str = choice("manifest", *CLASSES)
    skip_bad: bool = MISSING
    workers: int = bounded(0, 1024)
    hand: HandConfig = field(default_factory=HandConfig)
    collision: CollisionConfig = field(default_factory=CollisionConfig)


@dataclass
class GenerateConfig:
    """`python -m spgf_torch.generate`: described objects, drawn from families of shapes."""

    count: int = bounded(1, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
    out: str | None = text()
    ranges: str = text()
    families: list[str] | None = field(default=None)
    lightest: float = bounded(0.001, 5.0)
    heaviest: float = bounded(0.001, 5.0)
    pictured: int = bounded(0, 1000)
