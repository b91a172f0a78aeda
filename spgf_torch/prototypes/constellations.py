"""Words over constellations of prototypes: what local shapes lie around a feature, in a wider neighbourhood.

The paper names "more elaborated features" as its next step (section 6); how is ours. Around each feature, beyond what
its own rings describe, the neighbours are sorted by their direction in the feature's own frame into sectors. The share
of each prototype in each sector, beside the feature's own prototype, is a vector that is the same for a turned object,
since frame and neighbours turn together. k-means makes words of these vectors, and words take the place of prototypes
from there on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.geometry.se3 import inverse, position_of, rotation_of
from spgf_torch.ops.neighbours import radius_pairs
from spgf_torch.prototypes.config import ConstellationConfig


@dataclass(frozen=True)
class Surroundings:
    """The neighbours of features, free of K: centre, neighbour, sector (P,) int64 of each pair."""

    centre: Tensor
    neighbour: Tensor
    sector: Tensor


def surroundings(T_object_feature: Tensor, config: ConstellationConfig) -> Surroundings:
    """Neighbours between `config.inner` and `config.outer` m of each of (F, 4, 4) poses, and their sectors.

    Sector k of n lies about the direction k * 2 pi / n from the feature's x towards its y.
    """
    at = position_of(T_object_feature)
    centre, neighbour = (index.long() for index in radius_pairs(at, config.outer))
    shift = at[neighbour] - at[centre]
    far = torch.linalg.vector_norm(shift, dim=1) > config.inner
    centre, neighbour, shift = centre[far], neighbour[far], shift[far]
    local = (rotation_of(inverse(T_object_feature[centre])) @ shift[:, :, None])[:, :, 0]
    turn = torch.atan2(local[:, 1], local[:, 0]) / (2 * math.pi) * config.sectors
    return Surroundings(centre, neighbour, turn.round().long() % config.sectors)


def constellations(ids: Tensor, K: int, around: Surroundings, config: ConstellationConfig) -> Tensor:
    """(F, (1 + sectors) K) float32 of features with prototypes ids (F,): the own one, then the shares of each sector.

    A sector without neighbours is all zeros.
    """
    F, n = len(ids), config.sectors
    place = (around.centre * n + around.sector) * K + ids[around.neighbour]
    counts = torch.bincount(place, minlength=F * n * K).view(F, n, K).float()
    shares = counts / counts.sum(2, keepdim=True).clamp(min=1)
    own = config.own * torch.nn.functional.one_hot(ids, K).float()
    return torch.cat([own, shares.flatten(1)], dim=1)
