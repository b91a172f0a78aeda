"""Candidate grasps on an object's surface (docs/design/simulation.md): no filter, no knowledge of success."""

from __future__ import annotations

import numpy as np
import torch
import trimesh
from scipy.spatial.transform import Rotation
from torch import Tensor

from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.config import APPROACH, SURFACE_PAIRS, SamplerConfig
from spgf_torch.simulation.table import pose_matrix

SKIN = 1e-5  # m that a ray starts below the surface, so that it does not hit the face it leaves (embree is float32)


def sample_candidates(
    obj: GraspObject, count: int, config: SamplerConfig, rng: np.random.Generator, sampler: str = SURFACE_PAIRS
) -> Tensor:
    """T_object_tcp (count, 4, 4) float32, each rebuilt from the float32 pose that the trial table stores."""
    return pose_matrix(*sample_poses(obj, count, config, rng, sampler))


def sample_poses(
    obj: GraspObject, count: int, config: SamplerConfig, rng: np.random.Generator, sampler: str = SURFACE_PAIRS
) -> tuple[Tensor, Tensor]:
    """Position (count, 3) and quaternion wxyz (count, 4), float32, of T_object_tcp, by a sampler of `SAMPLERS`.

    Of each, a rotation vector and a shift are drawn, normal in each coordinate with standard deviations `jitter_deg`
    and `jitter`.
    """
    centres, axes = SAMPLERS[sampler](obj, count, config, rng)
    jitter = rng.normal(0, np.radians(config.jitter_deg), (count, 3))
    shift = rng.normal(0, config.jitter, (count, 3))
    rotation = Rotation.from_rotvec(jitter) * Rotation.from_matrix(axes)
    quaternion = rotation.as_quat(canonical=True, scalar_first=True)
    return torch.from_numpy((centres + shift).astype(np.float32)), torch.from_numpy(quaternion.astype(np.float32))


def surface_pairs(
    obj: GraspObject, count: int, config: SamplerConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """For fingers that close on opposite places: origin (count, 3) and axes (count, 3, 3) of TCP frames, as columns.

    A surface point p (uniform by area) with normal n; closing axis +-n; TCP midway from p to where the ray along -n
    first leaves the object; approach uniform around n, turned round where it would come from inside.
    """
    points, faces = trimesh.sample.sample_surface(obj.mesh, count, seed=int(rng.integers(2**63)))
    normals = obj.mesh.face_normals[faces]
    centres = points - normals * (_thickness(obj.mesh, points, normals) / 2)[:, None]
    closing = normals * rng.choice([-1.0, 1.0], count)[:, None]
    approach = _perpendicular(normals, rng)
    outwards = np.einsum("ij,ij->i", approach, centres - obj.com) > 0
    approach[outwards] *= -1
    return centres, np.stack([closing, np.cross(approach, closing), approach], axis=-1)


def approaches(
    obj: GraspObject, count: int, config: SamplerConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """For hands that close around what they approach: origin (count, 3) and axes (count, 3, 3), as columns.

    A surface point p (uniform by area) with normal n; approach -n; closing axis uniform around it; TCP 0 to `depth`
    below p, uniform.
    """
    points, faces = trimesh.sample.sample_surface(obj.mesh, count, seed=int(rng.integers(2**63)))
    normals = obj.mesh.face_normals[faces]
    closing = _perpendicular(normals, rng)
    centres = points - normals * rng.uniform(0, config.depth, count)[:, None]
    return centres, np.stack([closing, np.cross(-normals, closing), -normals], axis=-1)


SAMPLERS = {SURFACE_PAIRS: surface_pairs, APPROACH: approaches}


def _thickness(mesh: trimesh.Trimesh, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(M,) distance along -normal to the next surface; 0 where the ray slips through a crack between faces."""
    origins = points - SKIN * normals
    hits, rays, _ = mesh.ray.intersects_location(origins, -normals, multiple_hits=False)
    distance = np.zeros(len(points))
    distance[rays] = np.linalg.norm(hits - points[rays], axis=1)
    return distance


def _perpendicular(normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(M, 3) unit vectors, uniform on the circle around each normal."""
    vectors = rng.normal(size=normals.shape)
    vectors -= np.einsum("ij,ij->i", vectors, normals)[:, None] * normals
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
