"""Which texlets belong together: things that stand apart on a table, found without knowing any of them.

Texlets within reach of each other are one body, unless the surface is hollow between them, as where two things touch
(Stein, Schoeler, Papon, Woergoetter 2014: locally convex connected patches, here of single texlets). A thing that is
seen in pieces is several bodies, and things whose surfaces run into each other are one.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from torch import Tensor

from spgf_torch.proposing.config import NeighboursConfig
from spgf_torch.sensing.texlets import Texlets


def bodies_of(texlets: Texlets, config: NeighboursConfig) -> Tensor:
    """(N,) int64: the body that each texlet is of, numbered from 0."""
    points, normals = (part.double().cpu().numpy() for part in (texlets.positions, texlets.normals))
    pairs = cKDTree(points).query_pairs(config.body_link, output_type="ndarray")
    first, second = pairs.T
    hollow = ((normals[first] - normals[second]) * (points[second] - points[first])).sum(1) > 0
    level = (normals[first] * normals[second]).sum(1) >= math.cos(math.radians(config.body_hollow_deg))
    joined = ~hollow | level
    links = coo_array((np.ones(joined.sum()), (first[joined], second[joined])), shape=(len(points),) * 2)
    return torch.from_numpy(connected_components(links, directed=False)[1]).long()


def body_at(places: Tensor, positions: Tensor, bodies: Tensor) -> Tensor:
    """(G,) int64: the body of the texlet at positions (N, 3) that is nearest to each place (G, 3)."""
    return bodies[cKDTree(positions.cpu().numpy()).query(places.detach().cpu().numpy())[1]]
