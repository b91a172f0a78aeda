"""The Sliced Pineapple Grid Feature of every texlet (paper, section 3.1)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from spgf_torch.config import FeatureConfig, InputError
from spgf_torch.features.alignment import aligned_poses, highest_curvature, start_at
from spgf_torch.features.grid import rings
from spgf_torch.features.relations import pairs_of, reference_frames, relations, turned
from spgf_torch.geometry.neighbours import Neighbourhoods
from spgf_torch.threads import in_parts, one_thread

# The soft alignment looks for its direction on rings this many times finer (2 deg with 36 cells; FEATURES.md).
FINER = 5


# Rings and which features are valid, as `grid.rings` has them, of frames and settings, and whether softly filled.
InFrames = Callable[[Tensor, FeatureConfig, bool], tuple[Tensor, Tensor]]


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
    same type), on any device: the work is done on the CPU, the features are where the positions are. `generator`
    (CPU) is used by the alignment `random` only. Time grows with the number of neighbour pairs, memory with that of
    features; temporaries are bounded.

    Raises InputError for other shapes or types, NaN or infinite values, normals that are not unit vectors.
    """
    _check(positions, normals, config, generator)
    X, n = positions.detach().cpu(), normals.detach().cpu()
    near = Neighbourhoods(X, config.radius)
    surface = Surface(X[near.order], n[near.order])
    frames, start = X.new_empty((len(X), 3, 3)), _drawn(len(X), config, generator)
    aligned, valid = X.new_empty((len(X), 2, config.cells, 2)), torch.empty(len(X), dtype=torch.bool)

    @one_thread()
    def describe(part: slice) -> None:
        rows = near.order[part]
        frames[rows], found, valid[rows] = _rings(surface, near, part, config)
        if config.alignment == "argmax":
            start[rows] = highest_curvature(found)
        start_at(found, start[rows], rows, aligned)

    deque(in_parts(describe, near.parts), maxlen=0)
    T = aligned_poses(frames, start, config.cells, X)
    return Features(*(tensor.to(positions.device) for tensor in (T, aligned, valid)))


@dataclass(frozen=True)
class Surface:
    """Texlets on the CPU, close ones together: positions and normals (N, 3)."""

    positions: Tensor
    normals: Tensor


def _rings(surface: Surface, near: Neighbourhoods, part: slice, config: FeatureConfig) -> tuple[Tensor, Tensor, Tensor]:
    """Steps 1 to 4 of section 3.1 for a part of the texlets: reference frames (n, 3, 3), and what `grid.rings` has."""
    pairs = pairs_of(*near.of(part), surface.positions[part], surface.positions, surface.normals)
    frames = reference_frames(surface.normals[part], pairs.towards)

    def in_frames(frames: Tensor, config: FeatureConfig, soft: bool = False) -> tuple[Tensor, Tensor]:
        return rings(pairs.start, relations(pairs, frames), config, soft)

    if config.alignment == "soft":
        frames = _turned_softly(frames, in_frames, config)
    return frames, *in_frames(frames, config)


def _turned_softly(frames: Tensor, in_frames: InFrames, config: FeatureConfig) -> Tensor:
    """The frames turned to the direction of highest curvature of finer, softly filled rings.

    The direction hardly depends on R_x then, as cells 10 deg wide make it. The filter is as wide as before.
    """
    fine = replace(config, cells=FINER * config.cells, half_length=FINER * (config.half_length + 1) - 1)
    start = highest_curvature(in_frames(frames, fine, True)[0])
    return turned(frames, start.to(frames) * (2 * math.pi / fine.cells))


def _drawn(N: int, config: FeatureConfig, generator: torch.Generator | None) -> Tensor:
    """The cell (N,) int64 that becomes cell 0 where it does not depend on the rings; `soft` has turned them already."""
    if config.alignment == "random":
        return torch.randint(config.cells, (N,), generator=generator)
    return torch.zeros(N, dtype=torch.int64)


def _check(positions: Tensor, normals: Tensor, config: FeatureConfig, generator: torch.Generator | None) -> None:
    for name, value in (("positions", positions), ("normals", normals)):
        if value.ndim != 2 or value.shape[1] != 3 or len(value) != len(positions):
            raise InputError(f"{name}: expected shape (N, 3), one row a texlet, got {tuple(value.shape)}")
        if value.dtype != positions.dtype or value.dtype not in (torch.float32, torch.float64):
            raise InputError(f"{name}: expected float32 or float64, both alike, got {value.dtype}")
    length = torch.linalg.vector_norm(normals, dim=1)
    if not ((length - 1).abs() <= 1e-3).all():
        worst = length[(length - 1).abs().nan_to_num(math.inf).argmax()].item()
        raise InputError(f"normals: expected unit vectors, got one of length {worst:.4g}")
    if config.alignment == "random" and generator is None:
        raise InputError("features.alignment: random expected a generator, got None")
