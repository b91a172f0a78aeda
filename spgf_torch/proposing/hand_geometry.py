"""What a judge knows of an open hand, all from its shapes: where it closes, and points inside its fingers and palm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.proposing.closing_region import ClosingRegion, closing_region, corners_of
from spgf_torch.proposing.config import HypothesesConfig

# Grid points of one piece of the hand beyond which its grid is the coarse one: a palm is not to outnumber the fingers.
_LARGE = 400


@dataclass(frozen=True)
class HandGeometry:
    """An open hand of one grasp type, in the TCP frame (x closing, z approach), m.

    Attributes:
        volume: its convex pieces.
        region: what the fingers sweep.
        config: how its inside is sampled.
    """

    volume: HandVolume
    region: ClosingRegion
    config: HypothesesConfig

    @staticmethod
    def of(volume: HandVolume, config: HypothesesConfig) -> HandGeometry:
        """The geometry that follows from the pieces; InputError where none bounds a closing region."""
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
            torch.linspace(-r.half, r.half, 9) + r.middle,
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
    """The geometry of each grasp type, in the order of their sorted names."""
    return tuple(HandGeometry.of(volumes[grasp_type], config) for grasp_type in sorted(volumes))
