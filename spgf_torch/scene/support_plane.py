"""The plane that objects stand on: found among points, and turned to them.

Not the largest plane: the top of a big box, a wall, the floor and a shelf above are larger at times. A table is nearly
level, where it is known what is up; carries things; its edge does not go down to another level plane, as that of a box
does; and it is under the target, where a target is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.planes import FoundPlane, best_plane, height

# Points that what stands on a plane is counted in.
_COUNTED = 30_000
# Planes that are looked at, each in what the ones before leave over.
_MOST = 8
# Cosine of the tilt from "up" beyond which a plane is a wall; "up" may itself be off by 30 deg.
_LEVEL = np.cos(np.deg2rad(60))
# deg that a plane may be tilted more than the most level one, before it is taken for a wall or a side of a box.
_LEANS = 20.0
# m; side of the cells of a plane.
_CELL = 0.02
# m below a plane's edge: a table top is less thick; what is seen there is the side of a box.
_EDGE = (0.045, 0.09)
# Of a plane's outline, the part beneath which a side is seen: more, and it is a top.
_SIDES = 0.08
# m above a plane where what stands on it begins, and up to where it is counted.
_FOOT, _TALL = 0.03, 0.3
# m; planes closer together are a table and a box top on it, farther apart a floor and a table on it.
_STOREY = 0.35
# Cosine: nearly parallel planes are storeys of one another.
_PARALLEL = np.cos(np.deg2rad(15))
# m; how far the target may reach into the table that it stands on: noise. How far it may seem to hang above it.
_INTO, _ABOVE = 0.02, 0.04
# Of the target's points, how many lie below its lowest, by noise, and below its highest, where its mask is too wide.
_LOWEST, _HIGHEST = 0.02, 0.99
# m around the target where the plane that it stands on is looked for first.
_AROUND = 0.2
# Of the table's points, those of another level plane that may as well be the table.
_RIVAL = 0.3
# Of a top's points, those of the table around it where its sides are hidden: fewer, and it is a glimpse of a floor. And
# of its area, what the table must carry for the top to be part of it.
_HALF = 0.5
# m; a plane as narrow as this that holds much is a side of a thing, or a table in another unit.
_NARROW = 0.15
# Of the usual points in a cell, fewer are stray ones.
_FEW = 0.1
# Of the points within a cell's side of a plane, those on it: fewer, and it is a slice of noise, or of a side.
_OWN = 0.6


@dataclass(frozen=True)
class FoundTable:
    """The table among points.

    Attributes:
        plane: (4,) a, b, c, d: a x + b y + c z + d is the distance above it, m.
        doubts: why it may be another plane, in words.
    """

    plane: np.ndarray
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Level:
    """A plane that may be the table.

    Attributes:
        plane: (4,) as FoundTable's. count: points on it. area: m2 that they cover. middle: (3,) m, theirs.
        carried: m2 of what stands on it, seen from above. hung: the same of its other side.
        sides: of its outline, the part with something seen directly below.
    """

    plane: np.ndarray
    count: int
    area: float
    carried: float
    hung: float
    sides: float
    middle: np.ndarray


def find_plane(
    points: np.ndarray,
    out: np.ndarray | None,
    config: SceneConfig,
    generator: np.random.Generator,
    up: np.ndarray | None = None,
    target: np.ndarray | None = None,
) -> np.ndarray:
    """(4,) the plane of `find_table`."""
    return find_table(points, out, config, generator, up, target).plane


def find_table(
    points: np.ndarray,
    out: np.ndarray | None,
    config: SceneConfig,
    generator: np.random.Generator,
    up: np.ndarray | None = None,
    target: np.ndarray | None = None,
) -> FoundTable:
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
        The plane, and what speaks for another one.

    Raises:
        InputError: no plane holds `table_share` of the points that larger planes, which are no tables, leave over; or
            the best is narrower than `table_width`.
    """
    if len(points) < 3:
        raise InputError(f"table: expected a plane among the points, got {len(points)} points")
    if len(points) > _COUNTED:
        chosen = np.sort(generator.choice(len(points), _COUNTED, replace=False))
        points, target = points[chosen], None if target is None else target[chosen]
    named = target if target is not None and target.any() else None
    best, levels = (0.0, 0.0), []
    for free in _regions(points, named):
        found, most = _levels(points, free, out, config, generator, up)
        levels += found
        best = max(best, most)
        if named is not None and (under := _under(points[named], levels, _ABOVE)) is not None:
            return under
    if named is not None and (under := _under(points[named], levels, np.inf)) is not None:
        return under
    if levels:
        table = _chosen(levels)
        return table if named is None else replace(table, doubts=(*table.doubts, "the target reaches below it"))
    if out is not None:
        _check_camera(points, out, config, generator, up)
    raise _no_table(best, config)


