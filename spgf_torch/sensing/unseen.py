"""Which space no camera has seen: how far behind the seen surface points lie.

A point that some camera sees through is free; one behind the surface in every image may be anything. A pixel without
return inside the image counts as seen through, since nothing was there to return: single ones, which are noise, take
the nearest depth beside them. Outside of an image nothing is known, so its border is no edge of what is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import minimum_filter
from torch import Tensor

from spgf_torch.ops.depth_behind import THROUGH, Image, depth_behind
from spgf_torch.sensing.cameras import Camera

# px; side of the window whose least depth fills a pixel without return.
_FILL = 3


@dataclass(frozen=True)
class DepthView:
    """One depth image, ready for look-ups.

    Attributes:
        depth: (H, W) f32, m, holes filled; infinity: no return.
        K: (3, 3) f32, pixels.
        rotation: (3, 3) f32 and eye: (3,) f32, m: the camera's axes (columns) and place, in the frame of the points.
    """

    depth: Tensor
    K: Tensor
    rotation: Tensor
    eye: Tensor

    @staticmethod
    def of(depth: np.ndarray, camera: Camera) -> DepthView:
        """The view of a depth image (H, W), m; 0, negative or not finite: no return."""
        seen = np.where(np.isfinite(depth) & (depth > 0), depth, np.inf)
        filled = np.where(np.isfinite(seen), seen, minimum_filter(seen, _FILL, mode="nearest"))
        T = camera.T_object_camera
        tensors = (np.ascontiguousarray(part, np.float32) for part in (filled, camera.K, T[:3, :3], T[:3, 3]))
        return DepthView(*(torch.from_numpy(part) for part in tensors))

    def behind(self, points: Tensor) -> Tensor:
        """(...,) f32 m behind the seen surface of points (..., 3); negative: seen through; infinity: not in the image.

        A pixel sees the surface at its centre; a point belongs to the nearest.
        """
        camera = (points.float() - self.eye) @ self.rotation
        z = camera[..., 2]
        pixel = (camera @ self.K.T)[..., :2] / z.clamp(min=1e-6).unsqueeze(-1)
        height, width = self.depth.shape
        u, v = pixel[..., 0], pixel[..., 1]
        inside = (z > 0) & (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
        index = v.clamp(0, height - 1).round().long() * width + u.clamp(0, width - 1).round().long()
        depth = self.depth.flatten()[index]
        behind = torch.where(depth.isfinite(), z - depth, torch.full_like(z, THROUGH))
        return torch.where(inside, behind, torch.full_like(z, torch.inf))


def behind(points: Tensor, views: Sequence[DepthView]) -> Tensor:
    """(...,) f32 m behind the seen surface in every view, the least of all, for points (..., 3) in the views' frame.

    Negative: some camera sees the point free. Infinity: no image shows the place.
    """
    least = torch.full(points.shape[:-1], torch.inf)
    for view in views:
        least = torch.minimum(least, view.behind(points))
    return least


def behind_at(T: Tensor, points: Tensor, views: Sequence[DepthView], enough: float) -> Tensor:
    """(G, I) f32 the same for points (I, 3) of a body at poses (G, 4, 4) in the views' frame.

    A point that one view puts at most `enough` m behind its surface is not looked for in the others: where a value is
    that small, it need not be the least. Infinity: where one image shows the place, the others are not looked up.
    """
    least = torch.full((len(T), len(points)), torch.inf)
    for view in views:
        camera = torch.cat([view.rotation.T, view.K @ view.rotation.T]).double()
        least = depth_behind(T, points, Image(view.depth, view.eye, camera), enough, least)
    return least


def mean_direction(views: Sequence[DepthView], centre: Tensor) -> Tensor:
    """(3,) f32 mean of the unit vectors from a place (3,) to the cameras: shorter the more sides it was seen from."""
    eyes = torch.stack([view.eye for view in views]) - centre.float()
    return (eyes / eyes.norm(dim=1, keepdim=True)).mean(0)


def whole_image(depth: np.ndarray, part: Camera, camera: Camera) -> np.ndarray:
    """The image (H, W) of `camera` of which `depth` is the part that `part` sees (`cameras.crop`); 0 elsewhere."""
    whole = np.zeros((camera.height, camera.width), depth.dtype)
    left, top = (np.rint(camera.K[:2, 2] - part.K[:2, 2])).astype(int)
    whole[top : top + part.height, left : left + part.width] = depth
    return whole
