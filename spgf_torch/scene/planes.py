"""Planes: given by the user, and found among points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.scene.cloud import Cloud, vectors
from spgf_torch.scene.config import SceneConfig

# Points that hypotheses are tried on.
_TRIED = 1500
# Rounds of least squares, each with what lies nearer than this much of table_distance.
_NEARER = (1.0, 0.75, 0.5, 0.5)


@dataclass(frozen=True)
class FoundPlane:
    """A plane among points.

    Attributes:
        plane: (4,) a, b, c, d: a x + b y + c z + d is the distance above it, m.
        on: (N,) bool, the points that it holds.
        width: m, of the narrow side of what it holds.
    """

    plane: np.ndarray
    on: np.ndarray
    width: float

    @property
    def share(self) -> float:
        """Of all points, those on the plane."""
        return float(self.on.mean())


@dataclass(frozen=True)
class LargestPlane:
    """The plane that holds most of the points (N, 3), m, with hypotheses that are always the same; found when asked."""

    points: np.ndarray
    config: SceneConfig

    @staticmethod
    def of(clouds: Sequence[Cloud], config: SceneConfig) -> LargestPlane:
        """That of clouds together."""
        return LargestPlane(np.concatenate([cloud.points for cloud in clouds]), config)

    @cached_property
    def found(self) -> FoundPlane | None:
        """As of `best_plane`."""
        return best_plane(self.points, self.config, np.random.default_rng(0))


def given_plane(values: object) -> np.ndarray:
    """(4,) a, b, c, d with (a, b, c) of length 1 of a plane given by the user; InputError if it is none."""
    plane = vectors("table", values, (4,))
    length = float(np.linalg.norm(plane[:3]))
    if length == 0:
        raise InputError(f"table: expected a normal (a, b, c) other than 0, got {values!r}")
    return plane / length


def height(points: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """(N,) m of points (N, 3) above a plane (4,)."""
    return points @ plane[:3] + plane[3]


def best_plane(
    points: np.ndarray, config: SceneConfig, generator: np.random.Generator, free: np.ndarray | None = None
) -> FoundPlane | None:
    """The plane that holds most points, by random hypotheses (RANSAC) and least squares through what they explain.

    A point counts the less the further it is off (Torr and Zisserman 2000, MSAC): a plane between a table and a book on
    it holds both, but neither well.

    Args:
        points: (N, 3) m.
        config: table_distance, table_hypotheses.
        generator: draws the hypotheses.
        free: (N,) bool, the points that count; None: all.

    Returns:
        The plane, of either sign; None where fewer than three points count, or all lie on one line.
    """
    counted = points if free is None else points[free]
    if len(counted) < 3:
        return None
    some = counted[generator.choice(len(counted), min(_TRIED, len(counted)), replace=False)]
    corners = some[generator.integers(len(some), size=(config.table_hypotheses, 3))]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal, corner = normal[length > 0] / length[length > 0, None], corners[length > 0, 0]
    if not len(normal):
        return None
    middle = some.mean(axis=0)
    weight = (some - middle) @ normal.T - ((corner - middle) * normal).sum(axis=1)
    weight /= config.table_distance  # in place: there are a million of them
    np.square(weight, out=weight)
    np.subtract(1, weight, out=weight)
    best = int(np.argmax(np.maximum(0.0, weight, out=weight).sum(axis=0)))
    plane = np.append(normal[best], -normal[best] @ corner[best])
    values = np.zeros(3)
    for nearer in _NEARER:
        on = counted[np.abs(height(counted, plane)) <= nearer * config.table_distance]
        if len(on) < 3:
            break
        middle = on.mean(axis=0)
        values, directions = np.linalg.eigh(np.cov((on - middle).T))
        plane = np.append(directions[:, 0], -directions[:, 0] @ middle)
    near = np.abs(height(points, plane)) <= config.table_distance
    # An even strip of width w has the variance w^2 / 12.
    return FoundPlane(plane, near if free is None else near & free, float(np.sqrt(12 * max(values[1], 0.0))))
