"""Convex collision pieces of a scanned mesh, and the check that they keep its cavities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from spgf_torch.errors import InputError
from spgf_torch.geometry.convex_pieces import convex_hull, convex_pieces, in_box, lies_below, surface_tree
from spgf_torch.objects.config import CollisionConfig


@dataclass(frozen=True)
class PieceCheck:
    """How well convex pieces approximate a mesh.

    Attributes:
        faces: of the mesh.
        pieces: number of convex pieces.
        volume_ratio: volume that the pieces bound (their union, and what lies deeper inside the mesh than pieces
            reach: no finger gets there) over the volume of the mesh.
        free_space_kept: share of the cavities' space that no piece fills; 1 for an object without a cavity.
    """

    faces: int
    pieces: int
    volume_ratio: float
    free_space_kept: float


def collision_pieces(
    mesh: trimesh.Trimesh, config: CollisionConfig, label: str
) -> tuple[tuple[np.ndarray, ...], PieceCheck]:
    """Convex pieces of `mesh` that passed the check, and the check.

    The tolerance is halved until they pass, `attempts` times in all.

    Args:
        mesh: watertight, normals outwards, m.
        label: what an error calls the mesh (its file).

    Returns:
        the pieces, each the (V, 3) float64 corners of its hull in the frame of `mesh`, V <= MAX_HULL_VERTICES;
        the check.

    Raises InputError when the last attempt fails too.
    """
    for attempt in range(config.attempts):
        finer = replace(config, tolerance=config.tolerance / 2**attempt)
        pieces = convex_pieces(mesh, finer)
        check = check_pieces(mesh, pieces, finer)
        if _passes(check, config):
            return pieces, check
    raise InputError(
        f"{label}: expected collision pieces within {config.volume_tolerance:.0%} of the mesh's volume that keep "
        f"{config.free_space_kept:.0%} of its cavities free, got volume x{check.volume_ratio:.2f} and "
        f"{check.free_space_kept:.1%} free at a tolerance of {finer.tolerance * 1e3:.2g} mm"
    )


def _passes(check: PieceCheck, config: CollisionConfig) -> bool:
    volume_kept = abs(check.volume_ratio - 1.0) <= config.volume_tolerance
    return volume_kept and check.free_space_kept >= config.free_space_kept


def check_pieces(
    mesh: trimesh.Trimesh, pieces: tuple[np.ndarray, ...], config: CollisionConfig, seed: int = 0
) -> PieceCheck:
    """Compare `pieces` with `mesh` at random points of the space around it.

    `config.samples` points: on a 16 cm bowl with a 1 mm wall 200,000 points give the volume to 2 %.
    """
    points = _points_around(mesh, config, seed)
    in_mesh = _inside(mesh, points)
    in_piece = np.zeros(len(points), dtype=bool)
    for piece in pieces:
        _mark(in_piece, points, piece)
    unreached = points[in_mesh & ~in_piece]
    to_surface, _ = surface_tree(mesh).query(unreached, distance_upper_bound=config.thickness)
    bounded = in_piece.sum() + np.isinf(to_surface).sum()
    # A cavity is large beside a wall: a fourth of the points tells its share to half a per cent.
    cavity = _cavity(mesh, points, np.flatnonzero(~in_mesh)[::4], config.cavity_depth)
    return PieceCheck(
        faces=len(mesh.faces),
        pieces=len(pieces),
        volume_ratio=float(bounded / max(1, in_mesh.sum())),
        free_space_kept=float(1.0 - in_piece[cavity].mean()) if len(cavity) else 1.0,
    )


def _points_around(mesh: trimesh.Trimesh, config: CollisionConfig, seed: int) -> np.ndarray:
    """(N, 3) points in the mesh's box and a margin that pieces may reach into, in the order of x."""
    low, high = mesh.bounds
    margin = 2 * config.tolerance
    points = np.random.default_rng(seed).uniform(low - margin, high + margin, (config.samples, 3))
    return points[np.argsort(points[:, 0])]


def _inside(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """(N,) bool: the first face that a ray meets is seen from behind. The direction is askew to usual axes."""
    direction = np.array([0.31, 0.22, 0.92])
    face, ray = mesh.ray.intersects_id(points, np.tile(direction, (len(points), 1)), multiple_hits=False)
    inside = np.zeros(len(points), dtype=bool)
    inside[ray] = mesh.face_normals[face] @ direction > 0
    return inside


def _mark(mask: np.ndarray, points: np.ndarray, corners: np.ndarray) -> None:
    """Set `mask` where `points`, in the order of x, lie in the hull of `corners`."""
    chosen = in_box(points, corners)
    equations = convex_hull(corners).equations
    mask[chosen[lies_below(equations, points[chosen])]] = True


def _cavity(mesh: trimesh.Trimesh, points: np.ndarray, outside: np.ndarray, depth: float) -> np.ndarray:
    """Those of the indices `outside` whose points lie in a cavity.

    These are the points outside the mesh that lie at least `depth` below its convex hull, and those in the hull
    within `depth` of them. The sliver between a bulging box and its hull is no cavity: nothing can reach into it.
    """
    equations = convex_hull(np.asarray(mesh.vertices), depth / 5).equations
    blocks = np.array_split(points[outside], 1 + len(outside) * len(equations) // 10_000_000)
    below = -np.concatenate([(block @ equations[:, :3].T + equations[:, 3]).max(axis=1) for block in blocks])
    inside, below = outside[below > 0], below[below > 0]
    core = points[inside[below > depth]]
    if not len(core):
        return core.astype(int)
    to_core, _ = cKDTree(core).query(points[inside], distance_upper_bound=depth)
    return inside[np.isfinite(to_core)]
