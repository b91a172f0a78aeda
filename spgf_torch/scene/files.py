"""Point cloud files: which format a file is, PLY and numpy's formats, and what in them is a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.ply import read_elements, read_header
from spgf_torch.files.reading import existing, npy_array, npz_arrays, npz_headers
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.cloud import Cloud, check_count, checked, pixels_of
from spgf_torch.scene.colours import ARRAYS, colour_bytes, colours_of_columns
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.labels import numbered
from spgf_torch.scene.pcd import read_pcd
from spgf_torch.scene.text_clouds import TEXT, read_table
from spgf_torch.scene.text_columns import Layout, layout_by_values, named_layout
from spgf_torch.scene.views import files_of_marks, labels_of

NUMPY = (".npy", ".npz")
CLOUDS = (".ply", ".pcd", *TEXT, *NUMPY)
_POINTS = ("points", "xyz", "pc", "pcd", "point_cloud", "pointcloud", "cloud", "vertices", "arr_0")
_NORMALS = ("normals", "normal")
_VIEWPOINTS = ("viewpoints", "viewpoint")


def read_clouds(paths: Sequence[Path], config: SceneConfig) -> list[Cloud]:
    """The point clouds in files, in m, with what `config.mask` or `config.segments` mark as targets.

    Raises:
        InputError: as `read_cloud`; a mask or segments that are not one value a point of the file.
    """
    marks = files_of_marks(config, len(paths), "a cloud")
    clouds = []
    for i, path in enumerate(paths):
        cloud, unit = _as_written(path, config.max_points)
        shape: tuple[int, ...] = (len(cloud),)
        if cloud.pixels is not None and marks[0]:
            shape = (int(cloud.pixels[-1, 0]) + 1, int(cloud.pixels[-1, 1]) + 1)
        labels, notes = labels_of(marks, i, shape, str(path), config.max_points)
        if labels is not None:
            cloud = replace(cloud, labels=labels.ravel(), notes=(*cloud.notes, *notes))
        metres, note = _metres(path, unit, config.unit)
        cloud = checked(replace(cloud, notes=(*cloud.notes, *note))).scaled(metres)
        if cloud.labels is not None:
            numbered(str(marks[1][i]), cloud.labels, "points with a reading")
        clouds.append(cloud)
    return clouds


def read_cloud(path: Path, limit: int) -> Cloud:
    """A point cloud as a file has it: in its unit and frame, normals and viewpoints where it has them.

    Formats: .ply, its vertices; .pcd (ascii, binary, binary_compressed); text with the columns x y z [nx ny nz] or a
    line of column names; .npy (N, 3), (N, 6), an image (H, W, 3) of points, or with fields x, y, z; .npz with such
    `points` (or xyz, pc, ...) and, if known, `normals` and `viewpoints`.

    Args:
        limit: points at most.

    Raises:
        InputError, which names the file: none of these formats, damaged, cut, no points, too many, normals not of
            length 1, ambiguous columns.
    """
    return checked(_as_written(path, limit)[0])


def _as_written(path: Path, limit: int) -> tuple[Cloud, str | None]:
    """All points of a file, those without a reading too, and the unit that it states, if it does."""
    existing(path)
    suffix = path.suffix.lower()
    if suffix == ".pcd":
        return read_pcd(path, limit), None
    if suffix == ".ply":
        return _ply(path, limit), None
    if suffix in TEXT:
        return read_table(path, limit)
    if suffix in NUMPY:
        return _numpy(path, limit), None
    raise InputError(f"{path}: expected a point cloud ({', '.join(CLOUDS)}), got {suffix or 'no suffix'}")


def _metres(path: Path, stated: str | None, unit: str) -> tuple[float, tuple[str, ...]]:
    """m a unit of the file: what its column names state, which the setting must not contradict, else the setting."""
    if stated is None or stated == unit:
        return METRES[unit], ()
    if unit != "m":
        raise InputError(f"{path}: expected coordinates in {unit} (unit={unit}), got column names that state {stated}")
    return METRES[stated], (f"coordinates in {stated}, as the names of the columns state",)


def _ply(path: Path, limit: int) -> Cloud:
    header = read_header(path)
    count = next((element.count for element in header.elements if element.name == "vertex"), 0)
    check_count(path, count, limit)
    elements = read_elements(path, header, ("vertex", "camera"))
    vertex, camera = elements["vertex"], elements.get("camera", {})
    if not {"x", "y", "z"} <= set(vertex):
        raise InputError(f"{path}: expected vertices with properties x, y and z, got {', '.join(vertex) or 'none'}")
    points = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    normals = None
    for prefix in ("n", "normal_"):
        if {prefix + axis for axis in "xyz"} <= set(vertex):
            normals = np.stack([vertex[prefix + axis] for axis in "xyz"], axis=1)
    viewpoint = np.array([camera.get(f"view_p{axis}", np.zeros(1))[:1] for axis in "xyz"]).reshape(1, -1)
    known = viewpoint.size == 3 and np.isfinite(viewpoint).all() and viewpoint.any()  # PCL writes 0 0 0 for unknown
    return Cloud(points, normals, viewpoint if known else None, str(path), colours=colours_of_columns(vertex))


def _numpy(path: Path, limit: int) -> Cloud:
    notes: tuple[str, ...] = ()
    if path.suffix.lower() == ".npy":
        arrays, key = {"points": npy_array(path)}, "points"
    else:
        key, notes = _points_key(path)
        there = npz_headers(path)
        beside = [name for name in (*_NORMALS, *_VIEWPOINTS, *ARRAYS) if name in there and name != key]
        arrays = npz_arrays(path, (key, *beside), 10 * limit)
    cloud = _columns(path, key, arrays[key], limit)
    points = arrays[key]
    given = next((arrays[name] for name in _NORMALS if name in arrays), None)
    if given is not None:
        if given.shape != points.shape or points.shape[-1:] != (3,):
            raise InputError(
                f"{path}: expected points and normals of one shape (N, 3), got {points.shape} and {given.shape}"
            )
        cloud = replace(cloud, normals=_float(path, "normals", given).reshape(-1, 3))
    eyes = next((arrays[name] for name in _VIEWPOINTS if name in arrays), None)
    if eyes is not None:
        cloud = replace(cloud, viewpoints=np.atleast_2d(_float(path, "viewpoints", eyes)))
    tints = next((arrays[name] for name in ARRAYS if name in arrays and name != key), None)
    if tints is not None:
        cloud = _with_colours(cloud, tints)
    return replace(cloud, notes=(*notes, *cloud.notes))


def _with_colours(cloud: Cloud, tints: np.ndarray) -> Cloud:
    """The cloud with an array of colours, a row a point or pixel; a note where it is none."""
    flat = tints.reshape(-1, tints.shape[-1])[:, :3] if tints.ndim > 1 and tints.shape[-1] in (3, 4) else None
    colours = None if flat is None or len(flat) != len(cloud) else colour_bytes(flat)
    if colours is None:
        return replace(cloud, notes=(*cloud.notes, f"colours of shape {tints.shape} and type {tints.dtype} left out"))
    return replace(cloud, colours=colours)


def _points_key(path: Path) -> tuple[str, tuple[str, ...]]:
    """The array of a .npz file that holds the points, and a line where it has another name."""
    headers = npz_headers(path)
    if "points" in headers:
        return "points", ()
    shaped = [
        name
        for name, (shape, dtype) in headers.items()
        if name not in (*_NORMALS, *_VIEWPOINTS, *ARRAYS)
        and (dtype.names or (len(shape) in (2, 3) and shape[-1] in (3, 4, 6) and dtype.kind == "f"))
    ]
    named = [name for name in _POINTS if name in headers]
    if len(named) == 1 and (named[0] != "arr_0" or shaped == ["arr_0"]):
        chosen = named[0]
    elif len(shaped) == 1 and not named:
        chosen = shaped[0]
    else:
        got = ", ".join(f"{name} {shape}" for name, (shape, _) in headers.items()) or "none"
        raise InputError(f"{path}: expected an array named points, got {got}; save the points alone or by this name")
    return chosen, (f"array {chosen} taken for the points",)


def _columns(path: Path, name: str, array: np.ndarray, limit: int) -> Cloud:
    """The points, and normals where there are, of an array (N, C), (H, W, C), or with fields."""
    label = f"{path}: {name}"
    layout: Layout | None = None
    if array.dtype.names:
        check_count(path, int(np.prod(array.shape)), limit)
        array, layout = _of_fields(label, array)
    most = 10 if array.ndim == 2 else 6
    if array.ndim not in (2, 3) or not 3 <= array.shape[-1] <= most:
        raise InputError(f"{label}: expected shape (N, 3), (N, 6) or (H, W, 3), got {array.shape}{_hint(array)}")
    check_count(path, int(np.prod(array.shape[:-1])), limit)
    flat = _float(path, name, array).reshape(-1, array.shape[-1])
    layout = layout or layout_by_values(label, flat, intensity=array.ndim == 3)
    normals = None if layout.normals is None else flat[:, layout.normals]
    cloud = Cloud(flat[:, layout.points], normals, None, str(path), pixels=pixels_of(array.shape), notes=layout.notes)
    return replace(cloud, colours=layout.colours_of(flat))


def _of_fields(label: str, array: np.ndarray) -> tuple[np.ndarray, Layout]:
    """(N, C) or (H, W, C) float64 of an array with fields x, y, z [nx, ny, nz], or with one of the three together."""
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    kinds = {name: array.dtype[name] for name in array.dtype.names or ()}
    together = [name for name in ("xyz", "points", "position") if name in kinds and kinds[name].shape == (3,)]
    if together and kinds[together[0]].base.kind in "fiu":
        return array[together[0]].astype(np.float64), Layout()
    fields = [name for name, kind in kinds.items() if kind.shape == () and kind.kind in "fiu"]
    layout = named_layout(label, fields)
    wanted = (*layout.points, *(layout.normals or ()))
    columns = np.stack([array[fields[i]].astype(np.float64) for i in wanted], axis=-1)
    return columns, Layout((0, 1, 2), (3, 4, 5) if layout.normals else None)


def _hint(array: np.ndarray) -> str:
    if array.ndim == 2 and array.shape[0] in (3, 4, 6):
        return "; transpose it"
    return "; a depth image? then give intrinsics" if array.ndim == 2 else ""


def _float(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    """A float64 copy of numbers; bytes, which are colours, and words are refused."""
    if array.dtype.kind not in "fiu" or array.dtype.itemsize < 2:
        raise InputError(f"{path}: {name}: expected numbers, got {array.dtype}")
    return np.array(array, dtype=np.float64)
