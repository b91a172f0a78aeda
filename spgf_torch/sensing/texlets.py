"""Texlets: small oriented surface patches, evenly spaced, from one or more depth images (paper, Eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from spgf_torch.errors import InputError
from spgf_torch.sensing.cameras import Camera
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.planes import surface_points

__all__ = ["Texlets", "extract", "thin"]


@dataclass(frozen=True)
class Texlets:
    """N surface patches tau = {X, n} (Eq. 1).

    Attributes:
        positions: (N, 3) float32, m, object frame.
        normals: (N, 3) float32, unit, object frame, towards the cameras that saw them.
    """

    positions: torch.Tensor
    normals: torch.Tensor

    def __len__(self) -> int:
        return len(self.positions)


def extract(
    views: Sequence[tuple[np.ndarray, Camera]], config: SensingConfig, generator: np.random.Generator
) -> Texlets:
    """Texlets of what several depth images show together, in the frame that their cameras' poses refer to.

    Args:
        views: depth image (H, W) in m (0, negative or not finite = no return) and its camera, simulated or real.
        config: window, depth_gate, min_window, grazing_deg, spacing, rival_deg, min_members.
        generator: draws the order in which patches claim their place.

    Raises:
        InputError: a depth image and its camera differ in size.
    """
    points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for depth, camera in views:
        if depth.shape != (camera.height, camera.width):
            raise InputError(f"depth image: expected {camera.height} x {camera.width} pixels, got {depth.shape}")
        point, normal = surface_points(depth, camera.rays(), config)
        rotation, translation = camera.T_object_camera[:3, :3], camera.T_object_camera[:3, 3]
        points.append(point @ rotation.T + translation)
        normals.append(normal @ rotation.T)
    return thin(np.concatenate(points), np.concatenate(normals), config, generator)


def thin(points: np.ndarray, normals: np.ndarray, config: SensingConfig, generator: np.random.Generator) -> Texlets:
    """Evenly spaced texlets from dense oriented points.

    Two points are rivals when they are within `config.spacing` and their normals within `config.rival_deg`: the two
    sides of a thin wall are not. In random order each point that no earlier rival has beaten becomes a centre; every
    other point joins its nearest rival centre; a texlet is the mean of a centre and its members. Centres with fewer
    than `config.min_members` points (itself included) are dropped.

    Args:
        points, normals: (M, 3), m and unit; any frame, which the result keeps.
        config: spacing, rival_deg, min_members.
        generator: draws the order.
    """
    order = generator.permutation(len(points))
    points, normals = points[order], normals[order]
    pairs = cKDTree(points).query_pairs(config.spacing, output_type="ndarray")
    alike = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > np.cos(np.deg2rad(config.rival_deg))
    pairs = pairs[alike]
    chosen = independent_set(pairs, len(points))
    home = _nearest_centre(points, pairs, chosen)
    members = np.bincount(home, minlength=len(points))
    kept = chosen & (members >= config.min_members)
    position = _sums(points, home)[kept] / members[kept, None]
    normal = _sums(normals, home)[kept]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Texlets(torch.from_numpy(position).float(), torch.from_numpy(normal).float())


def independent_set(pairs: np.ndarray, count: int) -> np.ndarray:
    """(count,) bool: the points that stay when, in order of index, each point beats its later rivals.

    Equal to the sequential rule, in a few rounds over all pairs: a point whose earlier rivals are all beaten stays.

    Args:
        pairs: (P, 2) rivals, lower index first.
        count: number of points.
    """
    chosen, open_ = np.zeros(count, bool), np.ones(count, bool)
    while len(pairs):
        stays = open_.copy()
        stays[pairs[:, 1]] = False
        chosen |= stays
        open_ &= ~stays
        open_[pairs[stays[pairs[:, 0]], 1]] = False
        pairs = pairs[open_[pairs].all(axis=1)]
    return chosen | open_


def _nearest_centre(points: np.ndarray, pairs: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(M,) index of the nearest chosen rival of every point; a chosen point's own."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    member, centre = both[chosen[both[:, 1]]].T
    distance = ((points[member] - points[centre]) ** 2).sum(axis=1)
    far_to_near = np.argsort(-distance, kind="stable")
    home = np.arange(len(points))
    home[member[far_to_near]] = centre[far_to_near]
    return home


def _sums(values: np.ndarray, home: np.ndarray) -> np.ndarray:
    """(M, 3) sums of the rows of `values` that share a home."""
    columns = [np.bincount(home, weights=column, minlength=len(home)) for column in values.T]
    return np.stack(columns, axis=1).astype(np.float64)  # bincount of nothing is int64
