"""What a judge knows of an open hand, all from its shapes: where it closes, and points inside its fingers and palm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.errors import InputError
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.proposing.clearance import corners_of, half_opening
from spgf_torch.proposing.config import HypothesesConfig

# m behind a pad's face in which its extents across closing are measured: a fingertip's thickness.
_SKIN = 0.005
# Grid points of one piece of the hand beyond which its grid is the coarse one: a palm is not to outnumber the fingers.
_LARGE = 400


@dataclass(frozen=True)
class ClosingRegion:
    """The box that the pads sweep, in the TCP frame: |x| < half, |y| < height, low < z < high, m."""

    half: float
    height: float
    low: float
    high: float

    @property
    def length(self) -> float:
        """m along the approach."""
        return self.high - self.low

    def holds(self, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        """Bool in the shape of the coordinates: inside."""
        return (x.abs() < self.half) & (y.abs() < self.height) & (z > self.low) & (z < self.high)


@dataclass(frozen=True)
class HandGeometry:
    """An open hand of one grasp type, in the TCP frame (x closing, z approach), m.

    Attributes:
        volume: its convex pieces.
        region: what the pads sweep.
        config: how its inside is sampled.
    """

    volume: HandVolume
    region: ClosingRegion
    config: HypothesesConfig

    @staticmethod
    def of(volume: HandVolume, config: HypothesesConfig) -> HandGeometry:
        """The geometry that follows from the pieces; InputError where none lies on the closing axis."""
        return HandGeometry(volume, closing_region(volume), config)

    @cached_property
    def planes(self) -> tuple[Tensor, Tensor]:
        """Normals (pieces, F, 3) and offsets (pieces, F, 1) f32; pieces of fewer faces have their last one again."""
        most = max(map(len, self.volume.planes))
        padded = [torch.cat([p, p[-1:].expand(most - len(p), 4)]) for p in self.volume.planes]
        stacked = torch.stack(padded).float().cpu()
        return stacked[..., :3].contiguous(), stacked[..., 3:].contiguous()

    @cached_property
    def fingers(self) -> Tensor:
        """(I, 3) f32 points of a grid in the pieces, ahead of `near_fingers` behind the TCP."""
        points = self._grid(self.config.grid)
        return points[points[:, 2] > -self.config.near_fingers]

    @cached_property
    def palm(self) -> Tensor:
        """(I, 3) f32 points of a coarser grid in the pieces, from there to `far_palm` behind the TCP."""
        points = self._grid(self.config.coarse_grid)
        return points[(points[:, 2] <= -self.config.near_fingers) & (points[:, 2] > -self.config.far_palm)]

    @cached_property
    def sweep(self) -> Tensor:
        """(I, 3) f32 points of a grid in the closing region: nine along closing, three along each other axis."""
        r = self.region
        middle, third = (r.low + r.high) / 2, r.length / 3
        axes = (
            torch.linspace(-r.half, r.half, 9),
            torch.tensor([-2 / 3, 0.0, 2 / 3]) * r.height,
            torch.tensor([middle - third, middle, middle + third]),
        )
        return torch.cartesian_prod(*axes).float()

    def _grid(self, step: float) -> Tensor:
        """(I, 3) f32 points in the pieces, at most `step` apart along each axis, two at least; in large ones fewer."""
        grids = []
        for piece in self.volume.planes:
            planes = piece.double().cpu().numpy()
            corners = corners_of(planes)
            low, high = corners.min(axis=0), corners.max(axis=0)
            cells = np.maximum(2, np.ceil((high - low) / step)).astype(int)
            if np.prod(cells) > _LARGE:
                cells = np.maximum(2, np.ceil((high - low) / self.config.coarse_grid)).astype(int)
            axes = [a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, cells, strict=True)]
            points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            grids.append(points[(points @ planes[:, :3].T <= planes[:, 3]).all(axis=1)])
        return torch.from_numpy(np.concatenate(grids)).float()


def hand_geometry(volumes: Mapping[str, HandVolume], config: HypothesesConfig) -> tuple[HandGeometry, ...]:
    """The geometry of each grasp type, in the order of `config.GRASP_TYPES`."""
    return tuple(HandGeometry.of(volumes[grasp_type], config) for grasp_type in GRASP_TYPES)


def closing_region(volume: HandVolume) -> ClosingRegion:
    """The region between the pads: bounded by the pieces on the closing axis, as high and long as both their faces.

    Raises InputError where there are none.
    """
    half = half_opening(volume)
    faces = []
    for piece in volume.planes:
        planes = piece.double().cpu().numpy()
        for side in (-1.0, 1.0):
            just_inside = np.array([side * (half + 1e-5), 0, 0])
            if (planes[:, :3] @ just_inside <= planes[:, 3]).all():
                slab = np.array([[side, 0, 0, half + _SKIN], [-side, 0, 0, -half]])
                faces.append(corners_of(np.concatenate([planes, slab])))
    if not faces:
        raise InputError("hand: expected a piece of the open hand on the closing axis, got none")
    return ClosingRegion(
        half,
        float(min(np.abs(face[:, 1]).max() for face in faces)),
        float(max(face[:, 2].min() for face in faces)),
        float(min(face[:, 2].max() for face in faces)),
    )