def _no_table(best: tuple[float, float], config: SceneConfig) -> InputError:
    """What is said where the largest plane has this share of the points, and this width in m, and is no table."""
    share, width = best
    if not share:
        return InputError("table: expected a plane among the points, got points on one line")
    narrow = "another unit or depth_scale? else " if share >= config.table_share and width < _NARROW else ""
    return InputError(
        f"table: expected a plane with {config.table_share:.0%} of the points and {config.table_width:g} m wide, "
        f"got at best {share:.0%} and {width:.2g} m, or one that is not level; {narrow}give table=[a,b,c,d], or "
        "null if there is none"
    )


def _regions(points: np.ndarray, target: np.ndarray | None) -> list[np.ndarray]:
    """(N,) bool where planes are looked for: around the target, where one is named, and then everywhere."""
    everywhere = np.ones(len(points), bool)
    if target is None:
        return [everywhere]
    low, high = points[target].min(axis=0) - _AROUND, points[target].max(axis=0) + _AROUND
    return [((points >= low) & (points <= high)).all(axis=1), everywhere]


def _levels(
    points: np.ndarray,
    free: np.ndarray,
    out: np.ndarray | None,
    config: SceneConfig,
    generator: np.random.Generator,
    up: np.ndarray | None,
) -> tuple[list[_Level], tuple[float, float]]:
    """The wide and level planes among the points that count, and share and width of the largest plane of any kind."""
    levels: list[_Level] = []
    best, free = (0.0, 0.0), free.copy()
    for _ in range(_MOST):
        found = best_plane(points, config, generator, free)
        if found is None:
            break
        share = float(found.on.sum() / free.sum())
        best = max(best, (share, found.width))
        if share < config.table_share:
            break
        free &= ~found.on
        plane = found.plane * _side(points, found, out, up)
        if found.width < config.table_width or (up is not None and plane[:3] @ up < _LEVEL):
            continue
        level = _measured(points, plane, found.on)
        if level is not None and not any(_same(level, other) for other in levels):
            levels.append(level)
    return [level for level in levels if not _leans(level, levels, up)], best


def _same(a: _Level, b: _Level) -> bool:
    """Whether two planes are one: what noise or a bend left over of the other."""
    return bool(a.plane[:3] @ b.plane[:3] > _PARALLEL and abs(float(height(a.middle, b.plane))) < _CELL / 2)


def _leans(level: _Level, levels: Sequence[_Level], up: np.ndarray | None) -> bool:
    """Whether a plane is so much less level than another that it is a wall."""
    if up is None:
        return False
    tilts = [np.rad2deg(np.arccos(min(1.0, float(one.plane[:3] @ up)))) for one in (level, *levels)]
    return bool(tilts[0] > min(tilts) + _LEANS)


def _measured(points: np.ndarray, plane: np.ndarray, on: np.ndarray) -> _Level | None:
    """What a plane covers, what stands on it and what is seen below its edge, in cells; None for a slice of more."""
    axes = np.linalg.svd(plane[None, :3])[2][1:]
    cell = np.floor(points @ axes.T / _CELL).astype(np.int64)
    cell -= cell.min(axis=0) - 2
    shape = tuple(cell.max(axis=0) + 3)
    flat = cell @ np.array([shape[1], 1])
    over = height(points, plane)

    def counts(which: np.ndarray) -> np.ndarray:
        return np.bincount(flat[which], minlength=shape[0] * shape[1]).reshape(shape)

    held = counts(on)
    few = max(1.0, _FEW * float(np.median(held[held > 0])))
    covered = held >= few
    if held[covered].sum() < _OWN * counts(np.abs(over) < _CELL)[covered].sum():
        return None
    near = ndimage.binary_dilation(covered, np.ones((3, 3)))
    above, under = (counts((sign * over > _FOOT / 2) & (sign * over < _TALL)) >= few for sign in (1, -1))
    carried, hung = (_CELL**2 * _touching(things, near) for things in (above, under))
    below = (counts((over < -_EDGE[0]) & (over > -_EDGE[1])) >= few) & near & ~above
    sides = float(below.sum() / (4 * np.sqrt(max(covered.sum(), 1))))
    return _Level(plane, int(on.sum()), _CELL**2 * covered.sum(), carried, hung, sides, points[on].mean(axis=0))


