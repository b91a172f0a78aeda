"""A point cloud with or without normals, what it must satisfy, and its thinning by voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.geometry.principal import principal_axes

# Normals of a file may be rounded; longer or shorter by more, the columns are something else, such as colours.
_LENGTH_TOLERANCE = 0.1
# Shorter is a normal that says nothing, such as the zeros that Gaussian splats carry.
_NO_LENGTH = 1e-6


@dataclass(frozen=True)
class Cloud:
    """Points of a surface.

    Attributes:
        points: (N, 3) float64, m once the unit has been applied.
        normals: (N, 3) float64, unit, out of the surface; None: not known.
        viewpoints: (V, 3) float64, where it was seen from, same frame; None: not known.
        name: for errors, the file that it came from.
        labels: (N,) int32, the target that each point is of, 0: of none, an obstacle; None: all are the target.
        pixels: (N, 2) int32 row and column, where the points are those of an image; None: not known.
        notes: what the reader left out or took for something, a line each.
        colours: (N, 3) uint8 red, green, blue, to be shown; None: not known.
        guessed: whether the viewpoints tell the side that was seen, but not from how far.
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    viewpoints: np.ndarray | None = None
    name: str = "cloud"
    labels: np.ndarray | None = None
    pixels: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    guessed: bool = False
    colours: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def select(self, which: np.ndarray) -> Cloud:
        """The points that a mask or index (N,) names."""
        names = ("normals", "labels", "pixels", "colours")
        known = {name: column[which] for name in names if (column := getattr(self, name)) is not None}
        return replace(self, points=self.points[which], **known)

    def scaled(self, factor: float) -> Cloud:
        """Points and viewpoints times `factor`."""
        viewpoints = None if self.viewpoints is None else self.viewpoints * factor
        return replace(self, points=self.points * factor, viewpoints=viewpoints)


def pixels_of(shape: tuple[int, ...]) -> np.ndarray | None:
    """(H * W, 2) int32 row and column of each point of an image of points (H, W, 3), one after another; else None."""
    return np.indices(shape[:2], dtype=np.int32).reshape(2, -1).T if len(shape) == 3 else None


def check_count(path: Path, count: int, limit: int) -> None:
    """InputError for no points or for more than `limit`."""
    if count == 0:
        raise InputError(f"{path}: expected points, got none")
    if count > limit:
        raise InputError(f"{path}: expected at most {limit} points (max_points), got {count}; thin them first")


def checked(cloud: Cloud) -> Cloud:
    """The cloud's usable points as float64, with normals of length 1; what is left out is in its notes.

    NaN, infinity and (0, 0, 0) are what sensors and their drivers write where nothing was measured: such points are
    left out. So are points without a usable normal (NaN, infinite, of length 0) where most have one; where most have
    none, the cloud has no normals.

    Raises:
        InputError: arrays of other shapes, no point with a reading, viewpoints that are not finite, normals of
            another length than 1.
    """
    _check_shapes(cloud)
    cloud = replace(cloud, points=cloud.points.astype(np.float64, copy=False))
    if not len(cloud):
        raise InputError(f"{cloud.name}: expected points, got none")
    if cloud.viewpoints is not None and not np.isfinite(cloud.viewpoints).all():
        bad = int((~np.isfinite(cloud.viewpoints)).any(axis=1).sum())
        raise InputError(f"{cloud.name}: expected finite viewpoints, got {bad} with NaN or infinity")
    measured = np.isfinite(cloud.points).all(axis=1) & (cloud.points != 0).any(axis=1)
    if not measured.any():
        raise InputError(f"{cloud.name}: expected points, got none: all {len(cloud)} are NaN, infinite or 0 0 0")
    if not measured.all():
        without = len(measured) - int(measured.sum())
        note = f"{without} of {len(measured)} points without a reading (NaN, infinite or 0 0 0) left out"
        cloud = replace(cloud.select(measured), notes=(*cloud.notes, note))
    return cloud if cloud.normals is None else _with_unit_normals(cloud, cloud.normals.astype(np.float64, copy=False))


