"""The rigid motion between two views of one thing, from features that have whole poses.

A feature has a 6D pose (paper, section 3.1.2), so a single match of two features, in views a and b, says where all of b
is in a: `T_a_b = T_a_feature @ inverse(T_b_feature)`. No triples of points need be drawn and tried:

1. each feature of either view is matched with the nearest of the other by their relations: one motion a match;
2. the motions that most others agree with are candidates, each the mean of those that agree;
3. those that lay most of b on a are refined by steps of point-to-plane ICP (Chen, Medioni 1991), and the best is taken.

What lays most of b on a is not always right: a mug whose handle is turned out of the way overlaps best. Where the
cameras' places are known, what one view shows where the other looked through speaks against a candidate.

The paper registers nothing: this is ours, and needs no prototypes, grasps or model.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.features.estimator import SPGF
from spgf_torch.features.interface import LocalFeatures
from spgf_torch.geometry.se3 import from_rotation, inverse, rotation_about, rotation_of, transform_points

__all__ = ["Registration", "Surface", "refine", "register"]

Describe = Callable[[Tensor, Tensor], LocalFeatures]

# Two motions agree when they put the middle of b within so many m, and turn it alike within so many degrees: a normal
# is off by 3 deg in the median (docs/design/features.md), a direction in the surface by more, and a texlet by 2.5 mm.
AGREE, AGREE_DEG = 0.015, 15.0
# Candidates that are laid on a, no two of which have a match in common, and how many of them are refined.
CANDIDATES, REFINED = 20, 5
# Normals further apart are no common surface.
ALIKE_DEG = 30.0
# Fewer texlets than a motion has unknowns say nothing of it.
FEWEST = 6
# As many texlets that overlap weigh one that the other view looked through: a right pose loses overlap to what is
# hidden, but next to nothing of it is looked through. Of 1, 3 and 10 the best on nine scanned meshes.
DENIED = 10.0
# ICP ends when a step turns and moves less than this, rad and m.
STILL = 1e-5
# Of the mean of squares along each unknown: what no texlet resists, such as the turning of a ball, stays as it is.
DAMPING = 1e-6


class Surface(Protocol):
    """N oriented points, evenly spaced, as `Texlets` are: positions (N, 3) m, unit normals (N, 3)."""

    @property
    def positions(self) -> Tensor: ...

    @property
    def normals(self) -> Tensor: ...


@dataclass(frozen=True)
class Registration:
    """Where view b is in view a.

    Attributes:
        T_a_b: (4, 4) float64, m: `p_a = T_a_b @ p_b`.
        overlap: share of b's texlets that it lays on a.
        denied: share of the texlets that it puts where the other view looked through; 0 without viewpoints.
        agreeing: how many matches agreed on it, before it was refined.
    """

    T_a_b: Tensor
    overlap: float
    denied: float
    agreeing: int


class _View:
    """One view's texlets, in float64, and, where its viewpoint is known, in which directions it saw them."""

    def __init__(self, surface: Surface, eye: Tensor | None) -> None:
        self.positions, self.normals = surface.positions.double(), surface.normals.double()
        self.tree = cKDTree(self.positions.numpy())
        self.eye = eye
        if eye is not None:
            self.depth = torch.linalg.vector_norm(self.positions - eye, dim=1)
            self.directions = cKDTree(((self.positions - eye) / self.depth[:, None]).numpy())

    def lies_on(self, points: Tensor, normals: Tensor, near: float) -> tuple[Tensor, Tensor]:
        """Whether oriented points (N, 3) lie on the surface (N,) bool, and the nearest texlet to each (N,)."""
        distance, nearest = (torch.from_numpy(found) for found in self.tree.query(points.numpy()))
        cosine = (normals * self.normals[nearest]).sum(1)
        return (distance < near) & (cosine > math.cos(math.radians(ALIKE_DEG))), nearest

    def looked_through(self, points: Tensor, near: float) -> Tensor:
        """Which points (N, 3) are before what the camera saw in their direction, or where it saw nothing: (N,) bool."""
        if self.eye is None:
            return torch.zeros(len(points), dtype=torch.bool)
        depth = torch.linalg.vector_norm(points - self.eye, dim=1).clamp_min(1e-9)  # a wild candidate may meet the eye
        directions = (points - self.eye) / depth[:, None]
        apart, nearest = (torch.from_numpy(found) for found in self.directions.query(directions.numpy()))
        beside, before = apart * depth > near, depth < self.depth[nearest] - near
        return torch.logical_or(beside, before)


