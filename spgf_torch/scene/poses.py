"""Poses of cameras, T_input_camera: 4x4 matrices, rows of 3x4, lines of the TUM benchmark, Open3D's trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.scene.calibration_files import number_array, structured

# Of a rotation matrix or a quaternion that was written with few digits.
_RIGID = 1e-3
_LAST_ROW = [0.0, 0.0, 0.0, 1.0]


def read_poses(paths: Sequence[Path]) -> tuple[np.ndarray, tuple[str, ...]]:
    """(V, 4, 4) T_input_camera, m: the files' poses one after another, and a line on what was taken for what.

    Formats: rows of four numbers as text, 4 or 3 a pose; JSON or YAML lists, or a mapping with `T_input_camera`; .npy
    (4, 4), (3, 4) or (V, 4, 4); lines of 8 numbers (TUM: t x y z qx qy qz qw) or 7 (without t); Open3D's camera
    trajectory (JSON), whose `extrinsic` is the inverse.

    Raises:
        InputError: none of these, or not of a rotation and a translation.
    """
    poses: list[np.ndarray] = []
    notes: list[str] = []
    for path in paths:
        values = structured(path)
        if isinstance(values, dict):
            values = _of_mapping(path, values, notes)
        values = _without_counters(path, values, notes)
        poses.extend(checked_pose(str(path), T) for T in _matrices(path, number_array(path, values), notes))
    return np.array(poses), tuple(notes)


def checked_pose(name: str, values: np.ndarray) -> np.ndarray:
    """A (4, 4) float64 rigid motion; InputError otherwise."""
    T = np.asarray(values, dtype=np.float64)
    if T.shape != (4, 4):
        raise InputError(f"{name}: expected a camera pose of 4 x 4 numbers, got shape {T.shape}")
    rotation = T[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        rigid = (
            np.isfinite(T).all()
            and np.abs(rotation @ rotation.T - np.eye(3)).max() < _RIGID
            and np.linalg.det(rotation) > 0
        )
    if not rigid or not np.allclose(T[3], _LAST_ROW):
        raise InputError(f"{name}: expected a rotation, a translation and 0 0 0 1, got {T.round(4).tolist()}")
    return T


def _of_mapping(path: Path, values: dict[str, Any], notes: list[str]) -> Any:
    if "T_input_camera" in values:
        return values["T_input_camera"]
    cameras = values["parameters"] if isinstance(values.get("parameters"), list) else [values]
    matrices = [camera.get("extrinsic") if isinstance(camera, dict) else None for camera in cameras]
    if str(values.get("class_name", "")).startswith("PinholeCamera") and all(m is not None for m in matrices):
        extrinsics = number_array(path, matrices)
        if extrinsics.shape[1:] not in ((16,), (4, 4)):
            raise InputError(f"{path}: expected extrinsics of 4 x 4 numbers, got shape {extrinsics.shape}")
        # Open3D writes its matrices column by column, and world to camera.
        columns = extrinsics.reshape(-1, 4, 4)
        rows = np.swapaxes(columns, 1, 2) if extrinsics.ndim == 2 else columns
        notes.append(
            f"{path.name}: poses are the inverse of Open3D's extrinsics, which lead from the input to the camera"
        )
        return [np.linalg.inv(checked_pose(str(path), T)) for T in rows]
    raise InputError(f"{path}: expected a key T_input_camera, got {', '.join(map(str, values))}")


def _without_counters(path: Path, values: Any, notes: list[str]) -> Any:
    """The rows of matrices of a Redwood .log file, which has a line of three numbers before each."""
    if not isinstance(values, list) or not all(isinstance(row, list) for row in values):
        return values
    if [len(row) for row in values] != [3, 4, 4, 4, 4] * (len(values) // 5) or not values:
        return values
    notes.append(f"{path.name}: lines of three numbers before the poses taken for their counters (Redwood .log)")
    return [row for row in values if len(row) == 4]


def _matrices(path: Path, array: np.ndarray, notes: list[str]) -> np.ndarray:
    """(V, 4, 4) of numbers in any of the layouts."""
    if array.ndim in (1, 2) and array.shape[-1:] in ((12,), (16,)):  # a pose a line, as KITTI has them
        array = array.reshape(-1, array.shape[-1] // 4, 4)
    if array.ndim in (1, 2) and array.size and array.shape[-1] in (7, 8):
        return _of_lines(path, np.atleast_2d(array), notes)
    if array.ndim < 2 or not array.size or array.shape[-1] != 4:
        raise _unknown(path, array)
    of_three = array.ndim == 2 and not len(array) % 3
    if of_three and (len(array) % 4 or not np.allclose(array[3], _LAST_ROW)):
        array = array.reshape(-1, 3, 4)
    if array.ndim == 3 and array.shape[1] == 3:
        last = np.broadcast_to(np.array(_LAST_ROW), (len(array), 1, 4))
        array = np.concatenate([array, last], axis=1)
    if array.size % 16:
        raise _unknown(path, array)
    return array.reshape(-1, 4, 4)


def _of_lines(path: Path, lines: np.ndarray, notes: list[str]) -> np.ndarray:
    from scipy.spatial.transform import Rotation  # slow to import, and seldom needed

    quaternions = lines[:, -4:]
    length = np.linalg.norm(quaternions, axis=1)
    if not np.isfinite(lines).all() or (np.abs(length - 1) > _RIGID).any():
        raise InputError(f"{path}: expected unit quaternions qx qy qz qw at the ends of the lines, got other numbers")
    T = np.tile(np.eye(4), (len(lines), 1, 1))
    T[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    T[:, :3, 3] = lines[:, -7:-4]
    what = "[t] x y z qx qy qz qw, as the TUM benchmark writes them" if lines.shape[1] == 8 else "x y z qx qy qz qw"
    notes.append(f"{path.name}: lines of {lines.shape[1]} numbers taken for {what}")
    return T


def _unknown(path: Path, array: np.ndarray) -> InputError:
    what = "camera poses of 4 x 4 or 3 x 4 numbers, or lines [t] x y z qx qy qz qw"
    return InputError(f"{path}: expected {what}; got shape {array.shape}")
