"""The Sliced Pineapple Grid Feature of every texlet (paper, section 3.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from spgf_torch.config import FeatureConfig, InputError
from spgf_torch.features.alignment import highest_curvature, start_at
from spgf_torch.features.grid import Shares, cell_means, empty_grid, encode_gaps, layer_of, moving_average, shares
from spgf_torch.features.relations import alpha2, in_frame, reference_frames, turned
from spgf_torch.geometry.neighbours import HalfPairs
from spgf_torch.geometry.se3 import from_rotation
from spgf_torch.threads import in_parts

# Pairs and features handled at once: their temporaries stay in a CPU's second-level cache. Accelerators take
# more, to fill them.
PAIRS, FEATURES = 1 << 14, 1 << 11
ACCELERATOR = 1 << 7

# The soft alignment looks for its direction on rings this many times finer (2 deg with 36 cells; FEATURES.md).
FINER = 5


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
    same type), on any device. `generator` (CPU) is used by the alignment `random` only. Time and memory grow
    with the number of neighbour pairs and of features; temporaries are bounded.

    Raises InputError for other shapes or types, NaN or infinite values, normals that are not unit vectors.
    """
    _check(positions, normals, config, generator)
    pairs = HalfPairs(positions, config.radius)
    frames = reference_frames(normals, to_neighbours(positions, pairs))
    return describe(positions, frames, pairs, config, generator)


def to_neighbours(positions: Tensor, pairs: HalfPairs) -> Tensor:
    """(N, 3) from each texlet to the mean of its neighbours, m; 0 where it has none.

    The reference axis R_x points there: the paper lets it be arbitrary, and so it turns with the object.
    """
    total = positions.new_zeros((4, len(positions)))
    columns = positions.T.contiguous()
    for i, j in pairs:
        for sums, column in zip(total, columns, strict=False):
            sums.scatter_add_(0, i, column.index_select(0, j))
            sums.scatter_add_(0, j, column.index_select(0, i))
        for end in (i, j):
            total[3].scatter_add_(0, end, total.new_ones(1).expand(len(end)))
    return (total[:3] / total[3].clamp(min=1)).T - positions * (total[3] > 0)[:, None]


def describe(
    positions: Tensor,
    frames: Tensor,
    pairs: HalfPairs,
    config: FeatureConfig,
    generator: torch.Generator | None = None,
) -> Features:
    """`spgf` with the reference frames given: (N, 3, 3), columns (R_x, R_y, normal); and the pairs of neighbours."""
    if config.alignment == "soft":
        frames = _turned_softly(positions, frames, pairs, config)
    grid = sliced_pineapple_grid(positions, frames, pairs, config)
    parts = grid.split(_batch(FEATURES, grid), dim=1)
    drawn = ((part, _drawn(part.shape[1], config, generator)) for part in parts)
    aligned, starts, valid = zip(*in_parts(lambda part: _aligned(*part, config), drawn), strict=True)
    T = from_rotation(turned(frames, _angle(torch.cat(starts), config.cells, frames)), positions)
    return Features(T, torch.cat(aligned), torch.cat(valid))


def sliced_pineapple_grid(
    positions: Tensor, frames: Tensor, pairs: HalfPairs, config: FeatureConfig, soft: bool = False
) -> Tensor:
    """Steps 1 to 3 of section 3.1: sums over neighbours (3, N, 2, cells), as `grid.empty_grid` has them."""
    columns = torch.cat([positions, frames.mT.flatten(1)], dim=1).T.contiguous()  # components first: fast to gather
    grid = empty_grid(len(positions), config.cells, positions)

    def related(ends: tuple[Tensor, Tensor]) -> list[Shares]:
        i, j = ends
        (X_i, F_i), (X_j, F_j) = (_texlet(columns.index_select(1, end)) for end in ends)
        angle = alpha2(F_i[2], F_j[2])
        layer = layer_of(angle).long()
        of_i = shares(config.cells, layer.add(i, alpha=2), in_frame(F_i, X_j - X_i), angle, soft)  # j is near i
        of_j = shares(config.cells, layer.add(j, alpha=2), in_frame(F_j, X_i - X_j), angle, soft)  # and i near j
        return of_i + of_j

    parts = (part for ends in pairs for part in zip(*(end.split(_batch(PAIRS, grid)) for end in ends), strict=True))
    for found in in_parts(related, parts):
        for share in found:
            share.add_to(grid)
    if config.layers == 1:
        grid[:, :, 1] = 0
    return grid


