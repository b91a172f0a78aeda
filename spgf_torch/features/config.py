"""Settings of the local shape descriptor."""

from __future__ import annotations

from dataclasses import dataclass, field

from spgf_torch.settings import bounded, choice, defaults_from

# What local shape can be described by (features/descriptors.py).
DESCRIPTORS = ("spgf", "fpfh", "patch_pairs")


@dataclass
@defaults_from("features/spgf.yaml")
class FeatureConfig:
    """The Sliced Pineapple Grid Feature (paper, section 3.1), or a baseline in its place."""

    # Older models do not say: theirs is SPGF.
    descriptor: str = field(default="spgf", metadata={"choice": DESCRIPTORS})
    radius: float = bounded(0.001, 1.0)
    cells: int = bounded(4, 360)
    half_length: int = bounded(0, 180)
    alignment: str = choice("argmax", "soft", "random")
    layers: int = bounded(1, 2)
    gaps: str = choice("saturated", "flat")
