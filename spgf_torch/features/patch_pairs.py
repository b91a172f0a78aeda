"""Pairs of surface patches: the kind of feature that the paper's predecessor learned grasps from, a baseline.

Thomsen et al. (2015) associate "related pairs of small surface patches" with grasps; the paper (section 2) says no
more, so this is a pair in the usual sense. Two oriented points have four relative numbers beside their handedness,
which are the point pair feature of Drost et al. (2010): two elevations, the angle between the normals, the distance.
Their pose is whole without any alignment: one patch gives origin and normal, the other one the direction.

Our choices: every patch is paired with one of its neighbours, drawn at random, within the radius that SPGF has; so
there are as many features, and as many votes, as with the other descriptors.
"""

from __future__ import annotations

import math

import torch
from torch import Generator, Tensor

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.geometry.se3 import from_rotation
from spgf_torch.ops.neighbours import radius_pairs
from spgf_torch.ops.pairwise_relations import frames_in_torch, pairs_in_torch, relations_in_torch

NUMBERS = 4  # of a pair: two elevations, the angle between the normals, the distance

# What the whole radius counts as in k-means, rad: the range of an elevation on one side of the plane.
RADIUS_ANGLE = math.pi / 2


def patch_pairs(
    positions: Tensor, normals: Tensor, config: FeatureConfig, generator: Generator | None = None
) -> VectorFeatures:
    """A pair for each of N texlets: the elevation of the second patch above the first one's plane and of the first
    one's above the second one's, negative above (Eq. 2), the angle between the normals (Eq. 3), and the distance,
    `RADIUS_ANGLE` at `config.radius`.

    positions: (N, 3) in metres, normals: (N, 3) unit, in one frame, of one float type. generator (CPU) draws the
    second patches. T_object_feature: origin and z are the first patch and its normal, x points to the second one. Not
    valid where there is no neighbour, or where the second one lies along the normal.

    Raises InputError without a generator, and for other shapes or values that are not finite.
    """
    if generator is None:
        raise InputError("features.descriptor: patch_pairs expected a generator, got None")
    if normals.shape != positions.shape or not normals.isfinite().all():
        raise InputError(
            f"normals: expected finite numbers of shape {tuple(positions.shape)}, got {tuple(normals.shape)}"
        )
    X, n = positions.detach(), normals.detach()
    second, paired = drawn_neighbours(X, config.radius, generator)
    own, one = torch.arange(len(X), device=X.device), torch.ones(len(X), dtype=torch.int64, device=X.device)
    forth, back = pairs_in_torch(one, second, X, X, n), pairs_in_torch(one, own, X[second], X, n)
    frames = frames_in_torch(n, forth.towards)
    elevation, angle, direction = relations_in_torch(forth, frames)
    distance = torch.linalg.vector_norm(X[second] - X, dim=1) * (RADIUS_ANGLE / config.radius)
    behind = relations_in_torch(back, frames[second])[0]
    vectors = torch.stack([elevation, behind, angle, distance], dim=1).float()
    return VectorFeatures(from_rotation(frames, X), vectors, paired & ~direction.isnan())


def drawn_neighbours(positions: Tensor, radius: float, generator: Generator) -> tuple[Tensor, Tensor]:
    """For each point (N, 3) one of those within `radius`, all equally likely: (N,) int64, and whether there is one.

    A point without any is its own neighbour.
    """
    N = len(positions)
    centre, neighbour = radius_pairs(positions, radius)
    count = torch.bincount(centre, minlength=N)
    share = torch.rand(N, generator=generator, dtype=torch.float64).to(positions.device)
    picked = count.cumsum(0) - count + (share * count).long()
    own = torch.arange(N, device=positions.device)
    if len(neighbour) == 0:
        return own, count > 0
    return torch.where(count > 0, neighbour[picked.clamp(max=len(neighbour) - 1)], own), count > 0
