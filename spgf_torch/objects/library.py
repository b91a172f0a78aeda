"""The described objects: one small YAML file each, read into `GraspObject`s."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from omegaconf import MISSING

from spgf_torch.errors import InputError
from spgf_torch.files.reading import yaml_values
from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.lofts import Solid
from spgf_torch.objects.manifest import check_name
from spgf_torch.objects.shapes import SHAPES
from spgf_torch.settings import bounded, choice, text, typed

MERGE = 1e-9  # m; corners closer than this are one


@dataclass
class Description:
    """One file of `data/objects`; `dimensions` are those of the shape (see `shapes`), in metres."""

    name: str = text()
    category: str = choice(*CLASSES)
    mass: float = bounded(0.001, 5.0)
    shape: str = choice(*SHAPES)
    dimensions: dict[str, Any] = field(default=MISSING)


def load_objects(folder: Path) -> list[GraspObject]:
    """All objects described in a folder, sorted by name.

    Raises InputError in one line naming the file and key for a missing or empty folder, a description that cannot
    be read, a missing or unknown key, a value out of range, or two objects of one name.
    """
    files = sorted(Path(folder).glob("*.yaml"))
    if not files:
        raise InputError(f"{folder}: expected a folder with object descriptions (*.yaml), got none")
    objects: dict[str, GraspObject] = {}
    for file in files:
        described = load_object(file)
        if described.name in objects:
            raise InputError(f"{file}: name: expected a name of its own, got {described.name} a second time")
        objects[described.name] = described
    return [objects[name] for name in sorted(objects)]


def load_object(file: Path) -> GraspObject:
    """One described object; raises InputError as `load_objects` does."""
    values = yaml_values(file, "a YAML description")
    if not isinstance(values, dict):
        raise InputError(f"{file}: expected a mapping with name, category, mass, shape, dimensions; got {values!r}")
    try:
        return build(typed(Description, values))
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def build(description: Description) -> GraspObject:
    """Build the object of a description: uniform density, so that mesh and mass give the inertia."""
    check_name(description.name, "name")
    solid = typed(SHAPES[description.shape], description.dimensions).solid()
    mesh = mesh_of(solid)
    mesh.density = description.mass / mesh.volume
    return GraspObject(
        name=description.name,
        category=description.category,
        mesh=mesh,
        parts=solid.parts,
        mass=description.mass,
        com=np.array(mesh.center_mass),
        inertia=np.array(mesh.moment_inertia),
    )


def mesh_of(solid: Solid) -> trimesh.Trimesh:
    """The surface as an indexed mesh: equal corners merged, triangles that shrank to a line (at a pole) dropped."""
    corners = solid.triangles.reshape(-1, 3)
    _, first, index = np.unique(np.round(corners / MERGE), axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1, 3)
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return trimesh.Trimesh(corners[first], faces[proper], process=False)
