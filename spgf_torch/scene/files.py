"""Point cloud files: which format a file is, and PLY, text and numpy's formats."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from trimesh.exchange.ply import load_ply

from spgf_torch.config import InputError
from spgf_torch.objects.mesh_files import declared, ply_header
from spgf_torch.reading import existing, npy_array, npz_arrays, reason
from spgf_torch.scene.cloud import Cloud, check_count, checked
from spgf_torch.scene.pcd import read_pcd

TEXT = (".xyz", ".xyzn", ".txt", ".csv", ".asc")
NUMPY = (".npy", ".npz")
_MOST_COLUMNS = 100
CLOUDS = (".ply", ".pcd", *TEXT, *NUMPY)


def read_cloud(path: Path, limit: int) -> Cloud:
    """A point cloud as a file has it: in its unit and frame, normals and viewpoints where it has them.

    Formats: .ply; .pcd (ascii, binary, binary_compressed); text with the columns x y z [nx ny nz] or a line of column
    names; .npy (N, 3), (N, 6) or an image (H, W, 3 or 6) of points; .npz with such `points` and, if known, `normals`
    and `viewpoints`. In an image of points NaN and (0, 0, 0) mean that nothing was measured.

    Args:
        limit: points at most.

    Raises:
        InputError, which names the file: none of these formats, damaged, cut, no points, too many, NaN or infinite
            values, normals not of length 1.
    """
    existing(path)
    suffix = path.suffix.lower()
    if suffix == ".pcd":
        return read_pcd(path, limit)
    if suffix == ".ply":
        return _ply(path, limit)
    if suffix in TEXT:
        return _text(path, limit)
    if suffix in NUMPY:
        return _numpy(path, limit)
    raise InputError(f"{path}: expected a point cloud ({', '.join(CLOUDS)}), got {suffix or 'no suffix'}")


def _ply(path: Path, limit: int) -> Cloud:
    header = ply_header(path)
    count = declared(header, "vertex")
    check_count(path, count, limit)
    try:
        with path.open("rb") as stream:
            loaded = load_ply(stream, skip_materials=True)
        points = np.asarray(loaded["vertices"], dtype=np.float64)
        with_normals = all(re.search(rf"^property \w+ {name}\s*$", header, re.MULTILINE) for name in ("nx", "ny", "nz"))
        normals = np.asarray(loaded["vertex_normals"], dtype=np.float64) if with_normals else None
    except Exception as error:  # trimesh raises many kinds for a damaged file
        raise InputError(
            f"{path}: expected a whole .ply point cloud, got a damaged or cut file ({reason(error)})"
        ) from error
    if len(points) != count:
        raise InputError(f"{path}: expected {count} points as its header says, got {len(points)}: the file is cut")
    return checked(Cloud(points, normals, None, str(path)), organised=False)


def _text(path: Path, limit: int) -> Cloud:
    try:
        with path.open(encoding="utf-8-sig") as stream:
            names, delimiter, skipped = _layout(stream)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*contained no data")
            table = np.loadtxt(
                path,
                delimiter=delimiter,
                skiprows=skipped,
                comments=("#", "//"),
                ndmin=2,
                max_rows=limit + 1,
                encoding="utf-8-sig",
            )
    except ValueError as error:  # a word that is no number, rows of different length, not text
        raise InputError(f"{path}: expected rows of numbers x y z [nx ny nz], got {reason(error)}") from None
    if table.size:
        table = _columns(path, table, names)
    check_count(path, len(table), limit)
    normals = table[:, 3:] if table.shape[1] == 6 else None
    return checked(Cloud(table[:, :3], normals, None, str(path)), organised=False)


def _layout(lines: Iterable[str]) -> tuple[list[str], str | None, int]:
    """Column names ([] if none), delimiter (None: white space) and lines to skip of a table of numbers."""
    for number, line in enumerate(lines):
        text = line.strip()
        if not text or text.startswith(("#", "//")):
            continue
        delimiter = next((mark for mark in ",;" if mark in text), None)
        words = [word.strip().strip('"').lower() for word in text.split(delimiter)]
        if len(words) > _MOST_COLUMNS:  # numpy makes room for as many in every row that there may be
            raise ValueError(f"{len(words)} columns")
        try:
            [float(word) for word in words]
        except ValueError:
            return words, delimiter, number + 1
        return [], delimiter, 0
    return [], None, 0


def _columns(path: Path, table: np.ndarray, names: list[str]) -> np.ndarray:
    """x y z, and nx ny nz where there are, of a table."""
    if not names and table.shape[1] in (3, 6):
        return table
    if not names:
        raise InputError(
            f"{path}: expected 3 columns x y z or 6 with normals (or a line of names), got {table.shape[1]}"
        )
    names = [re.sub("^normal_?(?=[xyz]$)", "n", name) for name in names]
    if len(names) != table.shape[1] or not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path}: expected columns named x, y, z [nx, ny, nz]; got {', '.join(names)}")
    wanted = ("x", "y", "z", "nx", "ny", "nz") if {"nx", "ny", "nz"} <= set(names) else ("x", "y", "z")
    return table[:, [names.index(name) for name in wanted]]


def _numpy(path: Path, limit: int) -> Cloud:
    if path.suffix.lower() == ".npy":
        arrays = {"points": npy_array(path)}
    else:
        arrays = npz_arrays(path, ("points", "normals", "viewpoints"), 6 * limit)
    points = _array(path, "points", arrays["points"])
    organised = points.ndim == 3
    check_count(path, int(np.prod(points.shape[:-1])), limit)
    flat = np.array(points, dtype=np.float64).reshape(-1, points.shape[-1])
    normals = flat[:, 3:] if flat.shape[1] == 6 else None
    if "normals" in arrays:
        given = _array(path, "normals", arrays["normals"])
        if given.shape != points.shape or points.shape[-1] != 3:
            raise InputError(
                f"{path}: expected points and normals of one shape (N, 3), got {points.shape} and {given.shape}"
            )
        normals = np.array(given, dtype=np.float64).reshape(-1, 3)
    viewpoints = None
    if "viewpoints" in arrays:
        viewpoints = np.array(_array(path, "viewpoints", arrays["viewpoints"]), dtype=np.float64)
    return checked(Cloud(flat[:, :3], normals, viewpoints, str(path)), organised)


def _array(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    """`array`, if it holds numbers in the shape of points, (N, 3), (N, 6), (H, W, 3) or (H, W, 6)."""
    if array.dtype.kind not in "fiu":
        raise InputError(f"{path}: {name}: expected numbers, got {array.dtype}")
    if array.ndim not in (2, 3) or array.shape[-1] not in (3, 6):
        hint = "; a depth image? then give intrinsics" if array.ndim == 2 else ""
        raise InputError(f"{path}: {name}: expected shape (N, 3), (N, 6) or (H, W, 3), got {array.shape}{hint}")
    return array
