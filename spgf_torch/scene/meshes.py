"""Mesh files: seen by the simulated cameras, or sampled whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays, ply_faces
from spgf_torch.files.reading import existing
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.scans import METRES, SUFFIXES, read_mesh
from spgf_torch.scene.cloud import Cloud, check_count, checked
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.files import read_clouds
from spgf_torch.scene.one_view import seen_from
from spgf_torch.scene.target_selection import check_extent
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe_views
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView
from spgf_torch.settings import settings

# m; a mesh whose reach is less in some unit is not likely to be of that unit.
_SMALL = 0.01


def is_mesh(path: Path, config: SceneConfig) -> bool:
    """Whether a file has faces, or may have: by its suffix, and a .ply by what its header declares."""
    suffix = path.suffix.lower()
    faces = suffix in SUFFIXES and (suffix != ".ply" or ply_faces(existing(path)) > 0)
    if config.read_as == "mesh" and not faces:
        raise InputError(f"{path}: expected a mesh with faces (as=mesh), got a file without")
    return faces


def as_cloud(path: Path, config: SceneConfig) -> Cloud | None:
    """The vertices of a mesh file, m, where its surface is that of one view, as cameras write it; None for a CAD mesh.

    Cameras join neighbouring pixels: the surface is open, and all of its faces are seen from one place.
    `config.read_as` overrules it.
    """
    if config.read_as == "mesh" or (config.read_as == "auto" and config.mesh == "whole"):
        return None
    if config.read_as == "cloud":
        return _vertices(path, config)
    eye = seen_from(*mesh_arrays(path))
    if eye is None:
        return None
    found = _vertices(path, config)
    where = "the origin" if not eye.any() else f"the side of ({', '.join(f'{v:.3f}' for v in eye)})"
    note = f"taken for the cloud of one view: an open surface that is seen whole from {where}; as=mesh says otherwise"
    viewpoints = found.viewpoints if found.viewpoints is not None else METRES[config.unit] * eye[None]
    return replace(found, viewpoints=viewpoints, notes=(*found.notes, note))


def _vertices(path: Path, config: SceneConfig) -> Cloud:
    """The vertices as a cloud in m; of a .ply with the normals that it has."""
    if path.suffix.lower() == ".ply":
        return read_clouds([path], config)[0]
    vertices, _ = mesh_arrays(path)
    check_count(path, len(vertices), config.max_points)
    return checked(Cloud(np.unique(vertices, axis=0), None, None, str(path))).scaled(METRES[config.unit])


def sampled(path: Path, config: SceneConfig, generator: np.random.Generator) -> Cloud:
    """Points and normals on the whole surface of a mesh, in m, one a square of `config.mesh_pitch`.

    Raises:
        InputError: as `objects.scans.read_mesh`, which wants a closed mesh with its normals outwards.
    """
    sizes = settings(CollisionConfig, min_extent=config.min_extent, max_extent=config.max_extent)
    _load(path, config)  # the extent and its unit are noted as for every other input
    mesh = read_mesh(path, config.unit, sizes)
    count = int(np.ceil(mesh.area / config.mesh_pitch**2))
    if count > config.mesh_samples:
        raise InputError(
            f"{path}: expected a surface of at most {config.mesh_samples} samples (mesh_samples) "
            f"{config.mesh_pitch:g} m apart, got {count}; another unit, a larger mesh_pitch, or mesh=sensed"
        )
    points, face = trimesh.sample.sample_surface(mesh, count, seed=generator)
    return Cloud(np.asarray(points), mesh.face_normals[face], None, str(path))


def sensed(
    path: Path, config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> tuple[Texlets, np.ndarray, tuple[DepthView, ...]]:
    """What the simulated cameras around a mesh see of it, as in training.

    Returns:
        the texlets, the viewpoints (V, 3), m, and the cameras' images, all in the mesh's frame.

    Raises:
        InputError: an unreadable file, no faces, vertices that are not finite, an unlikely extent, a mesh that reaches
            the cameras.
    """
    mesh = _load(path, config)
    reach = float(np.linalg.norm(mesh.extents)) / 2
    if reach >= sensing.distance:
        smaller = [unit for unit, m in METRES.items() if m * reach / METRES[config.unit] < sensing.distance]
        hint = "".join(f"unit={unit}, " for unit in smaller if METRES[unit] * reach / METRES[config.unit] > _SMALL)
        raise InputError(
            f"{path}: expected a mesh within {sensing.distance:g} m of its middle, where the simulated cameras are, "
            f"got {reach:.4g} m with unit={config.unit}; {hint}mesh=whole, or as=cloud if it is a camera's"
        )
    cameras = surround(sensing, mesh.bounds.mean(axis=0))
    texlets, views = observe_views(mesh, cameras, sensing, generator)
    return texlets, np.array([c.T_object_camera[:3, 3] for c in cameras]), views


def _load(path: Path, config: SceneConfig) -> trimesh.Trimesh:
    """The mesh in a file, open or closed, in m, of the extent of a scene."""
    vertices, faces = mesh_arrays(path)
    if not len(faces):
        raise InputError(f"{path}: expected a mesh with faces, got none")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(f"{path}: expected finite vertices, got {bad} of {len(vertices)} with NaN or infinity")
    mesh = trimesh.Trimesh(vertices * METRES[config.unit], faces, process=False)
    check_extent(str(path), mesh.bounds[0], mesh.bounds[1], config)
    return mesh
