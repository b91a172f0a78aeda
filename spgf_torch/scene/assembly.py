"""From clouds, depth images or a mesh to a scene, step by step: targets, table, normals, texlets, obstacles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from spgf_torch.errors import InputError
from spgf_torch.scene.cloud import Cloud, checked, vectors, voxel_means
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.degenerate_clouds import why_no_grasp
from spgf_torch.scene.depth_files import is_depth
from spgf_torch.scene.files import read_clouds
from spgf_torch.scene.gravity import gravity_of
from spgf_torch.scene.meshes import as_cloud, is_mesh, sampled, sensed
from spgf_torch.scene.normals import neighbourhoods, oriented
from spgf_torch.scene.observed_space import looked_by_cameras, looked_by_clouds, looked_by_images, looked_by_nobody
from spgf_torch.scene.parts import Around, scene_of_parts, thinned
from spgf_torch.scene.planes import LargestPlane, height
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.sensed import sensed_of
from spgf_torch.scene.surfaces import stride_of, surfaces
from spgf_torch.scene.target_selection import is_target, table_of, targeted, viewpoints_of
from spgf_torch.scene.unit_checks import check_depth_image, size_notes, unusual_depth
from spgf_torch.scene.viewpoint import ahead_of, check_side, with_viewpoint
from spgf_torch.scene.views import View, files_of, read_views
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.texlets import Texlets

# Points further apart than this much of the texlets' spacing leave many a texlet with one point, which then must do.
_SPARSE = 0.85
# m; texlets and grasps are float32, exact to 0.03 mm there.
_FAR = 1000.0


def read_scene(config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator) -> Scene:
    """The scene in the files that `config.input` names: point clouds, depth images (with `intrinsics`) or a mesh.

    Args:
        sensing: how texlets are extracted and thinned: that of the model. A mesh is sensed by its cameras.
        generator: source of all randomness.

    Raises:
        InputError: which names the file or setting, for whatever cannot be used.
    """
    if not config.input:
        raise InputError("input: expected a point cloud, depth image or mesh (input=FILE), got none")
    paths = files_of("input", config.input)
    if any(is_depth(path, config) for path in paths):
        views = read_views(paths, config)  # first: what is no depth image is told by its name
        _unused(config, "viewpoints", "point clouds")
        return scene_of_views(views, config, sensing, generator)
    for key in ("poses", "stride", "depth_scale"):
        _unused(config, key, "depth images, which need intrinsics")
    meshes = [path for path in paths if is_mesh(path, config)]
    if len(meshes) == 1 == len(paths) and (cloud := as_cloud(meshes[0], config)) is not None:
        return scene_of_clouds([cloud], config, sensing, generator)
    if not meshes:
        return scene_of_clouds(read_clouds(paths, config), config, sensing, generator)
    if len(paths) > 1:
        clouds = [as_cloud(path, config) if path in meshes else read_clouds([path], config)[0] for path in paths]
        known = [cloud for cloud in clouds if cloud is not None]
        if len(known) == len(paths) and config.mask is None and config.segments is None:
            return scene_of_clouds(known, config, sensing, generator)
        raise InputError(f"input: expected one mesh or several clouds, got {len(meshes)} meshes in {len(paths)} files")
    for key in ("viewpoints", "mask", "segments"):
        what = "point clouds (as=cloud takes a mesh for one)"
        _unused(config, key, what if key == "viewpoints" else "point clouds and depth images")
    return _scene_of_mesh(meshes[0], config, sensing, generator)


def texlets_of(cloud: Cloud, config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator) -> Texlets:
    """The texlets of one point cloud in m; see `scene_of_clouds`."""
    return scene_of_clouds([cloud], config, sensing, generator).texlets


def scene_of_clouds(
    clouds: Sequence[Cloud], config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> Scene:
    """The scene that point clouds in m, one frame, show together, such as those of a live camera.

    Each is thinned by voxels, freed from the table and from outliers, and given normals where it has none, turned to
    its own viewpoints (or to `config.viewpoints`); then the targets' points are thinned to texlets together.
    """
    if config.viewpoints is not None:
        viewpoints = vectors("viewpoints", np.atleast_2d(np.array(config.viewpoints, dtype=object)).tolist(), (None, 3))
        clouds = [replace(cloud, viewpoints=viewpoints) for cloud in clouds]
    clouds = [checked(cloud) for cloud in clouds]
    named = _named([cloud.labels for cloud in clouds])
    notes = [f"{cloud.name}: {note}" for cloud in clouds for note in cloud.notes]
    read = sum(map(len, clouds))
    clouds, told = targeted(clouds, config)
    notes += told
    _check_near(clouds)
    given = {cloud.name for cloud in clouds if cloud.viewpoints is not None}
    raw, clouds = clouds, [voxel_means(cloud, config.voxel) for cloud in clouds]
    notes.append(f"voxels of {config.voxel:g} m: {sum(map(len, clouds))} points of {read}")
    clouds = [with_viewpoint(cloud, before, config, notes) for cloud, before in zip(clouds, raw, strict=True)]
    gravity = gravity_of(config, viewpoints_of(clouds), ahead=ahead_of(clouds))
    table = table_of(clouds, config, generator, gravity, notes)
    targets, obstacles = _apart(clouds, table, config)
    before_outliers = sum(map(len, targets))
    facing = [oriented(cloud, config, notes) for cloud in targets]
    largest = LargestPlane.of(facing, config)
    why = why_no_grasp(targets, facing, largest, table)
    for cloud, before in zip(facing, targets, strict=True):
        if before.normals is None and cloud.name in given and why is None:
            check_side(cloud, config, notes)
    dropped = before_outliers - sum(map(len, facing))
    if 2 * dropped > before_outliers and why is None:
        raise InputError(
            f"{facing[0].name}: expected most points to have {config.min_neighbours} others of their side within "
            f"{config.normal_radius:g} m, got {dropped / before_outliers:.0%} with fewer; give a larger normal_radius"
        )
    notes.append(f"outliers: {dropped} of {before_outliers} points dropped")
    if dropped < before_outliers:
        if neighbourhoods(largest.points, config.min_neighbours, sensing.spacing)[1] > _SPARSE * sensing.spacing:
            sensing = replace(sensing, min_members=1)
        notes += size_notes(largest, None, table is not None)
    looked = looked_by_clouds(clouds, None if table is None else table[:3])
    around = Around(obstacles, table, gravity, viewpoints_of(clouds), looked)
    scene = thinned(facing, around, notes, config, sensing, generator, why)
    return _with_lost(replace(scene, sensed=sensed_of(clouds, table, config.table_distance)), named)


def scene_of_views(
    views: Sequence[View], config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> Scene:
    """The scene that depth images show together, in the frame of their cameras' poses.

    The targets' surface points are those of `sensing.texlets.extract`; every other pixel with a return is an obstacle.
    """
    try:
        return _scene_of_views(views, config, sensing, generator)
    except InputError as error:
        hint = unusual_depth(views, config) if any((view.depth > 0).any() for view in views) else ""
        if not hint or "depth_scale" in str(error):
            raise
        raise InputError(f"{error}; {hint}") from None


def _scene_of_views(
    views: Sequence[View], config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator
) -> Scene:
    clouds, strides, notes = [], [], []
    for view in views:
        if view.depth.shape != (view.camera.height, view.camera.width):
            expected = f"{view.camera.height} x {view.camera.width} pixels"
            raise InputError(f"{view.name}: expected {expected}, got {view.depth.shape}")
        notes += [f"{view.name}: {note}" for note in view.notes]
        check_depth_image(view)
        strides.append(stride_of(view, config, sensing))
        clouds += surfaces(view, strides[-1], config, sensing)
    if not any(bool(is_target(cloud).any()) for cloud in clouds):
        raise InputError(
            f"input: expected surfaces of {sensing.window} x {sensing.window} pixels in the depth images, got none"
        )
    clouds, told = targeted([cloud for cloud in clouds if len(cloud)], config)
    notes += told
    if max(strides) > 1:
        notes.insert(0, f"stride: every {', '.join(map(str, strides))} pixels of the depth images")
    gravity = gravity_of(config, None, [view.camera.T_object_camera[:3, :3] for view in views])
    if gravity is not None and gravity.doubt:
        notes.append(f"warning: {gravity.doubt}")
    table = table_of(clouds, config, generator, gravity, notes)
    targets, obstacles = _apart(clouds, table, config)
    largest = LargestPlane.of(targets, config)
    notes += size_notes(largest, views, table is not None)
    around = Around(obstacles, table, gravity, viewpoints_of(clouds), looked_by_images(views))
    why = why_no_grasp(targets, targets, largest, table)
    scene = thinned(targets, around, notes, config, sensing, generator, why)
    scene = replace(scene, sensed=sensed_of(clouds, table, config.table_distance, config.voxel))
    return _with_lost(scene, _named([view.labels for view in views]))


def _named(labels: Sequence[np.ndarray | None]) -> dict[int, int]:
    """The targets that labels name, and how many points or pixels each has."""
    counted: Counter[int] = Counter()
    for part in labels:
        if part is not None:
            counted.update(dict(zip(*(a.tolist() for a in np.unique(part[part > 0], return_counts=True)), strict=True)))
    return dict(counted)


def _with_lost(scene: Scene, named: dict[int, int]) -> Scene:
    """The scene with a line for each target of which nothing is left."""
    lost = [
        f"warning: target {number}: nothing left of {count} points: on the table, outside of the crop box, without a "
        "reading, or too few together"
        for number, count in sorted(named.items())
        if number not in scene.targets
    ]
    return replace(scene, notes=(*scene.notes, *lost)) if len(named) > 1 else scene


def _scene_of_mesh(path: Path, config: SceneConfig, sensing: SensingConfig, generator: np.random.Generator) -> Scene:
    if config.mesh == "whole":
        clouds, notes = targeted([sampled(path, config, generator)], config)
        gravity = gravity_of(config, None)
        table = table_of(clouds, config, generator, gravity, notes)
        targets, obstacles = _apart(clouds, table, config)
        around = Around(obstacles, table, gravity, None, looked_by_nobody("a mesh taken whole was not seen by anybody"))
        why = why_no_grasp(targets, targets, LargestPlane.of(targets, config), table)
        return thinned(targets, around, notes, config, sensing, generator, why)
    texlets, viewpoints, images = sensed(path, config, sensing, generator)
    points, normals = texlets.positions.double().numpy(), texlets.normals.double().numpy()
    if not len(points):
        raise InputError(f"{path}: expected a mesh that the cameras see, got no texlet")
    clouds, notes = targeted([Cloud(points, normals, viewpoints, str(path))], config)
    notes.insert(0, f"taken for a mesh (as=cloud says otherwise): seen by {len(viewpoints)} simulated cameras")
    gravity = gravity_of(config, None)
    table = table_of(clouds, config, generator, gravity, notes)
    targets, obstacles = _apart(clouds, table, config)
    kept = targets[0]
    assert kept.normals is not None
    parts = {1: Texlets(torch.from_numpy(kept.points).float(), torch.from_numpy(kept.normals).float())}
    around = Around(obstacles, table, gravity, viewpoints, looked_by_cameras(images))
    why = why_no_grasp(targets, targets, LargestPlane.of(targets, config), table)
    return scene_of_parts(parts, around, notes, config, sensing, why)


def _apart(clouds: Sequence[Cloud], table: np.ndarray | None, config: SceneConfig) -> tuple[list[Cloud], np.ndarray]:
    """The targets' points above the table, cloud by cloud, and the obstacles (M, 3) above it, m."""
    targets, obstacles = [], [np.zeros((0, 3))]
    for cloud in clouds:
        target = is_target(cloud)
        above = np.ones(len(cloud), bool) if table is None else height(cloud.points, table) > config.table_distance
        if (target & above).any():
            targets.append(cloud.select(target & above))
        obstacles.append(cloud.points[~target & above])
    return targets, np.concatenate(obstacles)


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
