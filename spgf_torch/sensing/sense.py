"""What the simulated cameras see of an object."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import trimesh

from spgf_torch.config import InputError, SensingConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing.cameras import Camera, cast, crop, surround
from spgf_torch.sensing.noise import measure
from spgf_torch.sensing.texlets import Texlets, extract


def sense(obj: GraspObject, config: SensingConfig, seed: int) -> Texlets:
    """Texlets of an object as the configured cameras around it see it, noise included.

    The cameras look at the centre of the mesh's bounding box. The result depends on the object, the config and the
    seed alone, not on what was sensed before.

    Raises:
        InputError: nothing of the object is seen.
    """
    generator = np.random.default_rng([seed, zlib.crc32(obj.name.encode())])
    texlets = observe(obj.mesh, surround(config, obj.mesh.bounds.mean(axis=0)), config, generator)
    if not len(texlets):
        raise InputError(f"{obj.name}: expected at least one texlet, got none; extents {obj.mesh.extents} m")
    return texlets


def observe(
    mesh: trimesh.Trimesh, cameras: Sequence[Camera], config: SensingConfig, generator: np.random.Generator
) -> Texlets:
    """Texlets of a mesh as seen from `cameras`, whose poses are in the mesh's frame."""
    views = []
    for camera in cameras:
        # Room for the outline to move by four standard deviations, and one more for the rounding of the box.
        part = crop(camera, mesh.bounds, margin=int(np.ceil(4 * config.lateral_px)) + 1)
        depth, cosine = cast(mesh, part)
        views.append((measure(depth, cosine, part.K[0, 0], config, generator), part))
    return extract(views, config, generator)
