"""The input of Contact-GraspNet (`spgf_torch.clearing.contact_graspnet`) for a cloud that ours sees of one object."""

from __future__ import annotations

import zlib

import numpy as np
import torch
import trimesh

from spgf_torch.clearing.contact_graspnet import Raw, back_projected, in_cube
from spgf_torch.judging.clouds import Cloud
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing import sense
from spgf_torch.sensing.cameras import Camera, cast, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.sensing.unseen import DepthView, whole_image


def raw_cloud(obj: GraspObject, sensing: SensingConfig, cloud: Cloud, seed: int) -> Raw:
    """The points behind `cloud`, which is `seen_as(obj, sensing, cloud.on_table, seed)`: rendered again, table and all.

    On a table what is higher than `sense.ABOVE` over it is the object's, as for ours; else everything is.
    Raises RuntimeError where the images are not those that ours saw.
    """
    images = _images(obj.mesh, sensing, cloud.on_table, np.random.default_rng([seed, zlib.crc32(obj.name.encode())]))
    whole = surround(sensing, obj.mesh.bounds.mean(axis=0))
    for (depth, part), camera, view in zip(images, whole, cloud.seen.views, strict=True):
        if not torch.equal(DepthView.of(whole_image(depth, part, camera), camera).depth, view.depth):
            raise RuntimeError(f"{obj.name}: the images rendered again are not those that were sensed")
    points = np.concatenate([back_projected(depth, camera) for depth, camera in images])
    level = float(obj.mesh.bounds[0, 2]) + sense.ABOVE
    on_object = points[:, 2] > level if cloud.on_table else np.ones(len(points), bool)
    near = in_cube(points, cloud.seen.texlets.positions.numpy())
    return Raw(points[near].astype(np.float32), on_object[near])


def _images(
    mesh: trimesh.Trimesh, sensing: SensingConfig, on_table: bool, rng: np.random.Generator
) -> list[tuple[np.ndarray, Camera]]:
    """Depth images (H, W), m, and cameras, as `sense.observe_on_table` and `observe_views` make them first of all."""
    cameras = surround(sensing, mesh.bounds.mean(axis=0))
    if not on_table:
        return sense._images(mesh, cameras, sensing, rng)
    both = trimesh.util.concatenate([mesh, sense._table(mesh)])
    return [(measure(*cast(both, camera), camera.K[0, 0], sensing, rng), camera) for camera in cameras]
