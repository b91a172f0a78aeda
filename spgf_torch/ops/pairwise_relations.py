"""Reference frames and pairwise spatial relations (paper, section 3.1.1, Eqs. 2-4), for the operator `describe`.

The paper writes the angles with d = X1 - X2, from the neighbour to the centre, and with acos. Here they are the same
angles of l = X2 - X1, the neighbour as seen in the centre's frame (R_x, R_y, n1), in metres, and written with atan2,
which keeps its accuracy where acos does not: near a right angle for alpha1, and near 0 and pi for alpha2, where acos
of a float32 is off by up to 5e-4 rad.
"""

from __future__ import annotations

import math
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import compiled, lean

Array = TypeVar("Array", np.ndarray, Tensor)

# m; a step in the plane this short has no direction: below it is the rounding of float32 coordinates.
NOWHERE = 1e-7

# rad; a neighbour this close to the centre's normal has no alpha3, and a normal this close to perpendicular counts as
# perpendicular (top layer, alpha2 = pi/2): both would otherwise be decided by rounding (docs/design/features.md).
SINGULAR = 1e-3

# Numbers that torch's loops take at once, at most: what is left over at the end they round differently.
VECTOR = 64


class Pairs(NamedTuple, Generic[Array]):
    """N centres with what surrounds them: P pairs of a centre and a neighbour, all of one float type.

    start: (N + 1,) int64, the pairs of centre k are those from start[k] to start[k + 1]; step: (3, P) m, from the
    centre to the neighbour; normal: (3, P), the neighbour's; towards: (N, 3) m, the mean step, 0 without a neighbour.
    """

    start: Array
    step: Array
    normal: Array
    towards: Array


def pairs_of(
    start: np.ndarray, neighbour: np.ndarray, centres: np.ndarray, cloud: np.ndarray, normals: np.ndarray
) -> Pairs[np.ndarray]:
    """The pairs of centres (N, 3), whose neighbours (P,) int32 are points of a cloud (M, 3) with normals (M, 3).

    `start` as in `Pairs`. Steps, and not positions, are averaged: those would cancel far from the origin.
    """
    step, normal = (np.empty((3, len(neighbour)), cloud.dtype) for _ in range(2))
    towards = np.empty_like(centres)
    _gather(start, neighbour, centres, cloud, normals, step, normal, towards)
    return Pairs(start, step, normal, towards)


