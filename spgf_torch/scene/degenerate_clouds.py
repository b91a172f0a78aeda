"""What shows no surface that fingers could close on: points on lines, and one plane by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.normals import neighbourhoods, on_lines
from spgf_torch.scene.planes import LargestPlane, height

# Spread across over spread along all points, beneath which they are a line; that of a pencil is 0.05.
_THIN = 0.03
# Of the points that have neighbours, those on lines: more, and the lines are all that there is.
_LINES = 0.5
# Of all points in one plane, and of all normals to its side, unless it is as wide as a table: more, and there may be
# nothing else.
_PLANE, _SIDE, _ALIKE = 0.9, 0.98, 0.5
# What stands off a plane: cells of this side, m, side by side, that hold so many points beyond noise of so many sigma.
_CELL, _THING, _NOISE = 0.01, 20, 4.0
# Of the points in one plane: more, in a scene without a table, and it may be one.
_FLAT = 0.5


def why_no_grasp(
    targets: Sequence[Cloud], facing: Sequence[Cloud], largest: LargestPlane, table: np.ndarray | None
) -> str | None:
    """Why there can be no grasp, in words; None where there may be some.

    Args:
        targets: the points of the targets. facing: those of them that have a normal, with it. largest: their plane.
        table: (4,); a plane that is known to stand above it is the top of something. None: not known.
    """
    points = np.concatenate([cloud.points for cloud in targets])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) if len(points) > 2 else np.zeros(3)
    if spread[1] <= _THIN * spread[0]:
        return "the points lie on one line, which shows no surface"
    bare = [cloud for cloud in targets if cloud.normals is None]
    if bare and _on_lines(bare, largest.config) > _LINES:
        return (
            "the points lie along lines, as a sparse scanner's, which show no surface; a denser cloud, or a larger "
            "voxel and normal_radius?"
        )
    normals = np.concatenate([cloud.normals for cloud in facing if cloud.normals is not None])
    if table is None and len(largest.points) > 2 and _flat(largest, normals):
        return (
            "all points lie in one plane and nothing else is known: a table, a wall, the top of a box? give more of "
            "the scene and table=find, or table=[a,b,c,d]"
        )
    return None


def _flat(largest: LargestPlane, normals: np.ndarray) -> bool:
    """Whether points with their normals (N, 3) are one plane and nothing that stands out of it."""
    points, config, found = largest.points, largest.config, largest.found
    if found is None or found.share < _PLANE:
        return False
    side = normals @ found.plane[:3]
    if found.width < config.table_width and max(float((s * side > _ALIKE).mean()) for s in (1, -1)) < _SIDE:
        return False
    over = height(points, found.plane)
    noise = 1.4826 * float(np.median(np.abs(over)))  # sigma of a normal distribution
    off = points[np.abs(over) > max(config.table_distance, _NOISE * noise)]
    if len(off) < _THING:
        return True
    cells, count = np.unique(np.floor(off / _CELL).astype(np.int64), axis=0, return_counts=True)
    pairs = cKDTree(cells).query_pairs(np.sqrt(3) + 0.1, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    thing = connected_components(links, directed=False)[1]
    return bool(np.bincount(thing, weights=count).max() < _THING)


def flat_hint(points: np.ndarray, normals: np.ndarray, table: np.ndarray | None, config: SceneConfig) -> str | None:
    """A line that proposes to look for a table, where most points (N, 3) lie in a wide plane and none is known."""
    if table is not None or np.ptp(points, axis=0).max() < config.table_width:
        return None
    found = LargestPlane(points, config).found
    if found is None or found.width < config.table_width or found.share < _FLAT:
        return None
    facing = float((np.abs(normals[found.on] @ found.plane[:3]) > _ALIKE).mean())
    if facing < _FLAT:
        return None
    return f"hint: {found.share:.0%} of the points lie in one plane; if objects stand on it, table=find tells it apart"


def _on_lines(clouds: Sequence[Cloud], config: SceneConfig) -> float:
    """The share of points whose neighbours lie on a line with them, of those that have neighbours."""
    lined, counted = 0, 0
    for cloud in clouds:
        index, _ = neighbourhoods(cloud.points, config.neighbours, config.normal_radius)
        enough = (index != np.arange(len(index))[:, None]).sum(axis=1) >= config.min_neighbours
        lined += int((on_lines(cloud.points, index) & enough).sum())
        counted += int(enough.sum())
    return lined / counted if counted else 0.0
