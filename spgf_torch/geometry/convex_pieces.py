"""Convex pieces of a mesh that keep its cavities.

The surface is cut into patches of neighbouring faces. A patch becomes one convex piece, the hull of its faces
and of their centres moved into the material, as long as that hull bulges less than a tolerance out of the
mesh; otherwise it is halved. Neighbouring patches are then joined while their common hull still does not bulge.
So a ball is a few pieces, a flat box side is one, and a bowl's wall is a mosaic of plates that carry the inner
and the outer surface together. No simplified mesh stands between the mesh and its pieces: quadric decimation
to 600 faces left the 0.9 mm wall of a scanned bowl open and 15 % short of volume.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError, cKDTree

# PhysX keeps at most 255 polygons a convex shape and cuts larger hulls by 1 mm and more (measured on a scanned
# ball); a triangulated hull of 120 vertices has 236.
MAX_HULL_VERTICES = 120
# m; a triangle lower than this is a line to Qhull and PhysX, and its neighbours cover it.
MIN_TRIANGLE_HEIGHT = 1e-6
# m; the least that a face is extruded, so that no piece is flat.
MIN_EXTRUSION = 2e-4
# m; rays start this far off the face they leave, above single-precision noise at 1 m.
RAY_START = 1e-5
# Surface points that represent the surface where a distance to it is needed: 1.2 mm apart on a 16 cm bowl.
SURFACE_POINTS = 50_000
# Faces; a patch from this size on is first tried with a tenth of them.
LARGE_PATCH = 1000
# Directions over the sphere in which it is looked whether anything is in front of a face.
DIRECTIONS = 64
# From one tolerance that is tried to the next.
FINER = 1.5
# Cosine between a face's normal and a direction from where on the face is seen from there.
GRAZING = 0.05


class Cutting(Protocol):
    """How a mesh is cut, all in m.

    Attributes:
        tolerance: how far a piece may bulge out of the mesh, or the mesh out of it.
        inset: how far the surface is set back.
        thickness: how far faces are extruded into thick material.
        max_edge: longer edges are divided first.
    """

    tolerance: float
    inset: float
    thickness: float
    max_edge: float


@dataclass
class FewPieces:
    """How a mesh is cut into few pieces.

    Attributes:
        tolerance, inset, thickness, max_edge: as of `Cutting`; the tolerance is the least that is tried.
        coarsest: m, the largest tolerance.
        slack: m, what the mesh may stand out of its pieces, whatever the tolerance.
        openness: pieces may fill the space before faces that see less than this share of it (screw holes, hollow
            backs), and faces that see nothing are left out.
        most: number of pieces.
    """

    tolerance: float
    inset: float
    thickness: float
    max_edge: float
    coarsest: float
    slack: float
    openness: float
    most: int


@dataclass(frozen=True)
class _Piece:
    """`points`: (P, 3) every corner of the faces' exact hull; `corners`: (V, 3) those that the piece keeps;
    `low`, `high`: (3,) its box."""

    points: np.ndarray
    corners: np.ndarray
    low: np.ndarray
    high: np.ndarray


class _Surface:
    """A mesh as faces to be covered and points to be kept free.

    Attributes:
        corners: (F, 3, 3) triangles, no edge longer than `max_edge`, set back into the material by `inset`: on the
            hollow side of a curved wall a plate stands out by half its bulge on average, 20 % of a 1 mm wall.
        centre: (F, 3) face centres, on the mesh.
        inner: (F, 3) face centres moved inwards by `thickness`, or through the wall where that is thinner.
        free: (Q, 3) face centres moved outwards by `tolerance`, in the order of x; without those that
            another part of the surface comes close to, and those of faces less open than `openness`.
    """

    def __init__(self, mesh: trimesh.Trimesh, config: Cutting, openness: float = 0.0, slack: float = np.inf) -> None:
        corners = _without_slivers(_bisected(np.asarray(mesh.triangles, dtype=np.float64), config.max_edge))
        normal = trimesh.triangles.normals(corners)[0]  # type: ignore[no-untyped-call]
        open_ = np.ones(len(corners), dtype=bool)
        if openness:
            share = open_share(mesh, corners.mean(axis=1), normal)
            seen = share > 0.0
            corners, normal, open_ = corners[seen], normal[seen], share[seen] >= openness
        self.centre = centre = corners.mean(axis=1)
        depth = np.clip(_ray_lengths(mesh, centre, -normal), MIN_EXTRUSION, config.thickness)
        self.inner = centre - normal * depth[:, None]
        self.corners = corners - (normal * np.minimum(config.inset, depth / 4)[:, None])[:, None]
        self._normal, self._open, self._slack, self._tree = normal, open_, slack, surface_tree(mesh)
        self._ahead = _ray_lengths(mesh, centre, normal)
        self.keep_free(config.tolerance)

    def keep_free(self, tolerance: float) -> None:
        self.tolerance = tolerance
        free = self.centre + self._normal * tolerance
        near, _ = self._tree.query(free, distance_upper_bound=tolerance * 0.95)
        free = free[np.isinf(near) & (self._ahead > 2 * tolerance) & self._open]
        self.free = free[np.argsort(free[:, 0])]

    def piece(self, points: np.ndarray) -> _Piece | None:
        """The convex piece around `points`, or None where it would fill free space or have too many corners."""
        hull = convex_hull(points, min(self.tolerance, self._slack))
        corners = points[hull.vertices]
        if len(corners) > MAX_HULL_VERTICES or _holds_any(hull.equations, corners, self.free):
            return None
        return _Piece(points[convex_hull(points).vertices], corners, corners.min(axis=0), corners.max(axis=0))

    def piece_of(self, patch: np.ndarray) -> _Piece | None:
        """The piece that covers `patch`, face indices; what a few of its faces forbid need not be tried in full."""
        if len(patch) >= LARGE_PATCH and self.piece(self._points(patch[::10])) is None:
            return None
        return self.piece(self._points(patch))

    def _points(self, patch: np.ndarray) -> np.ndarray:
        return np.concatenate([self.corners[patch].reshape(-1, 3), self.inner[patch]])


def convex_pieces(mesh: trimesh.Trimesh, config: Cutting) -> tuple[np.ndarray, ...]:
    """(V, 3) float64 corners of each convex piece; deterministic.

    Every point of the mesh's surface lies within `tolerance` of a piece (and twice the inset at edges), and no piece
    reaches much farther than `tolerance` out of the mesh: as far as a point that is to be kept free can be missed.
    """
    surface = _Surface(mesh, config)
    return tuple(piece.corners for piece in _joined(surface, _halved(surface)))


def few_convex_pieces(mesh: trimesh.Trimesh, config: FewPieces) -> tuple[np.ndarray, ...]:
    """The same with the least tolerance at which there are few pieces; where even the coarsest makes more, those.

    The mesh need not be closed, but its faces have an outer side.
    """
    surface = _Surface(mesh, config, config.openness, config.slack)
    least, last = 0, int(np.log(config.coarsest / config.tolerance) / np.log(FINER))
    found: list[_Piece] = []
    while least <= last:
        step = (least + last) // 2
        surface.keep_free(config.tolerance * FINER**step)
        pieces = _joined(surface, _halved(surface))
        if len(pieces) <= config.most:
            found, last = pieces, step - 1
        else:
            least = step + 1
    return tuple(piece.corners for piece in found or pieces)


def _halved(surface: _Surface) -> list[_Piece]:
    """Patches cut across their longest direction until each has an admissible piece."""
    pieces, waiting = [], [np.arange(len(surface.corners))]
    while waiting:
        patch = waiting.pop()
        piece = surface.piece_of(patch)
        if piece is not None:
            pieces.append(piece)
        elif len(patch) > 1:
            waiting += _halves(patch, surface.centre[patch])
    return pieces


def _halves(patch: np.ndarray, centre: np.ndarray) -> list[np.ndarray]:
    spread = centre - centre.mean(axis=0)
    along = spread @ np.linalg.eigh(spread.T @ spread)[1][:, -1]
    order = np.argsort(along, kind="stable")
    return [patch[order[: len(order) // 2]], patch[order[len(order) // 2 :]]]


def _joined(surface: _Surface, pieces: list[_Piece]) -> list[_Piece]:
    """Touching pieces joined, smallest first, while the common hull is admissible.

    A pair that was refused stays refused in whatever its members grow into: their hull only gets larger.
    """
    alive = dict(enumerate(pieces))
    touching = _touching(pieces)
    refused: dict[int, set[int]] = {a: set() for a in alive}
    queue = [(_extent(alive[a], alive[b]), a, b) for a in touching for b in touching[a] if a < b]
    heapq.heapify(queue)
    while queue:
        _, a, b = heapq.heappop(queue)
        if a not in alive or b not in alive:
            continue
        joined = surface.piece(np.concatenate([alive[a].points, alive[b].points]))
        if joined is None:
            refused[a].add(b)
            refused[b].add(a)
            continue
        new = len(touching)
        del alive[a], alive[b]
        refused[new] = (refused[a] | refused[b]) & alive.keys()
        touching[new] = ((touching[a] | touching[b]) & alive.keys()) - refused[new]
        alive[new] = joined
        for c in refused[new]:
            refused[c].add(new)
        for c in touching[new]:
            touching[c].add(new)
            heapq.heappush(queue, (_extent(alive[c], joined), c, new))
    return list(alive.values())


def _touching(pieces: list[_Piece]) -> dict[int, set[int]]:
    """For each piece the others whose boxes it meets."""
    low, high = np.array([piece.low for piece in pieces]), np.array([piece.high for piece in pieces])
    meets = np.ones((len(pieces), len(pieces)), dtype=bool)
    for axis in range(3):
        meets &= low[:, None, axis] <= high[None, :, axis]
    meets &= meets.T
    return {a: set(np.flatnonzero(row).tolist()) - {a} for a, row in enumerate(meets)}


def _extent(a: _Piece, b: _Piece) -> float:
    """Squared diagonal of the box around two pieces: small first keeps patches compact."""
    diagonal = np.maximum(a.high, b.high) - np.minimum(a.low, b.low)
    return float(diagonal @ diagonal)


def _holds_any(equations: np.ndarray, corners: np.ndarray, points: np.ndarray) -> bool:
    return bool(lies_below(equations, points[in_box(points, corners)]).any())


def lies_below(equations: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray((points @ equations[:, :3].T < -equations[:, 3]).all(axis=1))


def in_box(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Indices of `points`, in the order of x, in the box of `corners`."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    first, last = np.searchsorted(points[:, 0], [low[0], high[0]])
    y, z = points[first:last, 1], points[first:last, 2]
    return np.asarray(first) + np.flatnonzero((y > low[1]) & (y < high[1]) & (z > low[2]) & (z < high[2]))


def convex_hull(points: np.ndarray, slack: float = 0.0) -> ConvexHull:
    """Convex hull without the corners that stand out by less than `slack` (Qhull's option W)."""
    if slack:
        try:
            return ConvexHull(points, qhull_options=f"Qt W{slack:.9g}")
        except QhullError:  # flatter than the slack: take every corner
            pass
    return ConvexHull(points)


def _ray_lengths(mesh: trimesh.Trimesh, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) distance to the mesh along unit `directions`, from surface points off to that side; inf without a hit."""
    _, ray, place = mesh.ray.intersects_id(
        origins + directions * RAY_START, directions, multiple_hits=False, return_locations=True
    )
    lengths = np.full(len(origins), np.inf)
    lengths[ray] = np.linalg.norm(place - origins[ray], axis=1)
    return lengths


def open_share(mesh: trimesh.Trimesh, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(N,) share of the space before surface points that they see: cosine-weighted, 1 of a convex body, 0 inside.

    The directions are those of a Fibonacci lattice.
    """
    index = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * index / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * index
    directions = np.column_stack([np.cos(turn) * np.sqrt(1.0 - z * z), np.sin(turn) * np.sqrt(1.0 - z * z), z])
    free, all_ = np.zeros(len(points)), np.zeros(len(points))
    for direction in directions:
        cosine = normals @ direction
        front = np.flatnonzero(cosine > GRAZING)
        starts = points[front] + normals[front] * RAY_START
        hit = mesh.ray.intersects_any(starts, np.tile(direction, (len(front), 1)))  # type: ignore[no-untyped-call]
        free[front] += cosine[front] * ~hit
        all_[front] += cosine[front]
    return free / all_


def surface_tree(mesh: trimesh.Trimesh) -> cKDTree:
    return cKDTree(trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)[0])


def _bisected(corners: np.ndarray, max_edge: float) -> np.ndarray:
    """(F', 3, 3) triangles cut across their longest edge until none is longer than `max_edge`.

    `trimesh.remesh.subdivide_to_size` cuts all three edges: a long thin triangle becomes thousands of thinner ones.
    """
    done = []
    while len(corners):
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        long = edges.max(axis=1) > max_edge
        done.append(corners[~long])
        order = (edges[long].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[long], order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def _without_slivers(corners: np.ndarray) -> np.ndarray:
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    area = trimesh.triangles.area(corners)  # type: ignore[no-untyped-call]
    return np.asarray(corners[2 * area > longest * MIN_TRIANGLE_HEIGHT])