def _aligned(grid: Tensor, start: Tensor | None, config: FeatureConfig) -> tuple[Tensor, Tensor, Tensor]:
    """Steps 4 and 5: the rings (N, 2, cells, 2) of a part of the grid, the cells they start at, and which are valid."""
    rings, filled = smoothed_rings(grid, config)
    start = highest_curvature(rings) if start is None else start.to(rings.device)
    return start_at(rings, start), start, filled.flatten(1).any(dim=1)


def smoothed_rings(grid: Tensor, config: FeatureConfig, soft: bool = False) -> tuple[Tensor, Tensor]:
    """Step 4 of section 3.1: averaged and gap-encoded rings (2, N, 2, cells), and which cells are no gap.

    The paper averages the cells' means, one like another; softly shared neighbours count each for itself.
    """
    sums, weight = (grid[1:], grid[0]) if soft else cell_means(grid)
    rings, filled = moving_average(sums, weight.to(sums.dtype), config.half_length)
    return encode_gaps(rings, filled, config.gaps), filled


def _drawn(N: int, config: FeatureConfig, generator: torch.Generator | None) -> Tensor | None:
    """Step 5 where it does not depend on the rings: the cell (N,) int64 that becomes cell 0."""
    if config.alignment == "random":
        return torch.randint(config.cells, (N,), generator=generator)
    return None if config.alignment == "argmax" else torch.zeros(N, dtype=torch.int64)  # soft: turned already


def _turned_softly(positions: Tensor, frames: Tensor, pairs: HalfPairs, config: FeatureConfig) -> Tensor:
    """The frames turned to the direction of highest curvature of finer, softly filled rings.

    The direction hardly depends on R_x then, as cells 10 deg wide make it. The filter is as wide as before.
    """
    fine = replace(config, cells=FINER * config.cells, half_length=FINER * (config.half_length + 1) - 1)
    grid = sliced_pineapple_grid(positions, frames, pairs, fine, soft=True)
    parts = grid.split(_batch(FEATURES, grid), dim=1)
    start = torch.cat([highest_curvature(smoothed_rings(part, fine, soft=True)[0]) for part in parts])
    return turned(frames, _angle(start, fine.cells, frames))


def _angle(cell: Tensor, cells: int, like: Tensor) -> Tensor:
    """The direction of a cell's centre, in radians and in the precision of `like`."""
    return cell.to(like.dtype) * (2 * math.pi / cells)


def _texlet(columns: Tensor) -> tuple[Tensor, Tensor]:
    """Position (3, P) and frame (axis, component, P) from twelve numbers a texlet."""
    return columns[:3], columns[3:].view(3, 3, -1)


def _batch(size: int, like: Tensor) -> int:
    return size if like.device.type == "cpu" else size * ACCELERATOR


def _check(positions: Tensor, normals: Tensor, config: FeatureConfig, generator: torch.Generator | None) -> None:
    for name, value in (("positions", positions), ("normals", normals)):
        if value.ndim != 2 or value.shape[1] != 3 or len(value) != len(positions):
            raise InputError(f"{name}: expected shape (N, 3), one row a texlet, got {tuple(value.shape)}")
        if value.dtype != positions.dtype or value.dtype not in (torch.float32, torch.float64):
            raise InputError(f"{name}: expected float32 or float64, both alike, got {value.dtype}")
    length = torch.linalg.vector_norm(normals, dim=1)
    if not torch.allclose(length, torch.ones_like(length), atol=1e-3):
        worst = length[(length - 1).abs().nan_to_num(math.inf).argmax()].item()
        raise InputError(f"normals: expected unit vectors, got one of length {worst:.4g}")
    if config.alignment == "random" and generator is None:
        raise InputError("features.alignment: random expected a generator, got None")
