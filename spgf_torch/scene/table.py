"""The plane that objects stand on: found among points or given, oriented, and what lies above it."""

from __future__ import annotations

import numpy as np

from spgf_torch.config import InputError, SceneConfig
from spgf_torch.scene.cloud import vectors

# Points that hypotheses are tried on: a share of a fifth is measured to within 1 %.
_TRIED = 4000
_ROUNDS = 4


def given_plane(values: object) -> np.ndarray:
    """(4,) a, b, c, d with (a, b, c) of length 1 of a plane given by the user; InputError if it is none."""
    plane = vectors("table", values, (4,))
    length = float(np.linalg.norm(plane[:3]))
    if length == 0:
        raise InputError(f"table: expected a normal (a, b, c) other than 0, got {values!r}")
    return plane / length


def find_plane(
    points: np.ndarray, out: np.ndarray | None, config: SceneConfig, generator: np.random.Generator
) -> np.ndarray:
    """The plane that holds most points, by random hypotheses (RANSAC) and least squares through what they explain.

    Args:
        points: (N, 3) m.
        out: (3,) a place on the side of the plane where the objects are, such as a camera; None: the side on which
            more points lie.
        config: table_distance, table_share, table_width, table_hypotheses.
        generator: draws the hypotheses.

    Returns:
        (4,) a, b, c, d: a x + b y + c z + d is the distance above the plane, m.

    Raises:
        InputError: no plane holds `table_share` of the points, or the best is narrower than `table_width`.
    """
    if len(points) < 3:
        raise InputError(f"table: expected a plane among the points, got {len(points)} points")
    some = points[generator.choice(len(points), min(_TRIED, len(points)), replace=False)]
    corners = some[generator.integers(len(some), size=(config.table_hypotheses, 3))]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal, corner = normal[length > 0] / length[length > 0, None], corners[length > 0, 0]
    if not len(normal):
        raise InputError("table: expected a plane among the points, got points on one line")
    held = [int((np.abs((some - c) @ n) <= config.table_distance).sum()) for n, c in zip(normal, corner, strict=True)]
    best = int(np.argmax(held))
    plane = np.append(normal[best], -normal[best] @ corner[best])
    for _ in range(_ROUNDS):
        on = np.abs(height(points, plane)) <= config.table_distance
        middle = points[on].mean(axis=0)
        values, directions = np.linalg.eigh(np.cov((points[on] - middle).T))
        plane = np.append(directions[:, 0], -directions[:, 0] @ middle)
    # An even strip of width w has the variance w^2 / 12.
    width, share = float(np.sqrt(12 * max(values[1], 0.0))), float(on.mean())
    if share < config.table_share or width < config.table_width:
        raise InputError(
            f"table: expected a plane with {config.table_share:.0%} of the points and {config.table_width:g} m wide, "
            f"got at best {share:.0%} and {width:.2g} m; give table=[a,b,c,d], or null if there is none"
        )
    side = (
        height(out[None], plane)[0] if out is not None else np.median(height(points[~on], plane)) if (~on).any() else 1
    )
    return plane if side >= 0 else -plane


def height(points: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """(N,) m of points (N, 3) above a plane (4,)."""
    return points @ plane[:3] + plane[3]
