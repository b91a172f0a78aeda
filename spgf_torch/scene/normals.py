"""Normals of a point cloud: estimated from neighbours, turned to the viewpoints, and checked where they are given.

Estimated as in sensing/planes.py, as the direction of least variance (PCA) of the points around each, in two rounds:
the second leaves out neighbours that the first found to face elsewhere. On a wall of 3 mm it lowers the share of
normals off by more than 20 deg from 10 to 3 %.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from spgf_torch.errors import InputError
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.sensing.planes import smallest_eigenvectors

# Points whose neighbours are looked at together: bounds the memory.
_CHUNK = 1 << 16
_ROW, _COLUMN = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])
# Cosine of the angle between normals of one surface: sensing's rival_deg.
_ALIKE = 0.5
# Of an even grid, the fourth neighbour is as far as the first.
_PITCH_NEIGHBOUR = 4
# Side of a cell of the image from a viewpoint, in median distances of neighbouring points: no holes in a surface.
_CELL = 3.0
# A view that sees a point head-on is preferred to a grazing one by this much of the cloud's pitch.
_FACING = 0.25
# A point further behind the front than this much of a cell is hidden.
_HIDDEN = 0.5
# Mean of n . u over extreme points of a closed surface: about 0.8 outwards, 0 for a plane or a single view's half.
INWARDS = -0.3
_DIRECTIONS = 200
# Spread across over spread along a neighbourhood, squared: a row of points with 1 mm of noise in 20 mm has 0.03, two
# rows side by side as much, the three of a mug's handle 0.1.
_LINE = 0.04
# A camera's field of view is below 180 deg: no more of its points than this lie beside or behind it.
BEHIND = 0.01
# Of six of our objects at most 2 % of the points lie behind others as seen from their own cameras, but 20 to 33 % of
# four cameras' points as seen from one of them, and 40 to 56 % of a whole surface's.
_UNSEEN = 0.1


def oriented(cloud: Cloud, config: SceneConfig, notes: list[str] | None = None) -> Cloud:
    """The cloud without its outliers and with normals out of the surface.

    A point with fewer than `config.min_neighbours` others within `config.normal_radius` is an outlier. Given normals
    are checked, missing ones estimated and turned to the viewpoint that sees each point best; a point with fewer
    neighbours that face as it does, or whose neighbours lie on a line with it, is an outlier too.

    Args:
        cloud: m.
        notes: gets a line, which begins with "warning", where many points lie behind others as seen from the
            viewpoints: those did not see them, and which side of their normals is outwards is a guess.

    Raises:
        InputError: neither normals nor viewpoints, a viewpoint among the points, given normals that mostly point
            inwards.
    """
    if cloud.normals is None and cloud.viewpoints is None:
        raise InputError(
            f"{cloud.name}: expected normals or a viewpoint that tells their side, got neither; "
            "give viewpoints=[[x,y,z],...]"
        )
    enough = max(config.min_neighbours, _PITCH_NEIGHBOUR) + 1  # the others tell a normal, where there is none
    count = config.neighbours if cloud.normals is None else min(config.neighbours, enough)
    index, pitch = neighbourhoods(cloud.points, count, config.normal_radius)
    kept = (index != np.arange(len(index))[:, None]).sum(axis=1) >= config.min_neighbours
    if not kept.any():
        return replace(cloud.select(kept), normals=np.zeros((0, 3)))
    if cloud.normals is None:
        assert cloud.viewpoints is not None
        _check_outside(cloud)
        kept &= ~on_lines(cloud.points, index)
        rough, hidden = facing(cloud.points, principal_normals(cloud.points, index)[0], cloud.viewpoints, pitch)
        unseen = hidden_share(hidden, pitch)
        if notes is not None and unseen > _UNSEEN:
            notes.append(
                f"warning: {cloud.name}: {unseen:.0%} of the points lie behind others as seen from the viewpoints, and "
                "may get normals that point inwards; give all viewpoints, one file a view, or normals"
            )
        normals, alike = principal_normals(cloud.points, index, rough)
        return replace(cloud, normals=normals).select(kept & (alike >= config.min_neighbours))
    cloud = cloud.select(kept)
    _check_outwards(cloud, pitch)
    return cloud


def neighbourhoods(points: np.ndarray, neighbours: int, radius: float) -> tuple[np.ndarray, float]:
    """The nearest points around every point.

    Args:
        points: (N, 3) m.
        neighbours: nearest points that count, the point itself included.
        radius: m; points further away do not count.

    Returns:
        index: (N, neighbours) int32, nearest first; the point's own in place of those too far away.
        pitch: median distance of neighbouring points, m; at most `radius`.
    """
    tree, threads = cKDTree(points), torch.get_num_threads()
    index = np.empty((len(points), neighbours), np.int32)
    beside = np.empty(len(points))
    for start in range(0, len(points), _CHUNK):
        part = slice(start, start + _CHUNK)
        distance, found = tree.query(points[part], neighbours, distance_upper_bound=radius, workers=threads)
        own = np.arange(start, start + len(found))[:, None]
        index[part] = np.where(np.isfinite(distance), found, own)
        beside[part] = np.minimum(distance[:, min(_PITCH_NEIGHBOUR, neighbours - 1)], radius)
    return index, float(np.median(beside))


def principal_normals(
    points: np.ndarray, index: np.ndarray, alike: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The direction of least variance around every point.

    Args:
        points: (N, 3) m.
        index: (N, k) neighbours of each; the point's own index does not count twice.
        alike: (N, 3) normals; if given, only neighbours whose normals are within 60 deg of the point's own count:
            the other side of a thin wall and the other face of an edge do not. The result keeps their side.

    Returns:
        (N, 3) unit normals, of either sign without `alike`, and (N,) how many other points counted.
    """
    columns = np.ascontiguousarray(points.T)
    towards = None if alike is None else np.ascontiguousarray(alike.T)
    normals, counted = np.empty_like(points), np.empty(len(points), np.int64)
    for start in range(0, len(points), _CHUNK):
        near = index[start : start + _CHUNK]
        part = slice(start, start + len(near))
        own = np.arange(start, start + len(near))[:, None]
        counts = near != own
        if towards is not None:
            counts &= sum(axis[near] * axis[part, None] for axis in towards) > _ALIKE
        offset = [np.where(counts, axis[near] - axis[part, None], 0.0) for axis in columns]
        counted[part] = counts.sum(axis=1)
        size = counted[part] + 1
        mean = np.stack([x.sum(axis=1) for x in offset]) / size
        second = np.stack([np.einsum("nk,nk->n", offset[i], offset[j]) for i, j in zip(_ROW, _COLUMN, strict=True)])
        normals[part] = smallest_eigenvectors(second / size - mean[_ROW] * mean[_COLUMN])
    if alike is not None:
        normals *= np.where((normals * alike).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return normals, counted


def facing(
    points: np.ndarray, normals: np.ndarray, viewpoints: np.ndarray, pitch: float
) -> tuple[np.ndarray, np.ndarray]:
    """Normals turned to the viewpoint that sees each point best.

    The cloud is drawn into an image around each viewpoint, in cells of a few points. How far the nearest point of its
    cell lies before a point's tangent plane says how hidden the point is from there: 0 on the surface in front, the
    thickness of the wall on the surface behind. The viewpoint with the least of it is taken, the one that looks more
    head-on where two are alike.

    Args:
        points: (N, 3) m.
        normals: (N, 3) unit, of either sign.
        viewpoints: (V, 3) m.
        pitch: distance of neighbouring points, m.

    Returns:
        normals: (N, 3).
        hidden: (N,) m that the surface in front lies before the point's own, from the best viewpoint.
    """
    best, least, hidden = normals.copy(), np.full(len(points), np.inf), np.zeros(len(points))
    for viewpoint in viewpoints:
        ray = viewpoint - points
        distance = np.linalg.norm(ray, axis=1)
        cosine = (normals * ray).sum(axis=1) / np.maximum(distance, 1e-12)
        flipped = normals * np.where(cosine < 0, -1.0, 1.0)[:, None]
        front = _front(-ray, distance, _CELL * pitch / np.median(distance))
        before = np.maximum((flipped * (points[front] - points)).sum(axis=1), 0.0)
        cost = before - _FACING * pitch * np.abs(cosine)
        better = cost < least
        best[better], least[better], hidden[better] = flipped[better], cost[better], before[better]
    return best, hidden


def _front(ray: np.ndarray, distance: np.ndarray, cell: float) -> np.ndarray:
    """(N,) index of the nearest point in each point's cell of an image on a cube around the viewpoint.

    Args:
        ray: (N, 3) from the viewpoint to the points.
        distance: (N,) lengths of the rays.
        cell: side, as the tangent of an angle.
    """
    axis = np.abs(ray).argmax(axis=1)
    along = np.maximum(np.abs(ray).max(axis=1), 1e-12)
    row = np.arange(len(ray))
    side = axis * 2 + (ray[row, axis] > 0)
    cells = int(np.ceil(2.0 / cell)) + 1
    u, v = (np.floor((ray[row, (axis + k) % 3] / along + 1.0) / cell).astype(np.int64) for k in (1, 2))
    _, home = np.unique((side * cells + u) * cells + v, return_inverse=True)
    order = np.lexsort((distance, home))
    first = order[np.unique(home[order], return_index=True)[1]]
    return first[home]


def _check_outside(cloud: Cloud) -> None:
    for viewpoint in np.zeros((0, 3)) if cloud.viewpoints is None else cloud.viewpoints:
        ray = cloud.points - viewpoint
        behind = float((ray @ ray.mean(axis=0) <= 0).mean())
        if behind > BEHIND:
            where = ", ".join(f"{x:.4g}" for x in viewpoint)
            raise InputError(
                f"{cloud.name}: expected the viewpoint outside of the points, got ({where}) m with {behind:.0%} of "
                "them beside or behind it; give viewpoints, crop_low and crop_high, or a cloud with normals"
            )


def _check_outwards(cloud: Cloud, pitch: float) -> None:
    """Given normals must mostly point to the viewpoints of what these see; without viewpoints, out of the whole."""
    assert cloud.normals is not None
    if cloud.viewpoints is not None:
        flipped, hidden = facing(cloud.points, cloud.normals, cloud.viewpoints, pitch)
        seen = hidden <= _HIDDEN * _CELL * pitch
        away = float(((flipped * cloud.normals).sum(axis=1) < 0)[seen].mean())
        if away > 0.5:
            raise InputError(
                f"{cloud.name}: expected normals towards the viewpoints, got {away:.0%} that point away; flip them, "
                "or give other viewpoints"
            )
        return
    if outwardness(cloud.points, cloud.normals) < INWARDS:
        raise InputError(
            f"{cloud.name}: expected normals out of the surface, got the outermost ones pointing inwards; flip them, "
            "or give viewpoints=[[x,y,z],...] if this is the inside of something"
        )


def outwardness(points: np.ndarray, normals: np.ndarray) -> float:
    """Mean of n . u over directions u spread evenly on the sphere, n the normal of the outermost point along u."""
    outermost, directions = extremes(points)
    return float((normals[outermost] * directions).sum(axis=1).mean())


def extremes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(200,) index of the outermost of the points (N, 3) along each of (200, 3) directions."""
    directions = sphere(_DIRECTIONS)
    return np.array([(points @ u).argmax() for u in directions]), directions


def sphere(count: int) -> np.ndarray:
    """(count, 3) unit vectors spread evenly (Fibonacci) on the sphere."""
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * i  # golden angle
    return np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)


def hidden_share(hidden: np.ndarray, pitch: float) -> float:
    """The share of points that others hide, by how far the surface in front lies before them (N,), m."""
    return float((hidden > _HIDDEN * _CELL * pitch).mean())


def on_lines(points: np.ndarray, index: np.ndarray) -> np.ndarray:
    """(N,) bool: the neighbours (N, k) of a point lie on a line with it, which has no normal.

    With eigenvalues a >> b >= c of their covariance, the sum of its principal minors over its squared trace is about
    b / a.
    """
    found = np.zeros(len(points), bool)
    for start in range(0, len(points), _CHUNK):
        near = points[index[start : start + _CHUNK]]
        offset = near - near.mean(axis=1, keepdims=True)
        second = np.einsum("nki,nkj->nij", offset, offset)
        trace = np.trace(second, axis1=1, axis2=2)
        minors = (trace**2 - np.einsum("nij,nji->n", second, second)) / 2
        found[start : start + _CHUNK] = minors <= _LINE * trace**2
    return found
