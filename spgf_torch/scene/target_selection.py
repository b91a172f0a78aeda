"""What of the sensed points is a target, what an obstacle, and what the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.cloud import Cloud, vectors
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.gravity import AUTO, Gravity, gravity_of
from spgf_torch.scene.planes import best_plane, given_plane, height
from spgf_torch.scene.support_plane import FoundTable, find_table
from spgf_torch.scene.viewpoint import ahead_of

# Extents of a cloud from the origin to it; a cloud further off has coordinates of a map, which no other unit mends.
_FAR_EXTENTS = 100.0
_FAR = 1000.0  # m
# Of all points, those on a table that was given: fewer, and it touches nothing that was sensed.
_TOUCHED = 0.02
_MOSTLY = 0.5
# m around the target as far as a hand with its way to it reaches; what is beyond is no obstacle and no table.
_REACH = 0.6
# Of the points off the table, those on the side of the cameras: fewer, and the cameras are on the wrong side.
_ABOVE = 0.03
# Of all points: more below a table, and it is none, or not all of it.
_BELOW = 0.03
# deg beyond what gravity is known to: tables slope less.
_TILTED = 22.0
# m; a viewpoint further from the origin is not that of the camera's own frame.
_OWN_FRAME = 1e-3


def crop_box(config: SceneConfig) -> tuple[np.ndarray, np.ndarray]:
    """(3,) lowest and (3,) highest corner of the crop box, m; infinite where none is set."""
    low = np.full(3, -np.inf) if config.crop_low is None else vectors("crop_low", config.crop_low, (3,))
    high = np.full(3, np.inf) if config.crop_high is None else vectors("crop_high", config.crop_high, (3,))
    if (low >= high).any():
        raise InputError(f"crop_low: expected below crop_high {high.tolist()}, got {low.tolist()}")
    return low, high


def within(points: np.ndarray, box: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(...) bool: which of the points (..., 3) lie in a box of two corners."""
    return np.all((points >= box[0]) & (points <= box[1]), axis=-1)


def targeted(clouds: Sequence[Cloud], config: SceneConfig) -> tuple[list[Cloud], list[str]]:
    """The clouds with what is outside of the crop box labelled an obstacle, and without what is out of a hand's reach.

    Raises:
        InputError: no target in the box, or one without the extent of a scene in m.
    """
    box = crop_box(config)
    inside = [within(cloud.points, box) for cloud in clouds]
    before = sum(int(is_target(cloud).sum()) for cloud in clouds)
    if not all(mask.all() for mask in inside):
        clouds = [
            replace(cloud, labels=np.where(mask, np.int32(1) if cloud.labels is None else cloud.labels, np.int32(0)))
            for cloud, mask in zip(clouds, inside, strict=True)
        ]
    targets = [cloud.select(is_target(cloud)) for cloud in clouds]
    after = sum(map(len, targets))
    if not after:
        spans = [f"{a:.4g} to {b:.4g}" for a, b in zip(*_bounds(clouds), strict=True)]
        raise InputError(
            f"crop_low, crop_high: expected points in the box, got none; they span x {spans[0]}, y {spans[1]}, "
            f"z {spans[2]} m with unit={config.unit}"
        )
    low, high = _bounds(targets)
    check_extent(clouds[0].name, low, high, config)
    _check_viewpoints(clouds, (low + high) / 2, config)
    notes = [f"crop: {after} of {before} points are the target; the rest are obstacles"] if after < before else []
    if after < sum(map(len, clouds)):
        clouds = [cloud.select(within(cloud.points, (low - _REACH, high + _REACH))) for cloud in clouds]
    return [cloud for cloud in clouds if len(cloud)], notes


def is_target(cloud: Cloud) -> np.ndarray:
    """(N,) bool: which points are of a target."""
    return np.ones(len(cloud), bool) if cloud.labels is None else cloud.labels > 0


def _bounds(clouds: Sequence[Cloud]) -> tuple[np.ndarray, np.ndarray]:
    """(3,) lowest and (3,) highest corner of all points together."""
    full = [cloud.points for cloud in clouds if len(cloud)]
    return np.min([p.min(axis=0) for p in full], axis=0), np.max([p.max(axis=0) for p in full], axis=0)


