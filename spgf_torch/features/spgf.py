"""The Sliced Pineapple Grid Feature of every texlet (paper, section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.ops.describe import describe
from spgf_torch.ops.ring_grid import Ring

__all__ = ["Features", "spgf"]


@dataclass(frozen=True)
class Features:
    """Features of N texlets.

    T_object_feature: (N, 4, 4), origin at the texlet, z its normal, x the aligned direction.
    rings: (N, 2, N_g, 2): layer (top, bottom), cell, (alpha1, alpha2) in radians; cell 0 lies around x, and
    cell k around the direction k * 2 pi / N_g from x towards y.
    valid: (N,) bool, False where no neighbour has a direction: the rings are one gap, the alignment arbitrary.
    """

    T_object_feature: Tensor
    rings: Tensor
    valid: Tensor

    def __len__(self) -> int:
        return len(self.rings)

    def relations(self) -> Tensor:
        """The relational part (N, 4 N_g) float32, what prototypes are learned from (section 3.2): 144 numbers."""
        return self.rings.flatten(start_dim=1).float()


def spgf(
    positions: Tensor, normals: Tensor, config: FeatureConfig, generator: torch.Generator | None = None
) -> Features:
    """Describe the surroundings of each of N texlets.

    positions: (N, 3) in metres, normals: (N, 3) unit, in one frame; float32 or float64 (the features are of the
    same type), on any device (`ops.describe`). `generator` (CPU) is used by the alignment `random` only. Time grows
    with the number of neighbour pairs, memory with that of features; temporaries are bounded.

    Raises InputError for other shapes or types, NaN or infinite values, normals that are not unit vectors.
    """
    _check(positions, normals, config, generator)
    start, ring = _drawn(positions, config, generator), Ring(config.cells, config.half_length, config.layers)
    return Features(*describe(positions, normals, start, config.radius, ring, config.gaps, config.alignment == "soft"))


def _drawn(positions: Tensor, config: FeatureConfig, generator: torch.Generator | None) -> Tensor | None:
    """The cell (N,) int64 that becomes cell 0 where it does not depend on the rings."""
    if config.alignment != "random":
        return None
    return torch.randint(config.cells, (len(positions),), generator=generator).to(positions.device)


def _check(positions: Tensor, normals: Tensor, config: FeatureConfig, generator: torch.Generator | None) -> None:
    for name, value in (("positions", positions), ("normals", normals)):
        if value.ndim != 2 or value.shape[1] != 3 or len(value) != len(positions):
            raise InputError(f"{name}: expected shape (N, 3), one row a texlet, got {tuple(value.shape)}")
        if value.dtype != positions.dtype or value.dtype not in (torch.float32, torch.float64):
            raise InputError(f"{name}: expected float32 or float64, both alike, got {value.dtype}")
    if config.alignment == "random" and generator is None:
        raise InputError("features.alignment: random expected a generator, got None")
