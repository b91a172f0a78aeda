"""The plane that objects stand on: found among points or given, oriented, and what lies above it.

Not the largest plane: the top of a big box, a wall and a shelf above are larger at times. A table is nearly level,
where it is known what is up; has next to nothing directly below it, as the top of a box has its sides; and carries the
target, where a target is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spgf_torch.config import InputError, SceneConfig
from spgf_torch.scene.cloud import vectors

# Points that hypotheses are tried on: a share of a fifth is measured to within 1 %.
_TRIED = 4000
_ROUNDS = 4
# Planes that are looked at, each in what the ones before leave over.
_MOST = 6
# Cosine of the tilt from "up" beyond which a plane is a wall; "up" may itself be off by 30 deg.
_LEVEL = np.cos(np.deg2rad(60))
# m; side of the cells of a plane that tell what lies below it. A box's sides end within one of its top's edge.
_CELL = 0.02
# Points directly below, as a share of the plane's own: a table's edge is less, a box's sides are more.
_BELOW = 0.04
# m; planes closer together are a table and a box top on it, farther apart a floor and a table on it.
_STOREY = 0.3
# Of the largest plane's points, those of one close below it that it stands on; fewer are a glimpse of a floor.
_WIDE = 0.5
# Cosine: nearly parallel planes are storeys of one another.
_PARALLEL = np.cos(np.deg2rad(15))
# m; how far the target may reach into the table that it stands on: noise.
_INTO = 0.02


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
    held = [int((np.abs((some - c) @ n) <= config.table_distance).sum()) for n, c in zip(normal, corner, strict=True)]
    best = int(np.argmax(held))
    plane = np.append(normal[best], -normal[best] @ corner[best])
    values = np.zeros(3)
    for _ in range(_ROUNDS):
        on = counted[np.abs(height(counted, plane)) <= config.table_distance]
        middle = on.mean(axis=0)
        values, directions = np.linalg.eigh(np.cov((on - middle).T))
        plane = np.append(directions[:, 0], -directions[:, 0] @ middle)
    near = np.abs(height(points, plane)) <= config.table_distance
    # An even strip of width w has the variance w^2 / 12.
    return FoundPlane(plane, near if free is None else near & free, float(np.sqrt(12 * max(values[1], 0.0))))


def find_plane(
    points: np.ndarray,
    out: np.ndarray | None,
    config: SceneConfig,
    generator: np.random.Generator,
    up: np.ndarray | None = None,
    target: np.ndarray | None = None,
) -> np.ndarray:
    """The table among the points: the plane that the objects stand on.

    Args:
        points: (N, 3) m.
        out: (3,) a place on the side of the table where the objects are, such as a camera; None: the side on which
            more points lie.
        config: table_distance, table_share, table_width, table_hypotheses.
        generator: draws the hypotheses.
        up: (3,) unit, against gravity, to within 30 deg; None: not known, walls are tables too.
        target: (N,) bool, what stands on it; None: not named.

    Returns:
        (4,) a, b, c, d: a x + b y + c z + d is the distance above the plane, m.

    Raises:
        InputError: no plane holds `table_share` of the points that larger planes, which are no tables, leave over; or
            the best is narrower than `table_width`.
    """
    if len(points) < 3:
        raise InputError(f"table: expected a plane among the points, got {len(points)} points")
    free, tables, best = np.ones(len(points), bool), [], (0.0, 0.0)
    for _ in range(_MOST):
        found = best_plane(points, config, generator, free)
        if found is None:
            break
        share = float(found.on.sum() / free.sum())
        best = max(best, (share, found.width))
        if share < config.table_share:
            break
        side = _side(points, found, out, up)
        found = FoundPlane(side * found.plane, found.on, found.width)
        if found.width >= config.table_width and _is_table(points, found, up):
            tables.append(found)
            free = free & ~found.on
        else:
            free = free & ~found.on
    if not tables:
        if out is not None:
            _check_camera(points, out, config, generator, up)
        if not best[0]:
            raise InputError("table: expected a plane among the points, got points on one line")
        raise InputError(
            f"table: expected a plane with {config.table_share:.0%} of the points and {config.table_width:g} m wide, "
            f"got at best {best[0]:.0%} and {best[1]:.2g} m, or one that is not level or has much below it; give "
            "table=[a,b,c,d], or null if there is none"
        )
    return _chosen(points, tables, target).plane


def _check_camera(
    points: np.ndarray, out: np.ndarray, config: SceneConfig, generator: np.random.Generator, up: np.ndarray | None
) -> None:
    """InputError where there is a table if the camera is left out of account, but with the camera below it."""
    try:
        plane = find_plane(points, None, config, generator, up)
    except InputError:
        return
    below = float(height(out[None], plane)[0])
    if below < 0:
        where = ", ".join(f"{x:.4g}" for x in out)
        raise InputError(
            f"viewpoints: expected on the side of what stands on the table, got ({where}) m, {-below:.3f} m below it; "
            "give viewpoints=[[x,y,z],...], where the camera was"
        )


def _side(points: np.ndarray, found: FoundPlane, out: np.ndarray | None, up: np.ndarray | None) -> float:
    """1 or -1: the sign that lets a plane's normal point to where the objects are."""
    if out is not None:
        return 1.0 if height(out[None], found.plane)[0] >= 0 else -1.0
    if up is not None and abs(found.plane[:3] @ up) >= _LEVEL:
        return float(np.sign(found.plane[:3] @ up))
    off = height(points[~found.on], found.plane)
    return 1.0 if not len(off) or np.median(off) >= 0 else -1.0


def _is_table(points: np.ndarray, found: FoundPlane, up: np.ndarray | None) -> bool:
    """Whether a plane is nearly level, and next to nothing lies directly below it."""
    if up is not None and found.plane[:3] @ up < _LEVEL:
        return False
    return points_below(points, found) <= _BELOW * found.on.sum()


def points_below(points: np.ndarray, found: FoundPlane) -> int:
    """How many points lie under the area that the plane's own points cover, more than a cell deep."""
    axes = np.linalg.svd(found.plane[None, :3])[2][1:]
    cell = np.floor(points @ axes.T / _CELL).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    below = height(points, found.plane) < -_CELL
    covered = np.zeros(cell.max(axis=0) + 2, bool) if np.prod(cell.max(axis=0) + 2.0) < 1e8 else None
    if covered is None:  # kilometres of points
        return int(below.sum())
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            covered[cell[found.on, 0] + i, cell[found.on, 1] + j] = True
    return int(covered[cell[below, 0], cell[below, 1]].sum())


def _chosen(points: np.ndarray, tables: Sequence[FoundPlane], target: np.ndarray | None) -> FoundPlane:
    """The one that carries the target; else the largest, or what it stands on, or what stands on it and is a table."""
    if target is not None and target.any():
        lowest = [float(np.quantile(height(points[target], found.plane), 0.02)) for found in tables]
        under = [i for i, value in enumerate(lowest) if value > -_INTO]
        if under:
            return tables[min(under, key=lambda i: lowest[i])]
    largest = max(tables, key=lambda found: found.on.sum())
    chosen = largest
    for other in tables:
        if other is largest or other.plane[:3] @ largest.plane[:3] < _PARALLEL:
            continue
        over = float(np.median(height(points[other.on], largest.plane)))
        lower = over < float(np.median(height(points[chosen.on], largest.plane)))
        wide = other.on.sum() >= _WIDE * largest.on.sum()
        if (-_STOREY < over < 0 and lower and wide) or (over > _STOREY and chosen is largest):
            chosen = other
    return chosen