def check_extent(name: str, low: np.ndarray, high: np.ndarray, config: SceneConfig) -> None:
    """InputError that names the unit where a box of two corners (3,), m, has not the size of a scene."""
    extent = float((high - low).max())
    if not config.min_extent <= extent <= config.max_extent:
        raise InputError(
            f"{name}: expected an extent of {config.min_extent:g} to {config.max_extent:g} m, got "
            f"{extent:.4g} m with unit={config.unit}; {_extent_hint(low, high, extent, config)}"
        )


def _extent_hint(low: np.ndarray, high: np.ndarray, extent: float, config: SceneConfig) -> str:
    """What may be wrong with points of an unlikely extent: another unit only where one is likely."""
    away = float(np.abs(low + high).max()) / 2
    if not extent:
        return "all points lie in one place"
    if away > max(_FAR, _FAR_EXTENTS * extent):
        return f"the points lie {away:.4g} m from the origin, as on a map: subtract an offset, then crop"
    if low[2] == high[2] == 0:
        return "z is 0 throughout: an image, not a surface?"
    metres = {unit: extent * METRES[unit] / METRES[config.unit] for unit in METRES if unit != config.unit}
    fitting = [f"unit={unit}" for unit, size in metres.items() if config.min_extent <= size <= config.max_extent]
    otherwise = "" if extent < config.min_extent else ", else crop_low and crop_high"
    if not fitting:
        return "no unit would fit" + (otherwise and "; give crop_low and crop_high?")
    return f"{' or '.join(fitting)} would fit, if that is the file's{otherwise}"


def _check_viewpoints(clouds: Sequence[Cloud], middle: np.ndarray, config: SceneConfig) -> None:
    for cloud in clouds:
        away = 0.0 if cloud.viewpoints is None else np.abs(cloud.viewpoints - middle).max()
        if away > config.max_extent:
            raise InputError(
                f"viewpoints: expected within {config.max_extent:g} m of the points, got {away:.4g} m away; settings "
                f"are in m, the file's own in its unit (unit={config.unit})"
            )


def table_of(
    clouds: Sequence[Cloud],
    config: SceneConfig,
    generator: np.random.Generator,
    gravity: Gravity | None,
    notes: list[str],
) -> np.ndarray | None:
    """(4,) the table that `config.table` gives, or that is found among the points; None without. Lines go to `notes`.

    Raises:
        InputError: none is found; nothing of a target is above it; the viewpoints are below it.
    """
    if config.table is None:
        notes.append(_without_table(gravity))
        return None
    points = np.concatenate([cloud.points for cloud in clouds])
    target = np.concatenate([is_target(cloud) for cloud in clouds])
    seen_from = viewpoints_of(clouds, guessed=True)
    doubts: tuple[str, ...] = ()
    if isinstance(config.table, str) and config.table == "find":
        named = None if target.all() else target
        out = None if seen_from is None else seen_from.mean(axis=0)
        found = _found(points, out, config, generator, gravity, named)
        plane, doubts = found.plane, found.doubts
    elif isinstance(config.table, str):
        raise InputError(f"table: expected null, find or [a,b,c,d], got {config.table}")
    else:
        plane = given_plane(config.table)
    over = height(points, plane)
    if not (over[target] > config.table_distance).any():
        _check_table_side(over, seen_from, config)
        under = config.table != "find" and bool((over[target] < -config.table_distance).any())
        raise InputError(
            f"table: expected points more than {config.table_distance:g} m above the plane, got none"
            f"{'; turn the sign of all four numbers?' if under else ''}"
        )
    # Hands may come from below (gravity=null), but a table is level all the same.
    up = gravity or gravity_of(replace(config, gravity=AUTO), viewpoints_of(clouds), ahead=ahead_of(clouds))
    assert up is not None
    notes.extend(_table_notes(plane, over, viewpoints_of(clouds), up, config.table_distance))
    if config.table != "find":
        notes.extend(_missed(plane, points, config))
    notes.extend(f"warning: table: {doubt}; if that is not it, give table=[a,b,c,d]" for doubt in doubts)
    return plane


def _without_table(gravity: Gravity | None) -> str:
    none = "no table: none given (table=[a,b,c,d]), none looked for (table=find)"
    if gravity is None:
        return f"{none}; hands may come from below and through what is not seen (gravity=null)"
    how = "" if gravity.given else "; gravity=[x,y,z] or null otherwise"
    return f"{none}; from below only where there is nothing else ({gravity.words}{how})"


