"""Pinhole depth cameras around an object and what they see of a mesh, by ray casting (embree).

Camera frame: origin at the optical centre, +z forward, +x to the right and +y down in the image (as OpenCV and ROS).
Pixel (u, v) = (column, row), integers at pixel centres. Depth is the z coordinate in metres, 0 where nothing returns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from spgf_torch.sensing.config import SensingConfig

# A ray this close to lying within a face has no well-defined depth: 0.006 deg.
_PARALLEL = 1e-4


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        K: (3, 3) intrinsics in pixels: u = fx x/z + cx, v = fy y/z + cy.
        T_object_camera: (4, 4) pose, p_object = T_object_camera @ p_camera, m.
        width, height: of the image, pixels.
    """

    K: np.ndarray
    T_object_camera: np.ndarray
    width: int
    height: int

    def rays(self) -> np.ndarray:
        """(H, W, 3) float64, camera frame, z = 1: a pixel of depth z shows the point z * ray."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).astype(np.float64)
        return pixels @ np.linalg.inv(self.K).T


def intrinsics(config: SensingConfig) -> np.ndarray:
    """(3, 3) K with square pixels and the principal point in the middle of the image."""
    cx, cy = (config.width - 1) / 2, (config.height - 1) / 2
    return np.array([[config.focal, 0.0, cx], [0.0, config.focal, cy], [0.0, 0.0, 1.0]])


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) T_object_camera of a camera at `eye` that looks at `target` (both (3,), m), the image's down along -z.

    The line of sight must not be vertical.
    """
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = eye
    return T


def surround(config: SensingConfig, centre: np.ndarray) -> list[Camera]:
    """`config.cameras` cameras on a circle around `centre` (3,), evenly spread in azimuth, all looking at it."""
    azimuth = np.deg2rad(config.azimuth_deg) + 2 * np.pi * np.arange(config.cameras) / config.cameras
    elevation = np.full_like(azimuth, np.deg2rad(config.elevation_deg))
    outwards = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    K = intrinsics(config)
    eyes = centre + config.distance * outwards
    return [Camera(K, look_at(eye, centre), config.width, config.height) for eye in eyes]


def crop(camera: Camera, bounds: np.ndarray, margin: int) -> Camera:
    """The part of the image that an axis-aligned box can cover, with `margin` pixels around it.

    Casting and processing only these pixels saves most of the time where the object is small in the image.

    Args:
        camera: the camera whose image is cut; it is returned whole when a corner of the box is behind it.
        bounds: (2, 3) lowest and highest corner of the box, object frame, m.
        margin: pixels.
    """
    corners = trimesh.bounds.corners(bounds) - camera.T_object_camera[:3, 3]
    corners = corners @ camera.T_object_camera[:3, :3]
    if (corners[:, 2] <= 0).any():
        return camera
    pixels = (corners @ camera.K.T)[:, :2] / corners[:, 2:]
    last = np.array([camera.width - 1, camera.height - 1])
    low = np.clip(np.floor(pixels.min(axis=0)) - margin, 0, last).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + margin, low, last).astype(int)
    K = camera.K.copy()
    K[:2, 2] -= low
    width, height = high - low + 1
    return Camera(K, camera.T_object_camera, int(width), int(height))


def cast(mesh: trimesh.Trimesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """What an ideal camera sees of a mesh.

    Returns:
        depth: (H, W) float64, m, 0 = no return.
        cosine: (H, W) float64, of the angle of incidence: 1 where the surface faces the ray; 1 where nothing returns.
    """
    rays = camera.rays().reshape(-1, 3) @ camera.T_object_camera[:3, :3].T
    eye = camera.T_object_camera[:3, 3]
    face = mesh.ray.intersects_first(np.broadcast_to(eye, rays.shape), rays)
    hit = np.flatnonzero(face >= 0)
    normals, corner = mesh.face_normals[face[hit]], mesh.triangles[face[hit], 0]
    # embree finds the face in float32; the depth is that of the face's plane in float64.
    along = (normals * rays[hit]).sum(axis=1)
    facing = np.abs(along) / np.linalg.norm(rays[hit], axis=1)
    hit, normals, corner, along, facing = (a[facing > _PARALLEL] for a in (hit, normals, corner, along, facing))
    depth, cosine = np.zeros(len(rays)), np.ones(len(rays))
    depth[hit] = (normals * (corner - eye)).sum(axis=1) / along
    cosine[hit] = facing
    shape = (camera.height, camera.width)
    return depth.reshape(shape), cosine.reshape(shape)
