"""Pairs of features and grasps within reach, and the cell of the grasp as the feature sees it."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.registration import operator, unknown_size
from spgf_torch.ops.relative_cells import Features, Grasps, Grid, cells_from, pair_cells, scratch_for
from spgf_torch.threads import in_parts

# Features of one part of the work on a CPU: a millisecond or more.
FEATURES_TOGETHER = 64

Columns = tuple[Tensor, Tensor, Tensor]


@operator(
    "cell_pairs(Tensor T_object_feature, Tensor T_object_grasp, float[] lattice) "
    "-> (Tensor feature, Tensor grasp, Tensor cell)"
)
def cell_pairs(T_object_feature: Tensor, T_object_grasp: Tensor, lattice: list[float]) -> Columns:
    """Feature, grasp and cell (P,) int32 of the pairs within reach, by feature, then grasp. In float64.

    T_object_feature (F, 4, 4), T_object_grasp (G, 4, 4), m; lattice: reach, voxel and rotation_deg of a `SE3Grid`.
    """
    none = T_object_feature.new_empty(0, dtype=torch.int32)
    columns = zip((none, none, none), *pair_cells(T_object_feature, T_object_grasp, SE3Grid(*lattice)), strict=True)
    feature, grasp, cell = (torch.cat([part.int() for part in column]) for column in columns)
    return feature, grasp, cell


@cell_pairs.on_cpu
def _in_loops(T_object_feature: Tensor, T_object_grasp: Tensor, lattice: list[float]) -> Columns:
    features, grasps, grid = Features.of(T_object_feature), Grasps.of(T_object_grasp), Grid.of(SE3Grid(*lattice))
    parts = [slice(i, i + FEATURES_TOGETHER) for i in range(0, len(features.T), FEATURES_TOGETHER)]
    counts = np.zeros(len(features.T), np.int64)
    list(in_parts(lambda part: _count(features.at(part), grasps, grid, counts[part]), parts))
    start = np.append(0, counts.cumsum())
    feature, grasp, cell = (np.empty(start[-1], np.int32) for _ in range(3))

    def fill(part: slice) -> None:
        own = slice(start[part.start], start[min(part.stop, len(counts))])
        _list(features.at(part), grasps, grid, part.start, feature[own], grasp[own], cell[own])

    list(in_parts(fill, parts))
    return torch.from_numpy(feature), torch.from_numpy(grasp), torch.from_numpy(cell)


@cell_pairs.fake
def _shapes(T_object_feature: Tensor, T_object_grasp: Tensor, lattice: list[float]) -> Columns:
    P = unknown_size()
    feature, grasp, cell = (T_object_feature.new_empty(P, dtype=torch.int32) for _ in range(3))
    return feature, grasp, cell


@lean
def _count(features: Features, grasps: Grasps, grid: Grid, counts: np.ndarray) -> None:
    """Out: counts (F,) int64 of the grasps within reach of each feature."""
    T, position, reach = features.T, grasps.position, grid.reach
    for i in range(len(T)):
        near = 0
        for j in range(position.shape[1]):
            x, y, z = position[0, j] - T[i, 0, 3], position[1, j] - T[i, 1, 3], position[2, j] - T[i, 2, 3]
            near += x * x + y * y + z * z <= reach * reach
        counts[i] = near


@compiled
def _list(
    features: Features,
    grasps: Grasps,
    grid: Grid,
    number: int,
    feature: np.ndarray,
    grasp: np.ndarray,
    cell: np.ndarray,
) -> None:
    """Out: feature (the first of which has this number), grasp and cell (P,) int32 of the pairs within reach."""
    size = grasps.position.shape[1]
    scratch, row, n = scratch_for(size), np.empty(size, np.int32), 0
    for i in range(len(features.T)):
        cells_from(features, i, grasps, grid, scratch, row)
        for j in range(size):
            if row[j] >= 0:
                feature[n], grasp[n], cell[n] = number + i, j, row[j]
                n += 1
