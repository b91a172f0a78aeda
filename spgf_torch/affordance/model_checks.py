"""What is asked of the tensors of a model before they are taken: digest, names, shapes, numbers that can be."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import NUMBERS
from spgf_torch.errors import InputError
from spgf_torch.files.digests import check_seal, digest_of
from spgf_torch.files.reading import existing
from spgf_torch.geometry.se3_grid import SE3Grid

LARGEST_HEADER = 1_000_000  # bytes in which model.safetensors says what is in it
# Tensors of a model in the file; partitions were called slices when the format was made.
CONDENSED = {
    "slice_start": "partition_start",
    "cell": "cell",
    "probability": "probability",
    "support": "support",
    "base_rate": "base_rate",
}
TENSORS = ("centres", "calibration", *CONDENSED)
_LOWEST = {"cell": 0.0, "probability": 0.0, "support": 0.0, "base_rate": 0.0}
_HIGHEST = {"probability": 1.0, "base_rate": 1.0}


def check_digest(path: Path, digest: str | None) -> None:
    """Raises InputError for tensors that are damaged, of another `model.json`, or with a header made to hurt."""
    with existing(path).open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
    if length > LARGEST_HEADER:
        raise InputError(f"{path}: expected a safetensors file with a header of {LARGEST_HEADER} bytes, got {length}")
    if digest is not None and digest == digest_of(path):
        return
    if check_seal(path, "the tensors of a model") or digest is not None:
        raise InputError(f"{path}: expected the tensors that model.json beside it was written with, got others")


def check_shapes(path: Path, tensors: dict[str, Tensor], D: int, types: int) -> None:
    """Raises InputError where the tensors are not of so many grasp types, or centres do not have D numbers."""
    for name, tensor in tensors.items():
        whole = name in ("slice_start", "cell")
        if name in TENSORS and (tensor.is_floating_point() == whole or tensor.is_complex() or not tensor.ndim):
            raise InputError(f"{path}: expected {name} to hold {'whole ' * whole}numbers, got {tensor.dtype}")
    if tensors["centres"].ndim != 2 or tensors["centres"].shape[1] != D or not len(tensors["centres"]):
        raise InputError(f"{path}: expected centres of shape (K, {D}), got {tuple(tensors['centres'].shape)}")
    partitions, points = len(tensors["centres"]) * types, int(tensors["slice_start"].reshape(-1)[-1:].sum())
    expected: dict[str, tuple[int, ...]] = dict.fromkeys(("cell", "probability", "support"), (points,))
    expected |= {"slice_start": (partitions + 1,), "base_rate": (types,), "calibration": (types, len(NUMBERS))}
    for name, shape in expected.items():
        if tuple(tensors[name].shape) != shape:
            raise InputError(f"{path}: expected {name} of shape {shape}, got {tuple(tensors[name].shape)}")


def check_values(path: Path, tensors: dict[str, Tensor], grid: SE3Grid) -> None:
    """Raises InputError where numbers are none that were learned: they would point at nothing, or rank at random."""
    start, cell = tensors["slice_start"], tensors["cell"]
    if int(start[0]) != 0 or bool((start.diff() < 0).any()):
        raise InputError(f"{path}: expected slice_start to rise from 0, got other numbers")
    if len(cell) and int(cell.max()) >= grid.cells:
        raise InputError(f"{path}: expected cells below {grid.cells}, got {int(cell.max())}")
    falls = (cell.diff() <= 0).nonzero()[:, 0] + 1
    if not bool(torch.isin(falls, start).all()):  # they are searched
        raise InputError(f"{path}: expected cells to rise within a partition, got other numbers")
    for name in TENSORS:
        values = tensors[name]
        low, high = _LOWEST.get(name, -math.inf), _HIGHEST.get(name, math.inf)
        if values.numel() and not _finite_within(low, high, values):
            raise InputError(f"{path}: expected {name} finite and from {low:g} to {high:g}, got other numbers")


def _finite_within(low: float, high: float, values: Tensor) -> bool:
    """Whether all values are finite and from low to high, in one pass: NaN anywhere makes both extremes NaN."""
    least, most = (float(extreme) for extreme in torch.aminmax(values))
    return math.isfinite(least) and math.isfinite(most) and low <= least and most <= high
