"""The record that sub-packages share: one rigid object, its surface, its collision pieces and its mass."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh


@dataclass(frozen=True)
class GraspObject:
    """A rigid object in its own frame (m, kg; z up, base at z = 0 for shipped objects).

    Attributes:
        name: unique in its set; letters, digits, `_` and `-`.
        category: one of `config.CLASSES`.
        mesh: watertight outer and inner surface, normals outwards.
        parts: convex collision pieces, each the (V, 3) float64 vertices of its hull.
        mass: kg.
        com: (3,) centre of mass, m.
        inertia: (3, 3) about the centre of mass, kg m2.
    """

    name: str
    category: str
    mesh: trimesh.Trimesh
    parts: tuple[np.ndarray, ...]
    mass: float
    com: np.ndarray
    inertia: np.ndarray

    @cached_property
    def digest(self) -> str:
        """SHA-256 over everything that a trial's outcome depends on, rounded to a nanometre."""
        sha = hashlib.sha256(f"{self.name}|{self.category}|{self.mass:.9g}".encode())
        for array in (self.mesh.vertices, *self.parts, self.com, self.inertia * 1e6):
            sha.update(np.round(np.asarray(array, dtype=np.float64) * 1e9).astype(np.int64).tobytes())
        sha.update(np.asarray(self.mesh.faces, dtype=np.int64).tobytes())
        return sha.hexdigest()