def _found(
    points: np.ndarray,
    out: np.ndarray | None,
    config: SceneConfig,
    generator: np.random.Generator,
    gravity: Gravity | None,
    target: np.ndarray | None,
) -> FoundTable:
    """The table among the points; one that is not level by an up that is only assumed, if there is no other."""
    if gravity is None:
        return find_table(points, out, config, generator, None, target)
    try:
        return find_table(points, out, config, generator, gravity.up, target)
    except InputError as error:
        if gravity.given:
            raise InputError(f"{error} (level {gravity.words}: {_list(-gravity.up)}, which points down)") from None
        try:
            return find_table(points, out, config, generator, None, target)
        except InputError:
            raise error from None


def _list(vector: np.ndarray) -> str:
    return f"[{', '.join(f'{x + 0.0:.3g}' for x in vector)}]"


def _check_table_side(over: np.ndarray, seen_from: np.ndarray | None, config: SceneConfig) -> None:
    """InputError where what stands on the table stands on the side away from the viewpoints."""
    below = float((over < -2 * config.table_distance).mean())
    if seen_from is not None and below > _ABOVE and config.table == "find":
        where = ", ".join(f"{x:.4g}" for x in seen_from.mean(axis=0))
        raise InputError(
            f"viewpoints: expected on the side of what stands on the table, got ({where}) m below it, and {below:.0%} "
            "of the points on its other side alone; give viewpoints=[[x,y,z],...], where the camera was"
        )


def _missed(plane: np.ndarray, points: np.ndarray, config: SceneConfig) -> list[str]:
    """A warning where a plane that was given holds next to none of the points, but another holds most."""
    on = float((np.abs(height(points, plane)) <= config.table_distance).mean())
    found = best_plane(points, config, np.random.default_rng(0))
    if found is None or on > _TOUCHED or found.share < _MOSTLY or found.width < config.table_width:
        return []
    away = float(np.median(height(points[found.on], plane)))
    tilt = float(np.rad2deg(np.arccos(np.clip(abs(found.plane[:3] @ plane[:3]), 0, 1))))
    return [
        f"warning: table: {on:.0%} of the points lie on the one given; the plane that holds {found.share:.0%} of them "
        f"lies {abs(away):.3f} m {'above' if away > 0 else 'below'} it, tilted {tilt:.0f} deg against it"
    ]


def _table_notes(
    plane: np.ndarray, over: np.ndarray, seen_from: np.ndarray | None, gravity: Gravity, near: float
) -> list[str]:
    """Lines on a table: where it is, how tilted against what is likely up, what lies on and below it.

    Args:
        over: (N,) m, of all points above it. near: table_distance, m.
    """
    equation = ", ".join(f"{round(value, 4) + 0.0:.4f}" for value in plane)
    on, below = (int(which.sum()) for which in (np.abs(over) <= near, over < -near))
    tilt = float(np.rad2deg(np.arccos(np.clip(plane[:3] @ gravity.up, -1, 1))))
    eye = (
        "" if seen_from is None else f", {float(height(seen_from.mean(axis=0)[None], plane)[0]):.3f} m below the camera"
    )
    notes = [
        f"table ({equation}): tilted {tilt:.1f} deg from level ({gravity.words}){eye}; {on} points on it and {below} "
        f"below removed of {len(over)}"
    ]
    if tilt > _TILTED + gravity.within_deg:
        notes.append(
            f"warning: table: tilted {tilt:.0f} deg ({gravity.words}); a wall, the side of a box, a wrong pose? give "
            "table=[a,b,c,d], poses or gravity=[x,y,z] otherwise"
        )
    off_z = float(np.rad2deg(np.arccos(np.clip(plane[2], -1, 1))))
    if gravity.within_deg and seen_from is not None and np.abs(seen_from).max() > _OWN_FRAME and off_z > _TILTED:
        notes.append(
            f"warning: table: its normal is {off_z:.0f} deg off z of the frame of the poses or viewpoints; "
            "are the poses T_input_camera, z forward and y down in the camera, not their inverse?"
        )
    if below > _BELOW * len(over):
        notes.append(
            f"warning: table: {below / len(over):.0%} of the points lie below it; is it the plane that the objects "
            "stand on? else give table=[a,b,c,d] or crop_low, crop_high"
        )
    return notes


def viewpoints_of(clouds: Sequence[Cloud], guessed: bool = False) -> np.ndarray | None:
    """(V, 3) all viewpoints of the clouds, each once; None if none is known.

    Args:
        guessed: also those of which only the side is known.
    """
    known = [c.viewpoints for c in clouds if c.viewpoints is not None and (guessed or not c.guessed)]
    return np.unique(np.concatenate(known), axis=0) if known else None
