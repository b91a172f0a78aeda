"""A grid over SE(3): cells of translation x rotation with a closed-form index.

Translation: cubic voxels of side `voxel` over the ball of radius `reach`. Rotation: the four charts of the
projective quaternion sphere, each a cube of n^3 cells in equal-angle coordinates u_i = atan(q_i / q_max),
so that a cell spans 180 deg / n at the chart's centre and a little less towards its corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

# The three components beside the largest one, for each of the four charts.
_OTHERS = torch.tensor([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


@dataclass(frozen=True)
class SE3Grid:
    """Cells over relative poses T_feature_grasp.

    Attributes:
        reach: m, radius of the ball of translations.
        voxel: m, side of a translation cell.
        rotation_deg: deg, side of a rotation cell at a chart's centre.
    """

    reach: float
    voxel: float
    rotation_deg: float

    @property
    def side(self) -> int:
        """Voxels along an axis; the outermost layer stays empty, so that neighbours never wrap around."""
        return 2 * math.ceil(self.reach / self.voxel) + 2

    @property
    def voxels(self) -> int:
        return self.side**3

    @property
    def chart_side(self) -> int:
        """Rotation cells along an axis of a chart."""
        return max(1, round(180.0 / self.rotation_deg))

    @property
    def rotations(self) -> int:
        return 4 * self.chart_side**3

    @property
    def cells(self) -> int:
        return self.voxels * self.rotations

    @property
    def rows(self) -> int:
        """Rows of cells: a row has one rotation and one first step of the voxel."""
        return self.rotations * self.side

    @property
    def row_size(self) -> int:
        """Cells of a row."""
        return self.side**2

    @property
    def numbers(self) -> list[float]:
        """The grid as operators take it (`spgf_torch.ops`)."""
        return [self.reach, self.voxel, self.rotation_deg]

    @property
    def edges(self) -> Tensor:
        """(chart_side - 1,) f64: the ratios of components that lie between the rotation cells of a chart."""
        return _edges(self.chart_side)

    def voxel_index(self, position: Tensor) -> Tensor:
        """(..., 3) m, within the reach, to voxel indices (...,) int64."""
        i = (position * (1 / self.voxel) + self.side / 2).floor().long().clamp_(1, self.side - 2)
        return (i[..., 0] * self.side + i[..., 1]) * self.side + i[..., 2]

    def rotation_index(self, quaternion: Tensor) -> Tensor:
        """(..., 4) unit wxyz to rotation-cell indices (...,) int64; q and -q share a cell."""
        chart = quaternion.abs().argmax(-1, keepdim=True)
        others = _OTHERS.to(quaternion.device)[chart.squeeze(-1)]
        ratio = quaternion.gather(-1, others) * (1 / quaternion.gather(-1, chart))  # from -1 to 1
        i, n = torch.bucketize(ratio, self.edges.to(ratio), right=True), self.chart_side
        return ((chart.squeeze(-1) * n + i[..., 0]) * n + i[..., 1]) * n + i[..., 2]

    def index(self, position: Tensor, quaternion: Tensor) -> Tensor:
        """Cell of each relative pose: position (..., 3) m, quaternion (..., 4) wxyz -> (...,) int64."""
        return self.rotation_index(quaternion) * self.voxels + self.voxel_index(position)

    def voxel_centres(self) -> Tensor:
        """(voxels, 3) f32 centres, m."""
        axis = (torch.arange(self.side) + 0.5 - self.side / 2) * self.voxel
        return torch.cartesian_prod(axis, axis, axis)

    def rotation_centres(self) -> Tensor:
        """(rotations, 4) f32 unit quaternions wxyz at the cells' centres."""
        n = self.chart_side
        axis = torch.tan(((torch.arange(n) + 0.5) / n - 0.5) * math.pi / 2)
        ratios = torch.cartesian_prod(axis, axis, axis).reshape(-1, 3)
        centres = torch.ones(4, n**3, 4)
        for chart in range(4):
            centres[chart][:, _OTHERS[chart]] = ratios
        return torch.nn.functional.normalize(centres.reshape(-1, 4), dim=-1)

    def centres(self, cell: Tensor) -> tuple[Tensor, Tensor]:
        """Cells (P,) int64 to the poses at their centres: positions (P, 3) m, quaternions (P, 4) wxyz."""
        device = cell.device
        position = self.voxel_centres().to(device)[cell % self.voxels]
        return position, self.rotation_centres().to(device)[cell // self.voxels]


@dataclass(frozen=True)
class Kernel:
    """Gaussian weights between cells of a grid, truncated at two standard deviations in translation and in rotation.

    The weight of two cells is the product of exp(-d^2 / 2 s^2) in translation and in rotation, d between the
    cells' centres: 1 within a cell, so that a support reads as a number of particles.

    Attributes:
        offset (M,) int32: what to add to a voxel's index to get its neighbours, itself among them.
        weight (M,) f32: of these.
        turn (R, N) int32: rotations near each rotation, itself among them; near works both ways.
        turn_weight (R, N) f32: of these; rotations with fewer neighbours are padded with weight 0, at the end.
    """

    offset: Tensor
    weight: Tensor
    turn: Tensor
    turn_weight: Tensor


@lru_cache
def _edges(n: int) -> Tensor:
    return torch.tan((torch.arange(1, n, dtype=torch.float64, device="cpu") / n - 0.5) * math.pi / 2)


@lru_cache(maxsize=4)
def gaussian_kernel(grid: SE3Grid, sigma: float, sigma_deg: float) -> Kernel:
    """Weights for standard deviations `sigma` (m) and `sigma_deg` (deg); 0 leaves the cell alone. On the CPU.

    Translation neighbours stay within one layer of voxels: the border that the grid keeps empty.
    """
    step = torch.arange(-1, 2)
    steps = torch.cartesian_prod(step, step, step)
    weight = _truncated_gaussian(steps.float().norm(dim=-1) * grid.voxel, sigma)
    offset = (steps[:, 0] * grid.side + steps[:, 1]) * grid.side + steps[:, 2]

    centres = grid.rotation_centres()
    dots = (centres @ centres.T).abs().clamp_(max=1.0)
    dots = torch.maximum(dots, dots.T)  # rounding may make a product of two differ from that of the other two
    turn_weight = _truncated_gaussian(2 * torch.acos(dots), math.radians(sigma_deg))
    turn_weight.fill_diagonal_(1.0)
    most = int((turn_weight > 0).sum(1).max())
    turn_weight, turn = turn_weight.topk(most, dim=1)
    return Kernel(offset[weight > 0].int(), weight[weight > 0], turn.int(), turn_weight)


def _truncated_gaussian(distance: Tensor, sigma: float) -> Tensor:
    if sigma == 0:
        return (distance == 0).float()
    weight = torch.exp(-0.5 * (distance / sigma) ** 2)
    return torch.where(distance <= 2 * sigma + 1e-6, weight, torch.zeros_like(weight))
