"""Depth images as they lie on disk, each with its camera, its pose and what in it is a target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.paths import find
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth import camera_of, check_depth, check_returns
from spgf_torch.scene.depth_files import DepthFile, in_metres, metres_a_count, read_depth_file
from spgf_torch.scene.intrinsics import Intrinsics, given_intrinsics, read_intrinsics
from spgf_torch.scene.labels import fitting, marked, numbered, read_labels, read_mask
from spgf_torch.scene.poses import read_poses
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
        scale: m that a count was taken for; None: the numbers were lengths.
    """

    depth: np.ndarray
    camera: Camera
    labels: np.ndarray | None = None
    name: str = "depth image"
    notes: tuple[str, ...] = ()
    scale: float | None = None


def read_views(paths: Sequence[Path], config: SceneConfig) -> list[View]:
    """The depth images with their cameras, whose poses are T_input_camera, and with what is a target in them.

    `config.mask` marks target 1; `config.segments` numbers several.

    Raises:
        InputError: as the readers of `depth_files`, `intrinsics`, `poses` and `labels`; fewer or more intrinsics, poses
            or masks than images; sizes of image, K and mask that differ.
    """
    count = len(paths)
    marks = files_of_marks(config, count, "a depth image")
    if config.intrinsics is None and paths[0].suffix.lower() != ".npz":  # which may hold its K
        raise _without_intrinsics(paths[0])
    poses, pose_notes = _poses(config, count)
    views, pixels = [], 0
    for i, path in enumerate(paths):
        file = read_depth_file(path, config.max_points)
        given = _intrinsics(config, path, i, count, file)
        depth, notes = in_metres(file, config.depth_scale, config.unit, given)
        check_returns(str(path), depth)
        check_depth(str(path), depth, file.counts, config)
        camera, camera_notes = camera_of(depth, given, poses[i], str(path))
        labels, label_notes = labels_of(marks, i, depth.shape, str(path), config.max_points)
        if file.segments and not marks[0]:
            notes.append(f"{file.segments} beside the depth not used; segments={path.name} makes its numbers targets")
        if labels is not None:
            numbered(str(marks[1][i]), labels[np.isfinite(depth) & (depth > 0)], "pixels with a depth")
        every = (*file.notes, *camera_notes, *notes, *(pose_notes if i == 0 else ()), *label_notes)
        scale = metres_a_count(file, config.depth_scale, config.unit, given)
        views.append(View(depth, camera, labels, str(path), every, scale))
        pixels += depth.size
        if pixels > config.max_points:
            raise InputError(
                f"input: expected at most {config.max_points} pixels (max_points), got more; give fewer images"
            )
    return views


def _intrinsics(config: SceneConfig, path: Path, index: int, count: int, file: DepthFile) -> Intrinsics:
    """The intrinsics of one depth image: those of the setting, else those in its own file."""
    given = config.intrinsics
    if given is None:
        if file.intrinsics is None:
            raise _without_intrinsics(path)
        return file.intrinsics
    if isinstance(given, list | tuple) and given and not any(isinstance(each, str | Path) for each in given):
        return given_intrinsics(given)
    files = files_of("intrinsics", given)
    if len(files) not in (1, count):
        raise InputError(f"intrinsics: expected one file, or one a depth image ({count}), got {len(files)}")
    return read_intrinsics(files[0 if len(files) == 1 else index], path)


def _without_intrinsics(path: Path) -> InputError:
    return InputError(f"intrinsics: expected the file of K for the depth image {path}, got none")


def files_of_marks(config: SceneConfig, count: int, what: str) -> tuple[str, list[Path]]:
    """Which of mask and segments is set ("" for neither), and its files, one for each of `count` inputs."""
    if config.mask is not None and config.segments is not None:
        raise InputError("mask: expected mask or segments, got both; segments numbers several targets, mask marks one")
    for key in ("mask", "segments"):
        if (given := getattr(config, key)) is not None:
            files = files_of(key, given)
            if len(files) != count:
                raise InputError(f"{key}: expected one file {what} ({count}), got {len(files)}")
            return key, files
    return "", []


def labels_of(
    marks: tuple[str, list[Path]], index: int, shape: tuple[int, ...], whose: str, limit: int
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """int32 labels of one input's pixels or points, in its shape, and lines on them; None where none are set.

    Args:
        marks: see `files_of_marks`.
    """
    key, files = marks
    if not key:
        return None, ()
    name = str(files[index])
    if key == "mask":
        return marked(name, fitting(name, read_mask(files[index], limit), shape, whose))
    return numbered(name, fitting(name, read_labels(files[index], limit), shape, whose)), ()


def _poses(config: SceneConfig, count: int) -> tuple[np.ndarray, tuple[str, ...]]:
    if config.poses is None:
        if count > 1:
            raise InputError(f"poses: expected T_input_camera of each of the {count} depth images, got none")
        return np.eye(4)[None], ()
    poses, notes = read_poses(files_of("poses", config.poses))
    if len(poses) != count:
        raise InputError(f"poses: expected one a depth image ({count}), got {len(poses)}")
    far = float(np.abs(poses[:, :3, 3]).max())
    if far > config.max_extent:
        raise InputError(f"poses: expected cameras within {config.max_extent:g} m of the origin, got {far:.4g}; mm?")
    return poses, notes


def files_of(name: str, given: object) -> list[Path]:
    """One path or a list of them, as a setting gives it."""
    if given == "":
        raise InputError(f"{name}: expected a file or a list of files ({name}=FILE), got none")
    if isinstance(given, (str, Path)):
        return [find(given)]
    if not isinstance(given, (list, tuple)) or not given or not all(isinstance(each, (str, Path)) for each in given):
        hint = "; arrays go into spgf_torch.Scene.from_depth or from_points" if np.ndim(given) > 1 else ""  # type: ignore[arg-type]
        raise InputError(f"{name}: expected a file or a list of files, got {str(given)[:60]}{hint}")
    return [find(each) for each in given]
