"""Numbers in a URDF: finite, as many as there should be, else an error that names their place."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh

from spgf_torch.errors import InputError

XML = ElementTree.Element


def numbers(path: Path, where: str, text: str | None, count: int) -> np.ndarray:
    """(count,) float64 of an attribute; `where` says whose it is."""
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        words = "a finite number" if count == 1 else f"{count} finite numbers"
        raise InputError(f"{path}: {where}: expected {words}, got {text or 'none'}")
    return values


def number(path: Path, where: str, text: str | None) -> float:
    return float(numbers(path, where, text, 1)[0])


def pose(path: Path, where: str, origin: XML | None) -> np.ndarray:
    """(4, 4) float64 of an `<origin>`; the identity where there is none."""
    if origin is None:
        return np.eye(4)
    T = np.asarray(trimesh.transformations.euler_matrix(*numbers(path, where, origin.get("rpy", "0 0 0"), 3)))
    T[:3, 3] = numbers(path, where, origin.get("xyz", "0 0 0"), 3)
    return T
