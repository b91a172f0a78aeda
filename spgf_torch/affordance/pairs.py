"""An object's features paired with the grasps within their reach, and where the pairs lie in the shape-grasp space."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.particles import Particles
from spgf_torch.errors import InputError
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.cell_pairs import cell_pairs as pairs_within_reach

# Cells of a grid: 2 GB for the table of one partition.
MOST_CELLS = 2**28


@dataclass(frozen=True)
class CellPairs:
    """Feature-grasp pairs of one object, with the cell of each in the SE(3) grid: free of K, so computed once.

    Attributes:
        feature, grasp: (P,) int32, or int16 once `narrowed`, of each pair. cell: (P,) int32.
        grasp_type: (G,) int64, of the object's grasps.
    """

    feature: Tensor
    grasp: Tensor
    cell: Tensor
    grasp_type: Tensor

    def of_grasps(self, chosen: Tensor) -> CellPairs:
        """The pairs of the grasps `chosen` (C,) int64 alone, which are numbered 0 .. C - 1 from then on."""
        number = torch.full_like(self.grasp_type, -1, dtype=torch.int32)
        number[chosen] = torch.arange(len(chosen), dtype=torch.int32, device=number.device)
        renumbered = number.index_select(0, self.grasp.int())
        kept = (renumbered >= 0).nonzero()[:, 0]
        feature, cell = self.feature.index_select(0, kept), self.cell.index_select(0, kept)
        return CellPairs(feature, renumbered.index_select(0, kept), cell, self.grasp_type[chosen])

    def narrowed(self) -> CellPairs:
        """With features and grasps in two bytes each where these can count them: two thirds of the memory."""
        columns = (self.feature, self.grasp)
        narrow = all(not len(column) or int(column.max()) <= torch.iinfo(torch.int16).max for column in columns)
        return CellPairs(self.feature.short(), self.grasp.short(), self.cell, self.grasp_type) if narrow else self


def grid_of(config: AffordanceConfig) -> SE3Grid:
    """The SE(3) grid that the settings describe. Raises InputError where its table would not fit into memory."""
    grid = SE3Grid(config.reach, config.voxel, config.rotation_deg)
    if grid.cells > MOST_CELLS:
        raise InputError(
            f"affordance: expected reach, voxel and rotation_deg to give at most {MOST_CELLS:,} cells, "
            f"got {grid.cells:,}"
        )
    return grid


def cell_pairs(
    T_object_feature: Tensor,
    T_object_grasp: Tensor,
    grasp_type: Tensor,
    config: AffordanceConfig,
    generator: torch.Generator | None = None,
) -> CellPairs:
    """Pairs of an object's features (F, 4, 4) and grasps (G, 4, 4) within reach, and their cells.

    With a generator and more than `features_per_object` features, a random subset of them takes part.
    """
    chosen = torch.arange(len(T_object_feature), device=T_object_feature.device)
    if generator is not None and len(chosen) > config.features_per_object:
        drawn = torch.randperm(len(chosen), generator=generator)[: config.features_per_object]
        chosen = drawn.sort().values.to(chosen.device)
    feature, grasp, cell = pairs_within_reach(T_object_feature[chosen], T_object_grasp, grid_of(config).numbers)
    return CellPairs(chosen.int().index_select(0, feature), grasp, cell, grasp_type)


def shape_grasp_particles(pairs: CellPairs, ids: Tensor, types: int, success: Tensor | None = None) -> Particles:
    """The particles of one object, for a hand of so many grasp types.

    Args:
        ids: (F,) int64 prototypes of its features. success: (G,) bool outcomes of its grasps, if they are known.
    """
    grasp = pairs.grasp.int()
    first = (ids.int() * types).index_select(0, pairs.feature.int())
    partition = first.add_(pairs.grasp_type.int().index_select(0, grasp))
    return Particles(partition, pairs.cell, types, None if success is None else success.index_select(0, grasp))
