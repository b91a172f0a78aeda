"""From the files that the settings name to texlets, the points around them and the table."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from spgf_torch.config import InputError, SceneConfig, SensingConfig
from spgf_torch.scene.cloud import Cloud, checked, vectors, voxel_means
from spgf_torch.scene.depth import every, learned_stride, pixel_points, surface
from spgf_torch.scene.depth_files import is_depth
from spgf_torch.scene.files import read_clouds
from spgf_torch.scene.meshes import is_mesh, sampled, sensed
from spgf_torch.scene.normals import neighbourhoods, oriented
from spgf_torch.scene.selection import crop_box, cropped, viewpoints_of, within, without_table
from spgf_torch.scene.views import View, files_of, read_views
from spgf_torch.sensing.cameras import Camera
from spgf_torch.sensing.texlets import Texlets, thin

# Points further apart than this much of the texlets' spacing leave many a texlet with one point, which then must do.
_SPARSE = 0.85
# m; texlets and grasps are float32, exact to 0.03 mm there.
_FAR = 1000.0


@dataclass(frozen=True)
class Scene:
    """What was sensed, in the input's frame.

    Attributes:
        texlets: for the model.
        points: (M, 3) float32, m: what a hand must not touch, one a voxel; without the table.
        plane: (4,) float64 a, b, c, d of the removed table, a x + b y + c z + d the height above it in m; or None.
        viewpoints: (V, 3) float64, m, from where it was seen; None where not known.
        notes: what was removed, a line each.
    """

    texlets: Texlets
    points: torch.Tensor
    plane: np.ndarray | None
    viewpoints: np.ndarray | None
    notes: tuple[str, ...]


def read_scene(config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator) -> Scene:
    """The scene in the files that `config.input` names: point clouds, depth images (with `intrinsics`) or a mesh.

    Args:
        sensing: how texlets are extracted and thinned: that of the model. A mesh is sensed by its cameras.
        generator: source of all randomness.

    Raises:
        InputError, which names the file or setting, for whatever cannot be used.
    """
    if not config.input:
        raise InputError("input: expected a point cloud, depth image or mesh (input=FILE), got none")
    paths = files_of("input", config.input)
    if any(is_depth(path, config) for path in paths):
        _unused(config, "viewpoints", "point clouds")
        return scene_of_views(read_views(paths, config), config, sensing, generator)
    for key in ("poses", "stride"):
        _unused(config, key, "depth images, which need intrinsics")
    meshes = [path for path in paths if is_mesh(path)]
    if not meshes:
        clouds = read_clouds(paths, config)
        return scene_of_clouds(clouds, config, sensing, generator)
    if len(paths) > 1:
        raise InputError(f"input: expected one mesh or several clouds, got {len(meshes)} meshes in {len(paths)} files")
    for key in ("viewpoints", "mask", "segments"):
        _unused(config, key, "point clouds" if key == "viewpoints" else "point clouds and depth images")
    return _scene_of_mesh(meshes[0], config, sensing, generator)


def texlets_of(cloud: Cloud, config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator) -> Texlets:
    """The texlets of one point cloud in m; see `scene_of_clouds`. What that warns of is a UserWarning here."""
    scene = scene_of_clouds([cloud], config, sensing, generator)
    for note in scene.notes:
        if note.startswith("warning: "):
            warnings.warn(note.removeprefix("warning: "), stacklevel=2)
    return scene.texlets


def scene_of_clouds(
    clouds: Sequence[Cloud], config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> Scene:
    """The scene that point clouds in m, one frame, show together, such as those of a live camera.

    Each is cropped, thinned by voxels, freed from the table and from outliers, and given normals where it has none,
    turned to its own viewpoints (or to `config.viewpoints`); then all are thinned to texlets together.
    """
    if config.viewpoints is not None:
        viewpoints = vectors("viewpoints", config.viewpoints, (None, 3))
        clouds = [replace(cloud, viewpoints=viewpoints) for cloud in clouds]
    clouds = [checked(cloud) for cloud in clouds]
    read = sum(map(len, clouds))
    clouds, notes = cropped(clouds, config)
    _check_near(clouds)
    clouds = [voxel_means(cloud, config.voxel) for cloud in clouds]
    notes.append(f"voxels of {config.voxel:g} m: {sum(map(len, clouds))} points of {read}")
    clouds, plane = without_table(clouds, config, generator, notes)
    before = sum(map(len, clouds))
    clouds = [oriented(cloud, config, notes) for cloud in clouds]
    dropped = before - sum(map(len, clouds))
    if 2 * dropped > before:
        raise InputError(
            f"{clouds[0].name}: expected most points to have {config.min_neighbours} others of their side within "
            f"{config.normal_radius:g} m, got {dropped / before:.0%} with fewer; give a larger normal_radius"
        )
    notes.append(f"outliers: {dropped} of {before} points dropped")
    _, apart = neighbourhoods(
        np.concatenate([cloud.points for cloud in clouds]), config.min_neighbours, sensing.spacing
    )
    if apart > _SPARSE * sensing.spacing:
        sensing = replace(sensing, min_members=1)
    return _thinned(clouds, plane, notes, config, sensing, generator)


def scene_of_views(
    views: Sequence[View], config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> Scene:
    """The scene that depth images show together, in the frame of their cameras' poses.

    The surface points are those of `sensing.texlets.extract`; crop and table removal act on them.
    """
    clouds, strides = [], []
    for view in views:
        depth, camera = view.depth, view.camera
        if depth.shape != (camera.height, camera.width):
            raise InputError(f"{view.name}: expected {camera.height} x {camera.width} pixels, got {depth.shape}")
        if view.labels is not None:
            depth = np.where(view.labels > 0, depth, 0.0)
        strides.append(_stride(depth, camera, config, sensing))
        clouds.append(surface(*every(depth, camera, strides[-1]), sensing, view.name))
    if not any(map(len, clouds)):
        raise InputError(
            f"input: expected surfaces of {sensing.window} x {sensing.window} pixels in the depth images, got none"
        )
    clouds, notes = cropped(clouds, config)
    notes.insert(0, f"stride: every {', '.join(map(str, strides))} pixels of the depth images")
    clouds, plane = without_table(clouds, config, generator, notes)
    return _thinned(clouds, plane, notes, config, sensing, generator)


def _stride(depth: np.ndarray, camera: Camera, config: SceneConfig, sensing: SensingConfig) -> int:
    """The stride that is set, or the one that suits the pixels in the crop box."""
    if config.stride is not None:
        if config.stride < 1:
            raise InputError(f"stride: expected a whole number from 1, got {config.stride}")
        return config.stride
    depth = np.where(np.isfinite(depth), depth, 0.0)
    returned = depth > 0
    inside = returned & within(pixel_points(depth, camera), crop_box(config))
    matter = depth[inside] if inside.any() else depth[returned]
    return learned_stride(matter, camera.K, sensing) if len(matter) else 1


def _scene_of_mesh(path: Path, config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator) -> Scene:
    if config.mesh == "whole":
        clouds, notes = cropped([sampled(path, config, generator)], config)
        clouds, plane = without_table(clouds, config, generator, notes)
        return _thinned(clouds, plane, notes, config, sensing, generator)
    texlets, viewpoints = sensed(path, config, sensing, generator)
    points, normals = texlets.positions.double().numpy(), texlets.normals.double().numpy()
    if not len(points):
        raise InputError(f"{path}: expected a mesh that the cameras see, got no texlet")
    clouds, notes = cropped([Cloud(points, normals, viewpoints, str(path))], config)
    clouds, plane = without_table(clouds, config, generator, notes)
    kept = clouds[0]
    return Scene(_texlets(kept), torch.from_numpy(kept.points).float(), plane, viewpoints, tuple(notes))


def _thinned(
    clouds: Sequence[Cloud],
    plane: np.ndarray | None,
    notes: list[str],
    config: SceneConfig,
    sensing: SensingConfig,
    generator: np.random.Generator,
) -> Scene:
    """The scene of oriented clouds together."""
    points = np.concatenate([cloud.points for cloud in clouds])
    normals = np.concatenate([cloud.normals for cloud in clouds if cloud.normals is not None])
    texlets = thin(points, normals, sensing, generator)
    if not len(texlets):
        raise InputError(
            f"input: expected {sensing.min_members} points a texlet, got fewer everywhere in {len(points)}"
        )
    solid = torch.from_numpy(voxel_means(Cloud(points), config.voxel).points).float()
    return Scene(texlets, solid, plane, viewpoints_of(clouds), tuple(notes))


def _texlets(cloud: Cloud) -> Texlets:
    assert cloud.normals is not None
    return Texlets(torch.from_numpy(cloud.points).float(), torch.from_numpy(cloud.normals).float())


def _check_near(clouds: Sequence[Cloud]) -> None:
    """Raises InputError where most points are so far from the origin that texlets would be rounded."""
    for cloud in clouds:
        away = float(np.abs(np.median(cloud.points, axis=0)).max(initial=0)) if len(cloud) else 0.0
        if away > _FAR:
            raise InputError(
                f"{cloud.name}: expected points within {_FAR:g} m of the origin, got {away:.4g} m; subtract an offset"
            )


def _unused(config: SceneConfig, key: str, what: str) -> None:
    if getattr(config, key) is not None:
        raise InputError(f"{key}: expected with {what} only, got {getattr(config, key)!r} for another input")
