"""Mesh files: seen by the simulated cameras, or sampled whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from spgf_torch.config import CollisionConfig, InputError, SceneConfig, SensingConfig, settings
from spgf_torch.objects.mesh_files import mesh_arrays, ply_faces
from spgf_torch.objects.scans import METRES, SUFFIXES, read_mesh
from spgf_torch.reading import existing
from spgf_torch.scene.cloud import Cloud, check_count
from spgf_torch.scene.selection import check_extent
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.sense import observe
from spgf_torch.sensing.texlets import Texlets


def is_mesh(path: Path) -> bool:
    """Whether a file is to be read as a mesh: by its suffix, and a .ply by whether it has faces."""
    suffix = path.suffix.lower()
    return suffix in SUFFIXES and (suffix != ".ply" or ply_faces(existing(path)) > 0)


def sampled(path: Path, config: SceneConfig, generator: np.random.Generator) -> Cloud:
    """Points and normals on the whole surface of a mesh, in m, one a square of `config.mesh_pitch`.

    Raises:
        InputError: as `objects.scans.read_mesh`, which wants a closed mesh with its normals outwards.
    """
    sizes = settings(CollisionConfig, min_extent=config.min_extent, max_extent=config.max_extent)
    _load(path, config)  # the extent and its unit are told as for every other input
    mesh = read_mesh(path, config.unit, sizes)
    count = int(np.ceil(mesh.area / config.mesh_pitch**2))
    check_count(path, count, config.max_points)
    points, face = trimesh.sample.sample_surface(mesh, count, seed=generator)
    return Cloud(np.asarray(points), mesh.face_normals[face], None, str(path))


def sensed(
    path: Path, config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> tuple[Texlets, np.ndarray]:
    """What the simulated cameras around a mesh see of it, as in training.

    Returns:
        the texlets and the viewpoints (V, 3), m, both in the mesh's frame.

    Raises:
        InputError: an unreadable file, no faces, vertices that are not finite, an unlikely extent, a mesh that reaches
            the cameras.
    """
    mesh = _load(path, config)
    reach = float(np.linalg.norm(mesh.extents)) / 2
    if reach >= sensing.distance:
        raise InputError(
            f"{path}: expected a mesh within {sensing.distance:g} m of its middle, where the simulated cameras are "
            f"(sensing.distance), got {reach:.4g} m with unit={config.unit}; give a larger distance or mesh=whole"
        )
    cameras = surround(sensing, mesh.bounds.mean(axis=0))
    return observe(mesh, cameras, sensing, generator), np.array([c.T_object_camera[:3, 3] for c in cameras])


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
