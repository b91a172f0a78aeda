"""An object's features paired with the grasps within their reach, and where the pairs lie in the shape-grasp space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.casting import ROWS, count_within, list_pairs
from spgf_torch.affordance.particles import Particles, Points, pairs_within
from spgf_torch.config import GRASP_TYPES, AffordanceConfig, InputError
from spgf_torch.geometry import se3
from spgf_torch.geometry.lattice import Lattice
from spgf_torch.threads import in_parts

# Cells of a lattice: 2 GB for the table of one slice.
MOST_CELLS = 2**28

# Features x grasps looked at together on an accelerator.
TOGETHER = 1 << 24

# Features of one part of the work on a CPU: a millisecond or more.
FEATURES_TOGETHER = 64


@dataclass(frozen=True)
class CellPairs:
    """Feature-grasp pairs of one object, with the lattice cell of each: free of K, so computed once.

    Attributes:
        feature (P,) int32, grasp (P,) int32, cell (P,) int32.
        grasp_type (G,) int64 of the object's grasps.
    """

    feature: Tensor
    grasp: Tensor
    cell: Tensor
    grasp_type: Tensor

    def of_grasps(self, chosen: Tensor) -> CellPairs:
        """The pairs of the grasps `chosen` (C,) int64 alone, which are numbered 0 .. C - 1 from then on."""
        number = torch.full_like(self.grasp_type, -1, dtype=torch.int32)
        number[chosen] = torch.arange(len(chosen), dtype=torch.int32, device=number.device)
        renumbered = number.index_select(0, self.grasp)
        kept = (renumbered >= 0).nonzero()[:, 0]
        feature, cell = self.feature.index_select(0, kept), self.cell.index_select(0, kept)
        return CellPairs(feature, renumbered.index_select(0, kept), cell, self.grasp_type[chosen])


def lattice_of(config: AffordanceConfig) -> Lattice:
    """The lattice that the settings describe. Raises InputError where its table would not fit into memory."""
    lattice = Lattice(config.reach, config.voxel, config.rotation_deg)
    if lattice.cells > MOST_CELLS:
        raise InputError(
            f"affordance: expected reach, voxel and rotation_deg to give at most {MOST_CELLS:,} cells, "
            f"got {lattice.cells:,}"
        )
    return lattice


def cell_pairs(
    T_object_feature: Tensor,
    T_object_grasp: Tensor,
    grasp_type: Tensor,
    config: AffordanceConfig,
    generator: torch.Generator | None = None,
) -> CellPairs:
    """Pairs of an object's features (F, 4, 4) and grasps (G, 4, 4) within reach, and their lattice cells.

    With a generator and more than `features_per_object` features, a random subset of them takes part.
    """
    chosen = torch.arange(len(T_object_feature), device=T_object_feature.device)
    if generator is not None and len(chosen) > config.features_per_object:
        drawn = torch.randperm(len(chosen), generator=generator)[: config.features_per_object]
        chosen = drawn.sort().values.to(chosen.device)
    lattice, device = lattice_of(config), chosen.device
    listed = listed_pairs if device.type == "cpu" else pairs_at_once
    feature, grasp, cell = listed(T_object_feature[chosen], T_object_grasp, lattice)
    return CellPairs(chosen.int().index_select(0, feature), grasp, cell, grasp_type)


def listed_pairs(T_object_feature: Tensor, T_object_grasp: Tensor, lattice: Lattice) -> tuple[Tensor, Tensor, Tensor]:
    """Feature, grasp and cell (P,) int32 of the pairs within reach, by feature, then grasp: the CPU's way."""
    T, quaternion = poses_of(T_object_feature)
    position, turned = columns_of(T_object_grasp)
    reach, voxel, side, edges = numbers_of(lattice)
    parts = [slice(first, first + FEATURES_TOGETHER) for first in range(0, len(T), FEATURES_TOGETHER)]
    counts = np.zeros(len(T), np.int64)
    list(in_parts(lambda part: count_within(T[part], position, reach, counts[part]), parts))
    start, size = np.append(0, counts.cumsum()), position.shape[1]
    feature, grasp, cell = (np.empty(start[-1], np.int32) for _ in range(3))

    def fill(part: slice) -> None:
        first, features, grasps = start[part.start], (T[part], quaternion[part]), (position, turned)
        memory, found = (
            (np.empty((ROWS, size)), np.empty(size, np.int32)),
            (feature[first:], grasp[first:], cell[first:]),
        )
        list_pairs(*features, *grasps, reach, voxel, side, edges, *memory, part.start, *found)

    list(in_parts(fill, parts))
    return torch.from_numpy(feature), torch.from_numpy(grasp), torch.from_numpy(cell)


def poses_of(T: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, 4, 4) on the CPU, and their quaternions (N, 4) wxyz, as the compiled loops take features: f64."""
    T = T.double().contiguous()
    return T.numpy(), se3.quaternion_of(T).contiguous().numpy()


def columns_of(T: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Positions (3, N) and quaternions (4, N) of poses (N, 4, 4) on the CPU, as the loops take grasps: f64."""
    T = T.double()
    return se3.position_of(T).T.contiguous().numpy(), se3.quaternion_of(T).T.contiguous().numpy()


def numbers_of(lattice: Lattice) -> tuple[float, float, int, np.ndarray]:
    """The lattice as the compiled loops take it."""
    return lattice.reach, lattice.voxel, lattice.side, lattice.edges.numpy()


def pairs_at_once(T_object_feature: Tensor, T_object_grasp: Tensor, lattice: Lattice) -> tuple[Tensor, Tensor, Tensor]:
    """The same by torch's operations: an accelerator's way."""
    columns = []
    step = max(1, TOGETHER // max(1, len(T_object_grasp)))
    for first in range(0, max(1, len(T_object_feature)), step):
        pairs = pairs_within(T_object_feature[first : first + step], T_object_grasp, lattice.reach)
        cell = lattice.index(pairs.position, pairs.quaternion)
        columns.append((pairs.feature.int() + first, pairs.grasp.int(), cell.int()))
    feature, grasp, cell = (torch.cat(column) for column in zip(*columns, strict=True))
    return feature, grasp, cell


def shape_grasp_particles(pairs: CellPairs, ids: Tensor, success: Tensor) -> Particles:
    """The particles of one object: ids (F,) int64 of its features, success (G,) bool of its grasps."""
    points = points_of(pairs, ids)
    return Particles(points.slice, points.cell, success.index_select(0, pairs.grasp))


def points_of(pairs: CellPairs, ids: Tensor) -> Points:
    """Where an object's pairs lie in the shape-grasp space: ids (F,) int64 of its features."""
    first = (ids.int() * len(GRASP_TYPES)).index_select(0, pairs.feature)
    return Points(first.add_(pairs.grasp_type.int().index_select(0, pairs.grasp)), pairs.cell)
