"""Which texlets lie where a border of the image, of a mask, of a crop box or of the cloud cuts their surface.

Three signs: in some direction along the surface no image shows what follows; a straight outline of the whole cloud is
near; or what follows was seen, as part of something that is no target, without a step in depth. In the first two nobody
knows what follows, so the surface counts as cut for some way before the border as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView, behind

# Texlet spacings to a border within which a texlet lies on it; a texlet is a mean of points around it.
_NEAR = 2.0
# Directions along the surface that are looked into.
_DIRECTIONS = 8
# A surface goes on where it leaves its plane by no more than this share of the distance and so many m: of a ball of
# 4 cm 12 mm further on 1.8 mm, and the noise of a depth camera.
_SLOPE, _NOISE = 0.15, 0.003
# m from the nearest texlet of a target, between which what goes on is looked for: masks are some pixels too small.
_FIRST, _LAST = 0.008, 0.015
# Points of it that are no chance.
_SOME = 3
# Cosine of two texlets' normals, below which a surface bends too much to be one.
_BENT = 0.7
# Component of a plane's normal along the surface, below which the surface runs along the border, not into it.
_ALONG = 0.3
# Cosine with which a texlet faces over a border, and the share of texlets there from which on it is a true edge.
_FACES, _EDGE = 0.7, 0.33


def cut_borders(
    texlets: Texlets, others: np.ndarray, views: Sequence[DepthView], planes: np.ndarray, spacing: float, reach: float
) -> torch.Tensor:
    """(N, 3) f32 of each texlet the unit vector along its surface over the border that cuts it; NaN: there is none.

    A zero vector: in all directions.

    Args:
        others: (M, 3) m, sensed points that are of no target or of others. views: () where there are no images.
        planes: (L, 4) of `outline.straight_borders`. spacing: m between texlets.
        reach: m along the surface, as far from a border as it counts as cut where nobody knows what follows.
    """
    positions, normals = (t.double().numpy() for t in (texlets.positions, texlets.normals))
    beyond = np.full((len(positions), 3), np.nan)
    if not len(positions):
        return torch.from_numpy(beyond).float()
    unknown = np.zeros_like(positions)
    on = np.zeros(len(positions), bool)
    for found, direction in (
        _outside_images(texlets, views, _NEAR * spacing),
        _at_planes(positions, normals, planes, _NEAR * spacing),
    ):
        unknown[found] += direction[found]
        on |= found
    if on.any():
        home = _grown(positions, normals, on, spacing, reach)
        beyond[home >= 0] = _unit(unknown)[home[home >= 0]]
    goes_on, direction = _into_others(positions, normals, others)
    seen = goes_on & (home < 0) if on.any() else goes_on
    beyond[seen] = direction[seen]
    return torch.from_numpy(beyond).float()


def _outside_images(texlets: Texlets, views: Sequence[DepthView], away: float) -> tuple[np.ndarray, np.ndarray]:
    """Which texlets (N,) have a place that no image shows `away` (m) along the surface; in which directions (N, 3)."""
    if not views:
        return np.zeros(len(texlets), bool), np.zeros((len(texlets), 3))
    u, v = _tangents(texlets.normals.double().numpy())
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    around = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    places = texlets.positions[:, None] + away * torch.from_numpy(around).float()
    outside = behind(places, views).isinf().numpy()
    return outside.any(axis=1), _unit((around * outside[..., None]).sum(axis=1))


def _at_planes(
    positions: np.ndarray, normals: np.ndarray, planes: np.ndarray, near: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which texlets (N,) lie within `near` (m) of a plane that cuts their surface; the directions over it (N, 3)."""
    found, direction = np.zeros(len(positions), bool), np.zeros_like(positions)
    for plane in planes:
        close = positions @ plane[:3] + plane[3] > -near
        facing = normals @ plane[:3]
        if not close.any() or (facing[close] > _FACES).mean() > _EDGE:
            continue
        along = plane[:3] - facing[:, None] * normals
        cut = close & (np.linalg.norm(along, axis=1) > _ALONG)
        found |= cut
        direction[cut] += along[cut]
    return found, _unit(direction)


def _into_others(positions: np.ndarray, normals: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which texlets' (N,) surface goes on in other sensed points (M, 3), and in which directions (N, 3)."""
    found, direction = np.zeros(len(positions), bool), np.zeros_like(positions)
    low, high = positions.min(axis=0) - _LAST, positions.max(axis=0) + _LAST
    others = others[((others >= low) & (others <= high)).all(axis=1)]
    if not len(others):
        return found, direction
    away, nearest = cKDTree(positions).query(others, distance_upper_bound=_LAST)
    far = np.flatnonzero((away >= _FIRST) & np.isfinite(away))
    home, step = nearest[far], others[far] - positions[nearest[far]]
    flat = np.abs((step * normals[home]).sum(axis=1)) <= _SLOPE * away[far] + _NOISE
    # Nothing but the surface lies between: a thing apart, however flush, is another.
    joined = cKDTree(others).query(positions[home] + 0.6 * step, distance_upper_bound=_FIRST / 2)[0]
    on = flat & np.isfinite(joined)
    found = np.bincount(home[on], minlength=len(positions)) >= _SOME
    np.add.at(direction, home[on], step[on] - (step[on] * normals[home[on]]).sum(axis=1)[:, None] * normals[home[on]])
    return found, _unit(direction)


def _grown(positions: np.ndarray, normals: np.ndarray, on: np.ndarray, spacing: float, reach: float) -> np.ndarray:
    """(N,) int: of each texlet the nearest along the surface of those `on` (N,) a border; -1 beyond reach, m."""
    pairs = cKDTree(positions).query_pairs(_NEAR * spacing, output_type="ndarray")
    i, j = pairs.T
    step = positions[j] - positions[i]
    length = np.linalg.norm(step, axis=1)
    off = np.maximum(np.abs((step * normals[i]).sum(axis=1)), np.abs((step * normals[j]).sum(axis=1)))
    smooth = ((normals[i] * normals[j]).sum(axis=1) > _BENT) & (off <= _SLOPE * length + _NOISE)
    size = (len(positions),) * 2
    graph = coo_array((length[smooth], (i[smooth], j[smooth])), size).tocsr()
    away, _, source = dijkstra(
        graph, directed=False, indices=np.flatnonzero(on), limit=reach, min_only=True, return_predecessors=True
    )
    return np.where(np.isfinite(away), source, -1)


def _tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (N, 3) each across normals (N, 3)."""
    helper = np.where(np.abs(normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = _unit(np.cross(normals, helper))
    return u, np.cross(normals, u)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) of length 1; 0 stays 0."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
