"""Reference frames and pairwise spatial relations (paper, section 3.1.1, Eqs. 2-4).

The paper writes the angles with d = X1 - X2, from the neighbour to the centre, and with acos. Here they are the same
angles of l = X2 - X1, the neighbour as seen in the centre's frame (R_x, R_y, n1), in metres, and written with atan2,
which keeps its accuracy where acos does not: near a right angle for alpha1, and near 0 and pi for alpha2, where acos
of a float32 is off by up to 5e-4 rad.

Centres may be a part of a cloud; their neighbours are points of the whole cloud.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled

# m; a step in the plane this short has no direction: below it is the rounding of float32 coordinates.
NOWHERE = 1e-7

# rad; a neighbour this close to the centre's normal has no alpha3, and a normal this close to perpendicular counts as
# perpendicular (top layer, alpha2 = pi/2): both would otherwise be decided by rounding (FEATURES.md).
SINGULAR = 1e-3


@dataclass(frozen=True)
class Pairs:
    """P pairs of N centres, each with its neighbours, on the CPU.

    start: (N + 1,) int64, the pairs of centre k are those from start[k] to start[k + 1]; neighbour: (P,) int32, the
    places in the cloud.
    """

    start: Tensor
    neighbour: Tensor


def to_neighbours(pairs: Pairs, centres: Tensor, cloud: Tensor) -> Tensor:
    """(N, 3) from each of the centres (N, 3) to the mean of its neighbours in the cloud, m; 0 where it has none.

    The reference axis R_x points there: the paper lets it be arbitrary, and so it turns with the object.
    """
    towards = torch.zeros_like(centres)
    _mean_step(pairs.start.numpy(), pairs.neighbour.numpy(), centres.numpy(), cloud.numpy(), towards.numpy())
    return towards


def reference_frames(normals: Tensor, towards: Tensor) -> Tensor:
    """Frames (N, 3, 3) whose columns are R_x, R_y = n x R_x and the normal n, from unit normals (N, 3).

    R_x is arbitrary in the plane (section 3.1.1); here it points along `towards` (N, 3), any length. Where that has
    no direction in the plane, R_x is the coordinate axis farthest from the normal, made orthogonal to it.
    """
    frames = normals.new_empty((len(normals), 3, 3))
    _frames(normals.numpy(), towards.numpy(), frames.numpy())
    return frames


def turned(frames: Tensor, angle: Tensor) -> Tensor:
    """The frames (N, 3, 3) turned about their normals by angle (N,) in radians, from R_x towards R_y."""
    R_x, R_y, n = frames.unbind(2)
    cos, sin = angle.cos()[:, None], angle.sin()[:, None]
    return torch.stack([cos * R_x + sin * R_y, cos * R_y - sin * R_x, n], dim=2)


def relations(pairs: Pairs, centres: Tensor, frames: Tensor, cloud: Tensor, normals: Tensor) -> Tensor:
    """(3, P) radians of each pair: alpha1, alpha2, alpha3.

    centres: (N, 3) m and their frames (N, 3, 3); cloud: positions (M, 3) m and normals (M, 3) of the neighbours; all
    contiguous and of one float type.

    alpha1 (Eq. 2), elevation, in [-pi/2, pi/2]: positive where the surface falls away below the centre's plane.
    alpha2 (Eq. 3), the angle between the normals, in [0, pi] (Kahan's form of acos(n1 . n2)).
    alpha3 (Eq. 4), the direction around the normal, in [-pi, pi], from R_x towards R_y. Turning this way, and being
    the direction to the neighbour and not from it, is our choice of what the paper leaves to convention. NaN for a
    neighbour along the normal (`SINGULAR`) or at the centre.
    """
    sides = centres.new_empty((2, 3, len(pairs.neighbour)))
    arrays = (tensor.numpy() for tensor in (centres, frames, cloud, normals, sides))
    _sides(pairs.start.numpy(), pairs.neighbour.numpy(), *arrays)
    angles = torch.atan2(sides[0], sides[1])  # in one call torch takes some 2 ns an angle, the C library 40
    angles[1] *= 2
    return angles


@compiled
def _mean_step(
    start: np.ndarray, neighbour: np.ndarray, centres: np.ndarray, cloud: np.ndarray, towards: np.ndarray
) -> None:
    """The mean of the steps from each centre to its neighbours: not of positions, which cancel far from the origin."""
    for i in range(len(centres)):
        x, y, z = 0.0, 0.0, 0.0
        for pair in range(start[i], start[i + 1]):
            j = neighbour[pair]
            x += cloud[j, 0] - centres[i, 0]
            y += cloud[j, 1] - centres[i, 1]
            z += cloud[j, 2] - centres[i, 2]
        count = max(start[i + 1] - start[i], 1)
        towards[i, 0], towards[i, 1], towards[i, 2] = x / count, y / count, z / count


@compiled
def _frames(normals: np.ndarray, towards: np.ndarray, frames: np.ndarray) -> None:
    for i in range(len(normals)):
        n = normals[i]
        x, y, z = _cross(n, towards[i])
        if x * x + y * y + z * z <= NOWHERE**2:
            axis = np.zeros_like(n)
            axis[np.abs(n).argmin()] = 1
            x, y, z = _cross(n, axis)
        length = math.sqrt(x * x + y * y + z * z)
        frames[i, 0, 1], frames[i, 1, 1], frames[i, 2, 1] = x / length, y / length, z / length
        frames[i, 0, 0], frames[i, 1, 0], frames[i, 2, 0] = _cross(frames[i, :, 1], n)
        frames[i, :, 2] = n


@compiled
def _cross(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _sides(
    start: np.ndarray,
    neighbour: np.ndarray,
    centres: np.ndarray,
    frames: np.ndarray,
    cloud: np.ndarray,
    normals: np.ndarray,
    sides: np.ndarray,
) -> None:
    """The arguments of atan2, (opposite and adjacent, angle, pair): those of alpha1, half of alpha2, and alpha3."""
    singular, unknown = centres.dtype.type(SINGULAR), centres.dtype.type(math.nan)
    for i in range(len(centres)):
        (a, d, g), (b, e, h), (c, f, k) = frames[i]  # columns R_x, R_y, n1
        for pair in range(start[i], start[i + 1]):
            j = neighbour[pair]
            dx, dy, dz = cloud[j, 0] - centres[i, 0], cloud[j, 1] - centres[i, 1], cloud[j, 2] - centres[i, 2]
            x, y, z = a * dx + b * dy + c * dz, d * dx + e * dy + f * dz, g * dx + h * dy + k * dz
            flat = math.sqrt(x * x + y * y)
            difference = (g - normals[j, 0]) ** 2 + (h - normals[j, 1]) ** 2 + (k - normals[j, 2]) ** 2
            total = (g + normals[j, 0]) ** 2 + (h + normals[j, 1]) ** 2 + (k + normals[j, 2]) ** 2
            known = flat > singular * abs(z)
            sides[0, 0, pair], sides[1, 0, pair] = -z, flat
            sides[0, 1, pair], sides[1, 1, pair] = math.sqrt(difference), math.sqrt(total)
            sides[0, 2, pair] = y if known else unknown
            sides[1, 2, pair] = x if known else unknown
