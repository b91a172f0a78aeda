"""Clouds and depth images that are in memory, treated as those in files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.objects.scans import METRES
from spgf_torch.scene.cloud import Cloud, checked, pixels_of
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth import camera_of, check_depth, check_returns
from spgf_torch.scene.depth_files import DepthFile, counts_array, flat, in_metres, metres_a_count
from spgf_torch.scene.intrinsics import Intrinsics, checked_K
from spgf_torch.scene.labels import fitting, label_array, marked, numbered
from spgf_torch.scene.poses import checked_pose
from spgf_torch.scene.views import View
from spgf_torch.settings import settings


def cloud_of_arrays(
    points: Any, normals: Any = None, viewpoints: Any = None, labels: Any = None, name: str = "points"
) -> Cloud:
    """The usable points of a cloud in memory, as `read_cloud` gives those of a file.

    Args:
        points: (N, 3), or (H, W, 3) as a camera's image of points, m; NaN, infinity and (0, 0, 0): no reading.
        normals: in the shape of the points, of length 1, out of the surface; None: not known.
        viewpoints: (V, 3) or (3,), where it was seen from, m, same frame; None: not known.
        labels: (N,) or (H, W) whole numbers, the target that each point is of, 0: an obstacle; None: all one target.
        name: for errors.

    Raises:
        InputError: other shapes, no numbers, no point with a reading, normals of another length than 1.
    """
    array = _floats(name, points)
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        hint = "; transpose it" if array.ndim == 2 and array.shape[0] == 3 else ""
        raise InputError(f"{name}: expected shape (N, 3) or (H, W, 3), got {array.shape}{hint}")
    vectors = None if normals is None else _floats(f"{name}: normals", normals)
    if vectors is not None and vectors.shape != array.shape:
        raise InputError(f"{name}: expected points and normals of one shape, got {array.shape} and {vectors.shape}")
    eyes = None if viewpoints is None else np.atleast_2d(_floats(f"{name}: viewpoints", viewpoints))
    targets = None
    if labels is not None:
        what = f"{name}: labels"
        targets = numbered(what, fitting(what, label_array(what, np.asarray(labels)), array.shape[:-1], "the cloud"))
    cloud = Cloud(
        array.reshape(-1, 3),
        None if vectors is None else vectors.reshape(-1, 3),
        eyes,
        name,
        None if targets is None else targets.ravel(),
        pixels_of(array.shape),
    )
    return checked(cloud)


def view_of_arrays(
    depth: Any,
    K: Any,
    T_input_camera: Any = None,
    mask: Any = None,
    segments: Any = None,
    config: SceneConfig | None = None,
    name: str = "depth image",
) -> View:
    """A depth image in memory, as `read_views` gives that of a file.

    Args:
        depth: (H, W), (H, W, 1) or (1, H, W): floats in m, or whole numbers of 16 bits or more, which are counts;
            0, negative, not finite and, of 16 bits, 65535: no return.
        K: (3, 3) in pixels of the rectified image, or fx, fy, cx, cy.
        T_input_camera: (4, 4) pose of the camera, m; None: the input's frame is the camera's.
        mask: (H, W), not 0: target 1, 0: an obstacle; None: all is the target.
        segments: (H, W) whole numbers, each above 0 a target of its own; not together with `mask`.
        config: unit of floats, depth_scale of counts, limits of the median; None: the defaults.
        name: for errors.

    Raises:
        InputError: other shapes, no numbers, no pixel with a depth, a K of another image, a pose that is not rigid.
    """
    if mask is not None and segments is not None:
        raise InputError(f"{name}: expected mask or segments, got both")
    for key, given in (("mask", mask), ("segments", segments)):
        if isinstance(given, str | Path):
            raise InputError(f"{key}: expected an array, got the name of a file; files go into Scene.from_files")
    image = flat(name, np.asarray(depth))
    file = DepthFile(image, counts := counts_array(name, image), told=counts)
    config = config or settings(SceneConfig)
    values, notes = in_metres(file, config.depth_scale, config.unit, None)
    check_returns(name, values)
    check_depth(name, values, counts, config)
    T = np.eye(4) if T_input_camera is None else checked_pose(f"{name}: T_input_camera", _floats(name, T_input_camera))
    camera, more = camera_of(values, Intrinsics(checked_K(f"{name}: K", _floats(f"{name}: K", K))), T, name)
    notes = [*notes, *more]
    labels = None
    if mask is not None:
        what = f"{name}: mask"
        labels, told = marked(what, fitting(what, np.asarray(mask) != 0, values.shape, name))
        notes.extend(told)
    elif segments is not None:
        what = f"{name}: segments"
        labels = numbered(what, fitting(what, label_array(what, np.asarray(segments)), values.shape, name))
    return View(values, camera, labels, name, tuple(notes), metres_a_count(file, config.depth_scale, config.unit, None))


def views_of_arrays(
    depth: Any, K: Any, T_input_camera: Any, mask: Any, segments: Any, config: SceneConfig
) -> list[View]:
    """The views of one depth image, or of several in lists; see `view_of_arrays`. One K does for all."""
    if not isinstance(depth, list | tuple) or not depth or np.ndim(depth[0]) < 2:
        return [view_of_arrays(depth, K, T_input_camera, mask, segments, config)]
    count = len(depth)
    if T_input_camera is None and count > 1:
        raise InputError(f"T_input_camera: expected the pose of each of the {count} depth images, got none")
    each = isinstance(K, list | tuple) and len(K) == count and np.size(K[0]) > 3  # not the three rows of one K
    Ks = list(K) if each else [K] * count
    parts = [[None] * count if given is None else list(given) for given in (T_input_camera, mask, segments)]
    for name, part in zip(("T_input_camera", "mask", "segments"), parts, strict=True):
        if len(part) != count:
            raise InputError(f"{name}: expected one a depth image ({count}), got {len(part)}")
    names = [f"depth image {i + 1}" for i in range(count)]
    return [
        view_of_arrays(one, k, T, m, s, config, name)
        for one, k, T, m, s, name in zip(depth, Ks, *parts, names, strict=True)
    ]


def clouds_of_arrays(
    points: Any, normals: Any, viewpoints: Any, mask: Any, segments: Any, config: SceneConfig
) -> list[Cloud]:
    """The clouds of one array of points, or of several in lists, in m; see `cloud_of_arrays`.

    Viewpoints are in m, as settings are; of several clouds a list with one entry each, or (3,) for all.
    """
    several = isinstance(points, list | tuple) and len(points) > 0 and np.ndim(points[0]) >= 2
    if not several:
        clouds = [cloud_of_arrays(points, normals, None, mask_labels(mask, segments))]
        places = [viewpoints]
    else:
        count = len(points)
        one = viewpoints is None or (np.ndim(viewpoints) == 1 and np.size(viewpoints[0]) == 1)
        parts = [[None] * count if part is None else list(part) for part in (normals, mask, segments)]
        places = [viewpoints] * count if one else list(viewpoints)
        for name, part in zip(("normals", "mask", "segments", "viewpoints"), (*parts, places), strict=True):
            if len(part) != count:
                raise InputError(f"{name}: expected one a cloud ({count}), got {len(part)}")
        clouds = [
            cloud_of_arrays(p, n, None, mask_labels(m, s), f"points {i + 1}")
            for i, (p, n, m, s) in enumerate(zip(points, *parts, strict=True))
        ]
    eyes = [None if place is None else np.atleast_2d(_floats("viewpoints", place)) for place in places]
    scaled = [cloud.scaled(METRES[config.unit]) for cloud in clouds]
    return [checked(replace(cloud, viewpoints=eye)) for cloud, eye in zip(scaled, eyes, strict=True)]


def mask_labels(mask: Any, segments: Any) -> Any:
    """Labels of what `mask` (not 0: target 1) or `segments` (numbers) mark; None for neither."""
    if mask is not None and segments is not None:
        raise InputError("mask: expected mask or segments, got both")
    return segments if mask is None else (np.asarray(mask) != 0).astype(np.int32)


def _floats(name: str, values: Any) -> np.ndarray:
    """A float64 array; InputError where there are no numbers."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "fiu":
            raise TypeError
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # RuntimeError: a tensor that requires gradients
        raise InputError(f"{name}: expected an array of numbers, got {type(values).__name__}") from None