def reference_frames(normals: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Frames (N, 3, 3) whose columns are R_x, R_y = n x R_x and the normal n, from unit normals (N, 3).

    R_x is arbitrary in the plane (section 3.1.1); here it points along `towards` (N, 3), any length. Where that has
    no direction in the plane, R_x is the coordinate axis farthest from the normal, made orthogonal to it.
    """
    frames = np.empty((len(normals), 3, 3), normals.dtype)
    _frames(normals, towards, frames)
    return frames


def turned(frames: Tensor, angle: Tensor) -> Tensor:
    """The frames (N, 3, 3) turned about their normals by angle (N,) in radians, from R_x towards R_y."""
    R_x, R_y, n = frames.unbind(2)
    cos, sin = angle.cos()[:, None], angle.sin()[:, None]
    return torch.stack([cos * R_x + sin * R_y, cos * R_y - sin * R_x, n], dim=2)


def relations(pairs: Pairs[np.ndarray], frames: np.ndarray) -> np.ndarray:
    """(3, P) radians of each pair: alpha1, alpha2, alpha3, in the centres' frames (N, 3, 3).

    alpha1 (Eq. 2), elevation, in [-pi/2, pi/2]: positive where the surface falls away below the centre's plane.
    alpha2 (Eq. 3), the angle between the normals, in [0, pi] (Kahan's form of acos(n1 . n2)).
    alpha3 (Eq. 4), the direction around the normal, in [-pi, pi], from R_x towards R_y. Turning this way, and being
    the direction to the neighbour and not from it, is our choice of what the paper leaves to convention. NaN for a
    neighbour along the normal (`SINGULAR`) or at the centre.
    """
    P = pairs.step.shape[1]
    opposite, adjacent = (np.zeros(3 * P + VECTOR, pairs.step.dtype) for _ in range(2))
    angles = opposite[: 3 * P].reshape(3, P)
    _sides(pairs.start, pairs.step, pairs.normal, frames, angles, adjacent[: 3 * P].reshape(3, P))
    whole = torch.from_numpy(opposite)
    torch.atan2(whole, torch.from_numpy(adjacent), out=whole)  # in one call some 2 ns an angle, the C library takes 40
    angles[1] *= 2
    return angles


def pairs_in_torch(counts: Tensor, neighbour: Tensor, centres: Tensor, cloud: Tensor, normals: Tensor) -> Pairs[Tensor]:
    """`pairs_of` by torch's operations, on any device; counts (N,) int64: how many neighbours a centre has."""
    start = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
    centre = torch.arange(len(counts), device=counts.device).repeat_interleave(counts, output_size=len(neighbour))
    step = cloud.index_select(0, neighbour) - centres.index_select(0, centre)
    total = torch.segment_reduce(step.double(), "sum", lengths=counts, axis=0, unsafe=True)
    towards = (total / counts.clamp(min=1)[:, None]).to(centres)
    return Pairs(start, step.T, normals.index_select(0, neighbour).T, towards)


def frames_in_torch(normals: Tensor, towards: Tensor) -> Tensor:
    """`reference_frames` by torch's operations."""
    n = normals.unbind(1)
    y = torch.stack(_product(n, towards.unbind(1)), dim=1)
    axis = torch.nn.functional.one_hot(normals.abs().argmin(1), 3).to(normals)
    straight = _squared_length(y).double() <= NOWHERE**2
    y = torch.where(straight[:, None], torch.stack(_product(n, axis.unbind(1)), dim=1), y)
    y = y / _root(_squared_length(y))[:, None]
    return torch.stack([torch.stack(_product(y.unbind(1), n), dim=1), y, normals], dim=2)


def relations_in_torch(pairs: Pairs[Tensor], frames: Tensor) -> Tensor:
    """`relations` by torch's operations."""
    counts = pairs.start.diff()
    rows = frames.flatten(1).repeat_interleave(counts, dim=0, output_size=pairs.step.shape[1])
    a, d, g, b, e, h, c, f, k = rows.unbind(1)  # columns R_x, R_y, n1
    (dx, dy, dz), (nx, ny, nz) = pairs.step, pairs.normal
    x, y, z = a * dx + b * dy + c * dz, d * dx + e * dy + f * dz, g * dx + h * dy + k * dz
    length = _root(x * x + y * y)
    apart = _root((g - nx).square() + (h - ny).square() + (k - nz).square())
    together = _root((g + nx).square() + (h + ny).square() + (k + nz).square())
    aside = y.masked_fill(~(length > SINGULAR * z.abs()), math.nan)
    angles = torch.atan2(torch.stack([-z, apart, aside]), torch.stack([length, together, x]))
    angles[1] *= 2
    return angles


def _root(squares: Tensor) -> Tensor:
    """Square roots, rounded as the compiled loops do: torch's own of float32 may be off by the last bit."""
    return squares.double().sqrt().to(squares)


def _product(a: tuple[Tensor, ...], b: tuple[Tensor, ...]) -> list[Tensor]:
    """Cross products of vectors given by their coordinates."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _squared_length(vectors: Tensor) -> Tensor:
    x, y, z = vectors.unbind(1)
    return x * x + y * y + z * z


@lean
def _gather(
    start: np.ndarray,
    neighbour: np.ndarray,
    centres: np.ndarray,
    cloud: np.ndarray,
    normals: np.ndarray,
    step: np.ndarray,
    normal: np.ndarray,
    towards: np.ndarray,
) -> None:
    for i in range(len(centres)):
        x, y, z = 0.0, 0.0, 0.0
        for pair in range(start[i], start[i + 1]):
            j = neighbour[pair]
            dx, dy, dz = cloud[j, 0] - centres[i, 0], cloud[j, 1] - centres[i, 1], cloud[j, 2] - centres[i, 2]
            step[0, pair], step[1, pair], step[2, pair] = dx, dy, dz
            normal[0, pair], normal[1, pair], normal[2, pair] = normals[j, 0], normals[j, 1], normals[j, 2]
            x, y, z = x + dx, y + dy, z + dz
        count = max(start[i + 1] - start[i], 1)
        towards[i, 0], towards[i, 1], towards[i, 2] = x / count, y / count, z / count


@compiled
def _frames(normals: np.ndarray, towards: np.ndarray, frames: np.ndarray) -> None:
    for i in range(len(normals)):
        n, axis = normals[i], towards[i]
        for look in range(2):  # one call in the code: each is inlined
            x, y, z = _cross(n, axis)
            if look == 1 or x * x + y * y + z * z > NOWHERE**2:
                break
            axis = np.zeros(3, n.dtype)
            a, b, c = abs(n[0]), abs(n[1]), abs(n[2])
            axis[0 if a <= b and a <= c else (1 if b <= c else 2)] = 1
        length = math.sqrt(x * x + y * y + z * z)
        y_axis = frames[i, :, 1]
        y_axis[0], y_axis[1], y_axis[2] = x / length, y / length, z / length
        frames[i, 0, 0], frames[i, 1, 0], frames[i, 2, 0] = _cross(y_axis, n)
        for k in range(3):  # an array into a slice would take seconds to compile
            frames[i, k, 2] = n[k]


@compiled
def _cross(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@lean
def _sides(
    start: np.ndarray,
    step: np.ndarray,
    normal: np.ndarray,
    frames: np.ndarray,
    opposite: np.ndarray,
    adjacent: np.ndarray,
) -> None:
    """Out: opposite, adjacent (3, P), the arguments of atan2: those of alpha1, half of alpha2, and alpha3.

    Two loops, over arrays without a gap: the compiler makes vector instructions of such alone.
    """
    singular, unknown = step.dtype.type(SINGULAR), step.dtype.type(math.nan)
    for i in range(len(frames)):
        own_frame = frames[i]  # columns R_x, R_y, n1
        a, b, c = own_frame[0, 0], own_frame[1, 0], own_frame[2, 0]
        d, e, f = own_frame[0, 1], own_frame[1, 1], own_frame[2, 1]
        g, h, k = own_frame[0, 2], own_frame[1, 2], own_frame[2, 2]
        own = slice(start[i], start[i + 1])
        dx, dy, dz = step[0, own], step[1, own], step[2, own]
        below, flat, ahead, aside = opposite[0, own], adjacent[0, own], adjacent[2, own], opposite[2, own]
        for pair in range(len(dx)):
            x = a * dx[pair] + b * dy[pair] + c * dz[pair]
            y = d * dx[pair] + e * dy[pair] + f * dz[pair]
            z = g * dx[pair] + h * dy[pair] + k * dz[pair]
            length = math.sqrt(x * x + y * y)
            below[pair], flat[pair], ahead[pair] = -z, length, x
            aside[pair] = y if length > singular * abs(z) else unknown
        nx, ny, nz, apart, together = normal[0, own], normal[1, own], normal[2, own], opposite[1, own], adjacent[1, own]
        for pair in range(len(nx)):
            apart[pair] = math.sqrt((g - nx[pair]) ** 2 + (h - ny[pair]) ** 2 + (k - nz[pair]) ** 2)
            together[pair] = math.sqrt((g + nx[pair]) ** 2 + (h + ny[pair]) ** 2 + (k + nz[pair]) ** 2)
