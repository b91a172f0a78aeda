"""What the simulated cameras see of an object."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.geometry.ray_scenes import forget_scene
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing.cameras import Camera, cast, crop, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.sensing.texlets import Texlets, extract
from spgf_torch.sensing.unseen import DepthView, whole_image

# m over a table from which on a point is the object's: four standard deviations of a Kinect at 1 m.
ABOVE = 0.008
# m; side of the table: a hand about the object never leaves it.
TABLE = 1.2


def sense(obj: GraspObject, config: SensingConfig, seed: int) -> Texlets:
    """Texlets of an object as the configured cameras around it see it, noise included.

    The cameras look at the centre of the mesh's bounding box. The result depends on the object, the config and the
    seed alone, not on what was sensed before.

    Raises:
        InputError: nothing of the object is seen.
    """
    generator = np.random.default_rng([seed, zlib.crc32(obj.name.encode())])
    texlets = observe(obj.mesh, surround(config, obj.mesh.bounds.mean(axis=0)), config, generator)
    forget_scene(obj.mesh)
    if not len(texlets):
        raise InputError(f"{obj.name}: expected at least one texlet, got none; extents {obj.mesh.extents} m")
    return texlets


def observe(
    mesh: trimesh.Trimesh, cameras: Sequence[Camera], config: SensingConfig, generator: np.random.Generator
) -> Texlets:
    """Texlets of a mesh as seen from `cameras`, whose poses are in the mesh's frame."""
    return extract(_images(mesh, cameras, config, generator), config, generator)


def observe_views(
    mesh: trimesh.Trimesh, cameras: Sequence[Camera], config: SensingConfig, generator: np.random.Generator
) -> tuple[Texlets, tuple[DepthView, ...]]:
    """The same texlets, and the images that they were taken from."""
    images = _images(mesh, cameras, config, generator)
    views = [
        DepthView.of(whole_image(depth, part, camera), camera)
        for (depth, part), camera in zip(images, cameras, strict=True)
    ]
    return extract(images, config, generator), tuple(views)


def observe_on_table(
    mesh: trimesh.Trimesh, cameras: Sequence[Camera], config: SensingConfig, generator: np.random.Generator
) -> tuple[Texlets, tuple[DepthView, ...]]:
    """Texlets of a mesh that stands on a table at its lowest z, what is more than `ABOVE` over it; and the images."""
    level = float(mesh.bounds[0, 2])
    both: trimesh.Trimesh = trimesh.util.concatenate([mesh, _table(mesh)])  # type: ignore[assignment]
    images, views = [], []
    for camera in cameras:
        depth, cosine = cast(both, camera)
        depth = measure(depth, cosine, camera.K[0, 0], config, generator)
        views.append(DepthView.of(depth, camera))
        T = camera.T_object_camera
        z = (camera.rays() @ T[2, :3]) * depth + T[2, 3]
        images.append((np.where(z > level + ABOVE, depth, 0.0), camera))
    return extract(images, config, generator), tuple(views)


def _table(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A square of `TABLE` m under a mesh."""
    half = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * TABLE / 2
    middle = [*mesh.bounds.mean(axis=0)[:2], mesh.bounds[0, 2]]
    return trimesh.Trimesh(half + middle, [[0, 1, 2], [0, 2, 3]], process=False)


def _images(
    mesh: trimesh.Trimesh, cameras: Sequence[Camera], config: SensingConfig, generator: np.random.Generator
) -> list[tuple[np.ndarray, Camera]]:
    """The depth image (H, W) of each camera, m, cut to what the mesh can cover, and the camera of that part."""
    images = []
    for camera in cameras:
        # Room for the outline to move by four standard deviations, and one more for the rounding of the box.
        part = crop(camera, mesh.bounds, margin=int(np.ceil(4 * config.lateral_px)) + 1)
        depth, cosine = cast(mesh, part)
        images.append((measure(depth, cosine, part.K[0, 0], config, generator), part))
    return images
