"""How far bodies at poses are behind the surface of a depth image: poses, points of the body, image -> depths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.ops.registration import memory, operator

# m in front of the surface: what a pixel without return says of every point.
THROUGH = -0.1


class Image(NamedTuple):
    """A depth image and where it was taken.

    Attributes:
        depth: (H, W) f32, m; infinity: no return. eye: (3,) f32, m, the camera's place.
        camera: (6, 3) f64, the rows of the rotation into its frame, then of that into pixels times metres.
    """

    depth: Tensor
    eye: Tensor
    camera: Tensor


@operator("depth_behind(Tensor T, Tensor points, Tensor[] image, float enough, Tensor least) -> Tensor")
def depth_behind(T: Tensor, points: Tensor, image: Image, enough: float, least: Tensor) -> Tensor:
    """(G, I) f32 m of points (I, 3) at poses (G, 4, 4) behind the surface in an image; `least` where that is less.

    At most `enough`, it stays as it is. Where the image does not show a point, too.
    """
    depth, eye, camera = image
    height, width = depth.shape
    a, b, c = points.double().unbind(1)
    move = _product(camera, (T[:, :3, 3:].double() - eye[:, None]))[..., 0]
    rotation = _product(camera, T[:, :3, :3].double())  # (G, 6, 3)
    z, u, v = (
        rotation[:, row, :1] * a + rotation[:, row, 1:2] * b + rotation[:, row, 2:] * c + move[:, row, None]
        for row in (2, 3, 4)
    )
    scale = 1 / z.clamp(min=1e-6)
    u, v = u * scale, v * scale
    shown = (z > 0) & (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    pixel = v.clamp(0, height - 1).round().long() * width + u.clamp(0, width - 1).round().long()
    surface = depth.flatten()[pixel]
    behind = torch.where(surface < torch.inf, z - surface, THROUGH)
    asked = shown & ~((least <= enough) & (least < torch.inf))
    return torch.where(asked, torch.minimum(least.double(), behind), least.double()).float()


def _product(rows: Tensor, columns: Tensor) -> Tensor:
    """(G, 6, K) f64 of (6, 3) and (G, 3, K), summed from the first to the last."""
    each = rows.unsqueeze(2) * columns.unsqueeze(1)
    return each[:, :, 0] + each[:, :, 1] + each[:, :, 2]


@depth_behind.on_cpu
def _in_loops(T: Tensor, points: Tensor, image: Image, enough: float, least: Tensor) -> Tensor:
    lower = memory(least).copy()
    depth, eye, camera = map(memory, image)
    _project(memory(T), memory(points), depth, eye, camera, np.float32(enough), lower)
    return torch.from_numpy(lower)


@depth_behind.fake
def _shapes(T: Tensor, points: Tensor, image: Image, enough: float, least: Tensor) -> Tensor:
    return torch.empty_like(least)


@compiled
def _project(
    T: np.ndarray,
    points: np.ndarray,
    depth: np.ndarray,
    eye: np.ndarray,
    camera: np.ndarray,
    enough: np.float32,
    least: np.ndarray,
) -> None:
    """Lower least (G, I)."""
    height, width = depth.shape
    rotation, move = np.empty((6, 3)), np.empty(6)
    for g in range(len(T)):
        for row in range(6):
            move[row] = 0.0
            for k in range(3):
                move[row] += camera[row, k] * (np.float64(T[g, k, 3]) - eye[k])
                rotation[row, k] = 0.0
                for j in range(3):
                    rotation[row, k] += camera[row, j] * T[g, j, k]
        for i in range(len(points)):
            if least[g, i] <= enough and least[g, i] < np.inf:
                continue
            a, b, c = points[i]
            z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c + move[2]
            if z <= 0:
                continue
            scale = 1 / max(z, 1e-6)
            u = (rotation[3, 0] * a + rotation[3, 1] * b + rotation[3, 2] * c + move[3]) * scale
            v = (rotation[4, 0] * a + rotation[4, 1] * b + rotation[4, 2] * c + move[4]) * scale
            if u > -0.5 and u < width - 0.5 and v > -0.5 and v < height - 0.5:
                surface = depth[int(np.rint(v)), int(np.rint(u))]
                least[g, i] = min(least[g, i], z - surface if surface < np.inf else THROUGH)
