"""What of the sensed points is kept: those in the crop box and above the table, if they have the extent of a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spgf_torch.config import InputError, SceneConfig
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.cloud import Cloud, vectors
from spgf_torch.scene.table import find_plane, given_plane, height

# Extents of a cloud from the origin to it; a cloud further off has coordinates of a map, which no other unit mends.
_FAR_EXTENTS = 100.0
_FAR = 1000.0  # m


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


def cropped(clouds: Sequence[Cloud], config: SceneConfig) -> tuple[list[Cloud], list[str]]:
    """What lies in the crop box, clouds with nothing in it left out; checked to have the extent of a scene in m."""
    box = crop_box(config)
    inside = [within(cloud.points, box) for cloud in clouds]
    kept = [
        cloud if mask.all() else cloud.select(mask) for cloud, mask in zip(clouds, inside, strict=True) if mask.any()
    ]
    if not kept:
        spans = [f"{a:.4g} to {b:.4g}" for a, b in zip(*_bounds(clouds), strict=True)]
        raise InputError(
            f"crop_low, crop_high: expected points in the box, got none; they span x {spans[0]}, y {spans[1]}, "
            f"z {spans[2]} m with unit={config.unit}"
        )
    low, high = _bounds(kept)
    check_extent(kept[0].name, low, high, config)
    _check_viewpoints(kept, (low + high) / 2, config)
    before, after = sum(map(len, clouds)), sum(map(len, kept))
    return kept, [f"crop: {after} of {before} points kept"] if after < before else []


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


def without_table(
    clouds: list[Cloud], config: SceneConfig, generator: np.random.Generator, notes: list[str]
) -> tuple[list[Cloud], np.ndarray | None]:
    """The clouds above the table, and its plane, as `config.table` says; adds a line to `notes`."""
    if config.table is None:
        return clouds, None
    points = np.concatenate([cloud.points for cloud in clouds])
    if config.table == "find":
        seen_from = viewpoints_of(clouds)
        plane = find_plane(points, None if seen_from is None else seen_from.mean(axis=0), config, generator)
    elif isinstance(config.table, str):
        raise InputError(f"table: expected null, find or [a,b,c,d], got {config.table}")
    else:
        plane = given_plane(config.table)
    above = [cloud.select(height(cloud.points, plane) > config.table_distance) for cloud in clouds]
    left = sum(map(len, above))
    below = int((height(points, plane) < -config.table_distance).sum())
    if not left:
        raise InputError(f"table: expected points more than {config.table_distance:g} m above the plane, got none")
    equation = ", ".join(f"{value:.4f}" for value in plane)
    notes.append(
        f"table ({equation}): {len(points) - left - below} points on it and {below} below removed of {len(points)}"
    )
    return [cloud for cloud in above if len(cloud)], plane


def viewpoints_of(clouds: Sequence[Cloud]) -> np.ndarray | None:
    """(V, 3) all viewpoints of the clouds, each once; None if none is known."""
    known = [cloud.viewpoints for cloud in clouds if cloud.viewpoints is not None]
    return np.unique(np.concatenate(known), axis=0) if known else None
