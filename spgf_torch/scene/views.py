"""Depth images as they lie on disk, each with its camera, its pose and what in it is a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spgf_torch.config import InputError, SceneConfig, find
from spgf_torch.scene.depth import camera_of, check_depth, read_depth, read_intrinsics, read_mask, read_poses
from spgf_torch.sensing.cameras import Camera


@dataclass(frozen=True)
class View:
    """One depth image.

    Attributes:
        depth: (H, W) float64, m; 0, negative or not finite: no return.
        camera: K in pixels and the pose T_input_camera, m.
        labels: (H, W) int32, the target that each pixel shows, 0: none, an obstacle; None: all are the target.
        name: for errors, the file that it came from.
        notes: what the reader left out or took for something, a line each.
    """

    depth: np.ndarray
    camera: Camera
    labels: np.ndarray | None = None
    name: str = "depth image"
    notes: tuple[str, ...] = ()


def read_views(paths: Sequence[Path], config: SceneConfig) -> list[View]:
    """The depth images with their cameras, whose poses are T_input_camera, and with what `mask` marks as target 1.

    Raises:
        InputError: as the readers of `scene.depth`; fewer or more intrinsics, poses or masks than images; sizes of
            image, K and mask that differ.
    """
    if config.intrinsics is None:
        raise InputError(f"intrinsics: expected the file of K for the depth image {paths[0]}, got none")
    count = len(paths)
    cameras = [read_intrinsics(path) for path in files_of("intrinsics", config.intrinsics)]
    if len(cameras) not in (1, count):
        raise InputError(f"intrinsics: expected one file, or one a depth image ({count}), got {len(cameras)}")
    cameras = cameras * count if len(cameras) == 1 else cameras
    masks = [] if config.mask is None else files_of("mask", config.mask)
    if masks and len(masks) != count:
        raise InputError(f"mask: expected one image a depth image ({count}), got {len(masks)}")
    views = []
    for i, (path, T) in enumerate(zip(paths, _poses(config, count), strict=True)):
        depth = read_depth(path, config.depth_scale, config.unit, config.max_points)
        check_depth(depth, str(path), config.min_extent, config.max_extent)
        labels = None
        if masks:
            keep = read_mask(masks[i], config.max_points)
            if keep.shape != depth.shape:
                raise InputError(f"{masks[i]}: expected {depth.shape} pixels as {path} has, got {keep.shape}")
            if not keep.any():
                raise InputError(f"{masks[i]}: expected pixels above 0, which mark the target; got none")
            labels = keep.astype(np.int32)
        views.append(View(depth, camera_of(depth, *cameras[i], T, str(path)), labels, str(path)))
    if sum(view.depth.size for view in views) > config.max_points:
        raise InputError(
            f"input: expected at most {config.max_points} pixels (max_points), got more; give fewer images"
        )
    return views


def _poses(config: SceneConfig, count: int) -> np.ndarray:
    if config.poses is None:
        if count > 1:
            raise InputError(f"poses: expected T_input_camera of each of the {count} depth images, got none")
        return np.eye(4)[None]
    poses = read_poses(files_of("poses", config.poses))
    if len(poses) != count:
        raise InputError(f"poses: expected one a depth image ({count}), got {len(poses)}")
    far = float(np.abs(poses[:, :3, 3]).max())
    if far > config.max_extent:
        raise InputError(f"poses: expected cameras within {config.max_extent:g} m of the origin, got {far:.4g}; mm?")
    return poses


def files_of(name: str, given: object) -> list[Path]:
    """One path or a list of them, as a setting gives it."""
    if given == "":
        raise InputError(f"{name}: expected a file or a list of files ({name}=FILE), got none")
    if isinstance(given, (str, Path)):
        return [find(given)]
    if not isinstance(given, (list, tuple)) or not given or not all(isinstance(each, (str, Path)) for each in given):
        raise InputError(f"{name}: expected a file or a list of files, got {given!r}")
    return [find(each) for each in given]
