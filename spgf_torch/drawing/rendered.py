"""Things in space as a picture without a browser: one ray a sample (embree), one lamp and its shadow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from PIL import Image

from spgf_torch.drawing.style import LIGHT
from spgf_torch.sensing.cameras import Camera, look_at

PAPER = "#ffffff"  # where a ray meets nothing
SKY, LAMP = 0.55, 0.5  # light from everywhere, and from the lamp where a face looks at it
CLEAR = 1e-4  # m above a surface where a ray to the lamp begins: embree is float32


@dataclass(frozen=True)
class Solid:
    """A surface in one colour: vertices (V, 3) in the world, m; faces (F, 3)."""

    vertices: np.ndarray
    faces: np.ndarray
    colour: str

    def placed(self, T: np.ndarray) -> Solid:
        """The same, moved by T (4, 4)."""
        return Solid(self.vertices @ T[:3, :3].T + T[:3, 3], self.faces, self.colour)


def camera_at(eye: np.ndarray, target: np.ndarray, size: tuple[int, int], wide: float) -> Camera:
    """A camera of `size` (width, height) pixels at `eye` that sees `wide` m across at `target`; both (3,), m."""
    focal = size[0] * float(np.linalg.norm(eye - target)) / wide
    K = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    return Camera(K, look_at(eye, target), *size)


def rendered(solids: Sequence[Solid], camera: Camera, samples: int = 2) -> Image.Image:
    """The picture that a camera in the world sees, with `samples` rays along each side of a pixel."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    mesh = trimesh.Trimesh(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)]),
        process=False,
    )
    colours = np.concatenate([np.tile(to_rgb(solid.colour), (len(solid.faces), 1)) for solid in solids])
    fine = _finer(camera, samples)
    rays = fine.rays().reshape(-1, 3) @ fine.T_object_camera[:3, :3].T
    image = np.tile(to_rgb(PAPER), (len(rays), 1))
    face, hit, light = _light(mesh, fine.T_object_camera[:3, 3], rays)
    # A process has room for some thousand of embree's scenes: with this circle the mesh's would wait for the collector.
    del mesh.ray
    image[hit] = np.clip(colours[face] * light[:, None], 0, 1)
    image = image.reshape(camera.height, samples, camera.width, samples, 3).mean(axis=(1, 3))
    return Image.fromarray((255 * image).round().astype(np.uint8))


def _finer(camera: Camera, samples: int) -> Camera:
    """The camera with so many pixels in place of each, along each side."""
    K = camera.K.copy()
    K[:2] *= samples
    K[:2, 2] += (samples - 1) / 2
    return Camera(K, camera.T_object_camera, samples * camera.width, samples * camera.height)


def _light(mesh: trimesh.Trimesh, eye: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of rays (R, 3) from the eye that meet something: its face, the ray's number, and the light there."""
    face = mesh.ray.intersects_first(np.broadcast_to(eye, rays.shape), rays)
    hit = np.flatnonzero(face >= 0)
    face, rays = face[hit], rays[hit]
    normals, corner = mesh.face_normals[face], mesh.triangles[face, 0]
    along = np.einsum("rc,rc->r", normals, rays)
    normals = normals * -np.sign(along)[:, None]
    depth = np.einsum("rc,rc->r", normals, corner - eye) / np.minimum(-np.abs(along), -1e-9)
    bright = np.clip(normals @ LIGHT, 0, None)
    facing = np.flatnonzero(bright > 0)
    start = eye + depth[facing, None] * rays[facing] + CLEAR * normals[facing]
    shaded = mesh.ray.intersects_any(start, np.broadcast_to(LIGHT, start.shape))
    bright[facing[shaded]] = 0
    return face, hit, SKY + LAMP * bright
