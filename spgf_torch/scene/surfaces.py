"""What a depth image shows of each target, as oriented points, and of the rest, as points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.scene.cloud import Cloud, voxel_means
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth import every, learned_stride, pixel_points, surface
from spgf_torch.scene.target_selection import crop_box, within
from spgf_torch.scene.views import View
from spgf_torch.sensing.config import SensingConfig


def surfaces(view: View, stride: int, config: SceneConfig, sensing: SensingConfig) -> list[Cloud]:
    """The oriented surface points of each target of one depth image, and the points of the rest without normals."""
    depth, camera = every(view.depth, view.camera, stride)
    if view.labels is None:
        return [surface(depth, camera, sensing, view.name)]
    labels, parts = view.labels[::stride, ::stride], []
    for label in np.unique(labels[labels > 0]):
        part = surface(np.where(labels == label, depth, 0.0), camera, sensing, view.name)
        parts.append(replace(part, labels=np.full(len(part), label, np.int32)))
    rest = (labels <= 0) & np.isfinite(depth) & (depth > 0)
    points = pixel_points(depth, camera)[rest]
    eye = camera.T_object_camera[None, :3, 3]
    thinned = voxel_means(Cloud(points), config.voxel).points if len(points) else points
    return [*parts, Cloud(thinned, None, eye, view.name, np.zeros(len(thinned), np.int32))]


def stride_of(view: View, config: SceneConfig, sensing: SensingConfig) -> int:
    """The stride that is set, or the one that suits the target's pixels in the crop box."""
    if config.stride is not None:
        if config.stride < 1:
            raise InputError(f"stride: expected a whole number from 1, got {config.stride}")
        return config.stride
    depth = np.where(np.isfinite(view.depth), view.depth, 0.0)
    returned = depth > 0
    if view.labels is not None and (returned & (view.labels > 0)).any():
        returned &= view.labels > 0
    inside = returned & within(pixel_points(depth, view.camera), crop_box(config))
    matter = depth[inside] if inside.any() else depth[returned]
    return learned_stride(matter, view.camera.K, sensing) if len(matter) else 1