def _touching(things: np.ndarray, near: np.ndarray) -> int:
    """How many cells (bool) the things have that begin at a plane's own cells."""
    number, _ = ndimage.label(things, np.ones((3, 3)))
    touching = np.unique(number[things & near])
    return int(np.isin(number, touching[touching > 0]).sum())


def _under(target: np.ndarray, levels: Sequence[_Level], most: float) -> FoundTable | None:
    """The plane next below the target (N, 3); None if there is none, or the target hangs more than `most` m above."""
    low, high = (
        [float(np.quantile(height(target, level.plane), part)) for level in levels] for part in (_LOWEST, _HIGHEST)
    )
    below = [i for i in range(len(levels)) if -_INTO < low[i] <= most and high[i] > _FOOT / 2]
    if not below:
        return None
    i = min(below, key=lambda i: abs(low[i]))
    hangs = f"the lowest that is seen of the target is {low[i]:.3f} m above it"
    return FoundTable(levels[i].plane, (hangs,) if low[i] > _ABOVE else ())


def _chosen(levels: Sequence[_Level]) -> FoundTable:
    """The largest one; or what it stands on, if it is a top; or the one above it that things stand on."""
    table = max(levels, key=lambda level: (level.carried > 0, level.count))
    for _ in levels:
        lower = [one for one in levels if _stands_on(table, one)]
        higher = [one for one in levels if _storey_above(one, table)]
        if lower:
            table = max(lower, key=lambda level: level.count)
        elif higher:
            table = max(higher, key=lambda level: level.carried)
        else:
            break
    return FoundTable(table.plane, tuple(_doubts(table, levels)))


def _over(a: _Level, b: _Level) -> float:
    """m of the middle of plane a above plane b; NaN where they are not parallel."""
    return float(height(a.middle, b.plane)) if a.plane[:3] @ b.plane[:3] > _PARALLEL else np.nan


def _stands_on(top: _Level, table: _Level) -> bool:
    """Whether a plane is the top of something that stands on another."""
    over = _over(top, table)
    if not 0 < over < _STOREY or table.carried < _HALF * top.area:
        return False
    step = over < _EDGE[0] and table.count > _RIVAL * top.count
    return step or top.sides > _SIDES or table.count > _HALF * top.count


def _storey_above(upper: _Level, table: _Level) -> bool:
    """Whether a plane is a table above another that things stand on too, such as a floor."""
    over = _over(upper, table)
    if over > _STOREY:
        return upper.carried > 0
    return over > 0 and upper.carried > table.carried and upper.sides <= _SIDES


def _doubts(table: _Level, levels: Sequence[_Level]) -> list[str]:
    """Why another plane may be the table."""
    doubts = []
    if table.sides > _SIDES:
        doubts.append("something is seen right below its edge, as a box has its sides below its top")
    if table.hung > 2 * table.carried:
        doubts.append("more is seen behind it than stands on it; is the camera on its other side?")
    elif not table.carried:
        doubts.append("nothing seems to stand on it")
    for other in levels:
        over = _over(other, table)
        if (
            other is table
            or other.count < _RIVAL * table.count
            or (0 < over < _STOREY and other.sides > _SIDES and not other.carried)
        ):
            continue
        equation = ", ".join(f"{value:.3f}" for value in other.plane)
        where = f"{abs(over):.2f} m {'above' if over > 0 else 'below'} it" if over == over else "across it"
        doubts.append(f"({equation}), {where}, is a wide plane as well")
    return doubts


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