@dataclass(frozen=True)
class _Sides:
    """Both views, and the distance (m) below which a texlet lies on a surface."""

    a: _View
    b: _View
    near: float

    def laid(self, T_a_b: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Texlets of b (N, 3) in a's frame, the nearest of a to each (N,), and which of them lie on it (N,) bool."""
        points = transform_points(T_a_b, self.b.positions)
        on, nearest = self.a.lies_on(points, self.b.normals @ rotation_of(T_a_b).mT, self.near)
        return points, nearest, on

    def overlap(self, T_a_b: Tensor) -> float:
        """Share of b's texlets that lie on a."""
        return float(self.laid(T_a_b)[2].double().mean())

    def denied(self, T_a_b: Tensor) -> float:
        """Share of both views' texlets that the other one looked through."""
        there = self.a.looked_through(transform_points(T_a_b, self.b.positions), self.near)
        back = self.b.looked_through(transform_points(inverse(T_a_b), self.a.positions), self.near)
        return float(torch.cat([there, back]).double().mean())

    def worth(self, T_a_b: Tensor) -> float:
        """What candidates are ranked by."""
        return self.overlap(T_a_b) - DENIED * self.denied(T_a_b)


def register(
    a: Surface,
    b: Surface,
    describe: Describe | None = None,
    viewpoints: tuple[Tensor, Tensor] | None = None,
    matches: int = 2,
    near: float = 0.0075,
    steps: int = 30,
) -> Registration:
    """Where view b is in view a, by matched feature poses.

    Views are texlets on the CPU that see a part of the same thing from different sides; each has a frame of its own.
    What looks the same from where it was seen, such as a bottle turned about its axis, has several right answers.

    Args:
        describe: positions and normals to features; SPGF as the paper has it. Others have frames too (`fpfh`).
        viewpoints: where the camera of a was in a's frame, and that of b in b's, (3,) m each. It is taken for granted
            that either saw through wherever it shows nothing.
        matches: features of the other view that each is matched with.
        near: m between a texlet of b and the nearest of a that count as one surface; half as much again as spacing.
        steps: of ICP at most; 0 leaves the mean of the matches that agreed.

    Raises:
        InputError: a view has no feature, or `matches`, `near`, `steps` are out of range.
    """
    if matches < 1 or near <= 0 or steps < 0:
        raise InputError(f"register: expected matches >= 1, near > 0, steps >= 0; got {matches}, {near}, {steps}")
    describe = SPGF() if describe is None else describe
    T = matched_motions(describe(a.positions, a.normals), describe(b.positions, b.normals), matches)
    candidates, agreeing = agreed(T, b.positions.double().mean(0))
    eye_a, eye_b = (None, None) if viewpoints is None else (eye.double() for eye in viewpoints)
    sides = _Sides(_View(a, eye_a), _View(b, eye_b), near)
    first = sorted(range(len(candidates)), key=lambda i: -sides.worth(candidates[i]))[:REFINED]
    refined = {i: _refined(sides, candidates[i], steps) for i in first}
    best = max(first, key=lambda i: sides.worth(refined[i]))
    T_a_b = refined[best]
    return Registration(T_a_b, sides.overlap(T_a_b), sides.denied(T_a_b), int(agreeing[best]))


def matched_motions(a: LocalFeatures, b: LocalFeatures, matches: int) -> Tensor:
    """T_a_b (M, 4, 4) float64 of each match: either view's features with the `matches` nearest of the other view.

    Raises InputError where a view has no valid feature.
    """
    for name, features in (("a", a), ("b", b)):
        if not features.valid.any():
            raise InputError(f"register: expected features in both views, got none in {name}")
    apart = torch.cdist(a.relations()[a.valid], b.relations()[b.valid])
    chosen = torch.zeros(apart.shape, dtype=torch.bool)
    for dim in (0, 1):
        nearest = apart.topk(min(matches, apart.shape[dim]), dim=dim, largest=False).indices
        chosen.scatter_(dim, nearest, True)
    of_a, of_b = chosen.nonzero(as_tuple=True)
    return a.T_object_feature[a.valid][of_a].double() @ inverse(b.T_object_feature[b.valid][of_b].double())


def agreed(T_a_b: Tensor, middle: Tensor) -> tuple[Tensor, Tensor]:
    """The motions that most of (M, 4, 4) agree with: (C, 4, 4), C <= `CANDIDATES`, and how many do (C,) int64.

    middle: (3,) m, the point of b at which they are compared. The most agreed comes first; each is the mean of those
    that agree, and they take no part in the next.
    """
    at, turns = transform_points(T_a_b, middle[None])[:, 0], rotation_of(T_a_b)
    place, row = (at - at.mean(0)).float(), turns.flatten(1).float()
    close = torch.cdist(place, place) < AGREE
    close &= row @ row.T > 1 + 2 * math.cos(math.radians(AGREE_DEG))  # the trace of R_i^T R_j
    agreeing = close.sum(1)
    found: list[Tensor] = []
    counts: list[int] = []
    while len(found) < CANDIDATES and bool((agreeing > 0).any()):
        first = int(agreeing.argmax())
        counts.append(int(agreeing[first]))
        R = _mean_rotation(turns[close[first]])
        found.append(from_rotation(R, at[close[first]].mean(0) - R @ middle))
        agreeing[close[first]] = 0
    return torch.stack(found), torch.tensor(counts)


def refine(a: Surface, b: Surface, T_a_b: Tensor, near: float = 0.0075, steps: int = 30) -> Tensor:
    """A motion (4, 4) that is nearly right, refined as in `register`: (4, 4) float64."""
    return _refined(_Sides(_View(a, None), _View(b, None), near), T_a_b.double(), steps)


def _refined(sides: _Sides, T_a_b: Tensor, steps: int) -> Tensor:
    """Steps of point-to-plane ICP: what lies on a is moved along a's normals by least squares, until it stays."""
    for _ in range(steps):
        points, nearest, on = sides.laid(T_a_b)
        if int(on.sum()) < FEWEST:
            break
        p, q, n = points[on], sides.a.positions[nearest[on]], sides.a.normals[nearest[on]]
        middle = p.mean(0)
        rows = torch.cat([torch.linalg.cross(p - middle, n), n], dim=1)
        squares = rows.T @ rows
        damping = DAMPING * torch.block_diag(*(torch.eye(3) * part.diagonal().sum() for part in _blocks(squares)))
        step = torch.linalg.solve(squares + damping, rows.T @ ((q - p) * n).sum(1))
        R = rotation_about(step[:3])
        T_a_b = from_rotation(R, middle - R @ middle + step[3:]) @ T_a_b
        if bool(step.abs().max() < STILL):
            break
    return T_a_b


def _blocks(squares: Tensor) -> tuple[Tensor, Tensor]:
    """Of (6, 6) the part of the turning and that of the moving, which have different units."""
    return squares[:3, :3], squares[3:, 3:]


def _mean_rotation(turns: Tensor) -> Tensor:
    """The rotation (3, 3) nearest to the mean of (M, 3, 3), by its singular vectors."""
    U, _, Vh = torch.linalg.svd(turns.mean(0))
    U[:, 2] *= torch.linalg.det(U @ Vh)
    rotation: Tensor = U @ Vh
    return rotation