def _check_shapes(cloud: Cloud) -> None:
    count = len(cloud)
    for what, values in (("points", cloud.points), ("normals", cloud.normals), ("viewpoints", cloud.viewpoints)):
        length = count if what == "normals" else "N"
        if values is not None and (values.ndim != 2 or values.shape[1] != 3 or length not in ("N", len(values))):
            raise InputError(f"{cloud.name}: expected {what} of shape ({length}, 3), got {values.shape}")
    if cloud.colours is not None and cloud.colours.shape != (count, 3):
        raise InputError(f"{cloud.name}: expected colours of shape ({count}, 3), got {cloud.colours.shape}")
    if cloud.labels is not None and cloud.labels.shape != (count,):
        raise InputError(f"{cloud.name}: expected a label for each of {count} points, got shape {cloud.labels.shape}")


def _with_unit_normals(cloud: Cloud, normals: np.ndarray) -> Cloud:
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(normals, axis=1)
    usable = np.isfinite(length) & (length > _NO_LENGTH)
    unusable = f"normals NaN, infinite or of length 0 in {int((~usable).sum())} of {len(usable)} points"
    if 2 * int(usable.sum()) < len(usable):
        note = f"{unusable}: estimated instead, which needs a viewpoint"
        return replace(cloud, normals=None, notes=(*cloud.notes, note))
    length = length[usable]
    if np.abs(length - 1).max() > _LENGTH_TOLERANCE:
        raise InputError(
            f"{cloud.name}: expected normals of length 1, got lengths of {length.min():.3g} to {length.max():.3g} "
            "(colours? then give x y z alone)"
        )
    if not usable.all():
        cloud = replace(cloud.select(usable), notes=(*cloud.notes, f"{unusable}: these points left out"))
    return replace(cloud, normals=normals[usable] / length[:, None])


def voxel_means(cloud: Cloud, voxel: float) -> Cloud:
    """One point a cell of a cubic grid along the cloud's principal axes: the mean of those in it, in order of their
    first. A turned and moved cloud falls into the same cells.

    With normals, points whose normals' longest components differ in axis or sign stay apart: the sides of a thin wall
    that fall into one cell are not averaged. Points of different labels stay apart. Pixels are no more.

    Args:
        voxel: side of a cell, m.
    """
    axes = principal_axes(cloud.points)
    along = cloud.points @ axes.T
    cell = np.floor((along - along.min(axis=0)) / voxel).astype(np.int64)
    size = cell.max(axis=0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    if cloud.normals is not None:
        facing = cloud.normals @ axes.T
        axis = np.abs(facing).argmax(axis=1)
        key = key * 6 + axis * 2 + (facing[np.arange(len(axis)), axis] > 0)
    if cloud.labels is not None:
        found, label = np.unique(cloud.labels, return_inverse=True)
        key = key * len(found) + label
    _, first, home = np.unique(key, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    home = rank[home]
    points = _means(cloud.points, home, len(first))
    labels = None if cloud.labels is None else cloud.labels[np.sort(first)]
    colours = None
    if cloud.colours is not None:
        colours = np.rint(_means(cloud.colours, home, len(first))).astype(np.uint8)
    cloud = replace(cloud, labels=labels, pixels=None, colours=colours)
    if cloud.normals is None:
        return replace(cloud, points=points)
    normals = _means(cloud.normals, home, len(first))
    return replace(cloud, points=points, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _means(values: np.ndarray, home: np.ndarray, count: int) -> np.ndarray:
    members = np.bincount(home, minlength=count)
    return np.stack([np.bincount(home, weights=column, minlength=count) / members for column in values.T], axis=1)


def vectors(name: str, values: object, shape: Sequence[int | None]) -> np.ndarray:
    """A setting as a float64 array of `shape` (None: any length); InputError that names it otherwise."""
    words = " x ".join("N" if n is None else str(n) for n in shape)
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name}: expected {words} numbers, got {values!r}") from None
    fits = array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
    if not fits or not np.isfinite(array).all():
        raise InputError(f"{name}: expected {words} finite numbers, got {values!r}")
    return array
