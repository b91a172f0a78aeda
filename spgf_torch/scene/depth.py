"""Depth images of real cameras: the camera that sees their pixels, and the surface that they show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.intrinsics import Intrinsics
from spgf_torch.sensing.cameras import Camera
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.planes import surface_points

# A principal point further from the middle, as a share of the image, belongs to an image of another size.
_OFF_CENTRE = 0.2


def check_returns(name: str, depth: np.ndarray) -> None:
    """InputError for a depth image without a single return."""
    if not (np.isfinite(depth) & (depth > 0)).any():
        negative = int((depth < 0).sum())
        hint = f"; {negative} are negative: along OpenGL's axis? then change the sign" if negative else ""
        raise InputError(f"{name}: expected pixels with a depth, got none of {depth.size}{hint}")


def check_depth(name: str, depth: np.ndarray, counts: bool, config: SceneConfig) -> None:
    """InputError that names the option where the median of a depth image is none of a scene.

    Args:
        depth: (H, W) m.
        counts: it was whole numbers times a scale, not lengths in `config.unit`.
    """
    low, high = config.min_extent, config.max_extent
    median = float(np.median(depth[np.isfinite(depth) & (depth > 0)]))
    if low <= median <= high:
        return
    units = {unit: median * metres / METRES[config.unit] for unit, metres in METRES.items() if unit != config.unit}
    fitting = [f"unit={unit}" for unit, other in units.items() if low <= other <= high]
    hint = f"{' or '.join(fitting)} would fit" if fitting else "numbers of another kind, such as a depth buffer's?"
    if counts:
        hint = "another depth_scale (m per count)?"
    raise InputError(f"{name}: expected a median depth of {low:g} to {high:g} m, got {median:.4g} m; {hint}")


def camera_of(depth: np.ndarray, given: Intrinsics, T: np.ndarray, name: str) -> tuple[Camera, tuple[str, ...]]:
    """The camera of a depth image (H, W), and lines on how K became the one of this image.

    Raises:
        InputError: K is of an image of another size: by the size that its file states or, without, by its principal
            point, which no sensor has far from the middle of its image.
    """
    height, width = depth.shape
    fitted = given.of_image(width, height, name)
    K = fitted.K
    off = np.abs(K[:2, 2] / (width, height) - 0.5)
    if fitted.size is None and (off > _OFF_CENTRE).any():
        raise InputError(
            f"{name}: expected K of an image of {width} x {height} pixels, got the principal point "
            f"({K[0, 2]:g}, {K[1, 2]:g}) far from its middle; for a cut-out give K as JSON with width and height"
        )
    return Camera(K, T, width, height), fitted.notes


def every(depth: np.ndarray, camera: Camera, stride: int) -> tuple[np.ndarray, Camera]:
    """Every `stride`-th row and column of a depth image, and the camera that sees just these."""
    fewer = depth[::stride, ::stride]
    K = camera.K.copy()
    K[:2] /= stride
    return fewer, replace(camera, K=K, width=fewer.shape[1], height=fewer.shape[0])


def learned_stride(depth: np.ndarray, K: np.ndarray, sensing: SensingConfig) -> int:
    """The stride that sets pixels as far apart on what is seen as those of the camera that the model learned from.

    Args:
        depth: of the pixels that matter, any shape, m, all above 0.
    """
    apart = float(np.median(depth)) / K[0, 0]
    return max(1, round(sensing.distance / sensing.focal / apart))


def pixel_points(depth: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W, 3) m: where the pixels of a depth image lie, in the frame that the camera's pose refers to."""
    T = camera.T_object_camera
    return (depth[..., None] * camera.rays()) @ T[:3, :3].T + T[:3, 3]


def surface(depth: np.ndarray, camera: Camera, sensing: SensingConfig, name: str) -> Cloud:
    """The oriented surface points of one depth image, in the frame that the camera's pose refers to."""
    points, normals = surface_points(depth, camera.rays(), sensing)
    rotation, translation = camera.T_object_camera[:3, :3], camera.T_object_camera[:3, 3]
    return Cloud(points @ rotation.T + translation, normals @ rotation.T, translation[None], name)
