"""An object's features paired with the grasps within their reach, and where the pairs lie in the shape-grasp space.

Pairs are many: some 600,000 an object of 2000 grasps, while a few thousand poses say all of them. `PosePairs` holds the
poses, and lists pairs when it is asked for them; `CellPairs` are listed pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.particles import Particles
from spgf_torch.errors import InputError
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.cell_pairs import cell_pairs as pairs_within_reach

# Cells of a grid: 2 GB for the table of one partition.
MOST_CELLS = 2**28


class Pairs(Protocol):
    """Pairs of one object's features (F,) and grasps (G,), listed or not."""

    @property
    def grasp_type(self) -> Tensor:
        """(G,) int64."""

    def of_grasps(self, chosen: Tensor) -> Pairs:
        """The pairs of the grasps `chosen` (C,) int64 alone, which are numbered 0 .. C - 1 from then on."""

    def listed(self, wanted: Tensor | None = None) -> CellPairs:
        """The pairs of the features `wanted` (F,) bool, in their order; None: of all."""

    def most(self, features: int) -> Tensor:
        """(F,) int64, given F: at most so many pairs has each feature."""


@dataclass(frozen=True)
class CellPairs:
    """Feature-grasp pairs of one object, with the cell of each in the SE(3) grid: free of K.

    Attributes:
        feature, grasp, cell: (P,) int32 of each pair.
        grasp_type: (G,) int64, of the object's grasps.
    """

    feature: Tensor
    grasp: Tensor
    cell: Tensor
    grasp_type: Tensor

    def of_grasps(self, chosen: Tensor) -> CellPairs:
        """As `Pairs` has it."""
        number = torch.full_like(self.grasp_type, -1, dtype=torch.int32)
        number[chosen] = torch.arange(len(chosen), dtype=torch.int32, device=number.device)
        renumbered = number.index_select(0, self.grasp)
        return replace(self._at(renumbered >= 0, renumbered), grasp_type=self.grasp_type[chosen])

    def listed(self, wanted: Tensor | None = None) -> CellPairs:
        """As `Pairs` has it."""
        return self if wanted is None else self._at(wanted.index_select(0, self.feature), self.grasp)

    def most(self, features: int) -> Tensor:
        """As `Pairs` has it: so many it has."""
        return torch.bincount(self.feature, minlength=features)

    def _at(self, which: Tensor, grasp: Tensor) -> CellPairs:
        kept = which.nonzero()[:, 0]
        feature, grasp, cell = (column.index_select(0, kept) for column in (self.feature, grasp, self.cell))
        return CellPairs(feature, grasp, cell, self.grasp_type)


@dataclass(frozen=True)
class PosePairs:
    """The same pairs as poses say them: listed, by feature, then grasp, whenever they are asked for, and not kept.

    Attributes:
        feature: (N,) int64, ascending, the features that take part.
        T_object_feature: (N, 4, 4) f32, theirs, m. T_object_grasp: (G, 4, 4) f32, m.
        grasp_type: (G,) int64.
        grid: whose cells are meant.
    """

    feature: Tensor
    T_object_feature: Tensor
    T_object_grasp: Tensor
    grasp_type: Tensor
    grid: SE3Grid

    def of_grasps(self, chosen: Tensor) -> PosePairs:
        """As `Pairs` has it."""
        return replace(self, T_object_grasp=self.T_object_grasp[chosen], grasp_type=self.grasp_type[chosen])

    def listed(self, wanted: Tensor | None = None) -> CellPairs:
        """As `Pairs` has it."""
        number, T = self.feature, self.T_object_feature
        if wanted is not None:
            kept = wanted[number].nonzero()[:, 0]
            number, T = number[kept], T[kept]
        feature, grasp, cell = pairs_within_reach(T, self.T_object_grasp, self.grid.numbers)
        return CellPairs(number.int().index_select(0, feature), grasp, cell, self.grasp_type)

    def most(self, features: int) -> Tensor:
        """As `Pairs` has it: as if all grasps were within reach."""
        most = self.feature.new_zeros(features)
        most[self.feature] = len(self.grasp_type)
        return most


def grid_of(config: AffordanceConfig) -> SE3Grid:
    """The SE(3) grid that the settings describe. Raises InputError where its table would not fit into memory."""
    grid = SE3Grid(config.reach, config.voxel, config.rotation_deg)
    if grid.cells > MOST_CELLS:
        raise InputError(
            f"affordance: expected reach, voxel and rotation_deg to give at most {MOST_CELLS:,} cells, "
            f"got {grid.cells:,}"
        )
    return grid


def pose_pairs(
    T_object_feature: Tensor,
    T_object_grasp: Tensor,
    grasp_type: Tensor,
    config: AffordanceConfig,
    generator: torch.Generator | None = None,
) -> PosePairs:
    """Pairs of an object's features (F, 4, 4) and grasps (G, 4, 4) within reach.

    With a generator and more than `features_per_object` features, a random subset of them takes part.
    """
    chosen = torch.arange(len(T_object_feature), device=T_object_feature.device)
    if generator is not None and len(chosen) > config.features_per_object:
        drawn = torch.randperm(len(chosen), generator=generator)[: config.features_per_object]
        chosen = drawn.sort().values.to(chosen.device)
    return PosePairs(chosen, T_object_feature[chosen], T_object_grasp, grasp_type, grid_of(config))


def cell_pairs(
    T_object_feature: Tensor,
    T_object_grasp: Tensor,
    grasp_type: Tensor,
    config: AffordanceConfig,
    generator: torch.Generator | None = None,
) -> CellPairs:
    """The same, listed."""
    return pose_pairs(T_object_feature, T_object_grasp, grasp_type, config, generator).listed()


def shape_grasp_particles(pairs: CellPairs, ids: Tensor, types: int, success: Tensor | None = None) -> Particles:
    """The particles of one object, for a hand of so many grasp types.

    Args:
        ids: (F,) int64 prototypes of its features. success: (G,) bool outcomes of its grasps, if they are known.
    """
    first = (ids.int() * types).index_select(0, pairs.feature)
    partition = first.add_(pairs.grasp_type.int().index_select(0, pairs.grasp))
    return Particles(partition, pairs.cell, types, None if success is None else success.index_select(0, pairs.grasp))
