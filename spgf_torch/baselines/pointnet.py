"""A PointNet that scores grasps, what it is taught with, and what its errors cost. Torch only.

A cloud is taken as the set that it is: every point goes through the same layers alone, the maximum over the points
goes on (Qi et al., PointNet, CVPR 2017, without T-nets: the frame is the grasp's own).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, one_hot

from spgf_torch.baselines.config import AugmentConfig, NetworkConfig
from spgf_torch.geometry.se3 import rotation_about

CHUNK = 512  # clouds scored at once: the activations of a layer stay below 100 MB


class PointNet(nn.Module):
    """Logits of success; taught with as many successes as failures of a type, they are log-odds against its base rate.

    Args:
        types: the number of grasp types. radius: m, of the clouds: the network's unit of length.
        generator: draws the first weights.
    """

    radius: Tensor

    def __init__(self, config: NetworkConfig, types: int, radius: float, generator: torch.Generator) -> None:
        super().__init__()
        self.register_buffer("radius", torch.tensor(radius))
        self.frequencies, self.types = config.frequencies, types
        self.points = _layers([3 + 6 * config.frequencies + types, *config.widths], generator)
        self.head = nn.Sequential(
            _layers([config.widths[-1], *config.head], generator),
            _linear([*config.widths, *config.head][-1], 1, generator),
        )

    def forward(self, cloud: Tensor, grasp_type: Tensor) -> Tensor:
        """Logits (B,) of clouds (B, P, 3), m, frame tcp, and types (B,) int64."""
        kind = one_hot(grasp_type, self.types).to(cloud.dtype)
        told = torch.cat(
            [fourier(cloud / self.radius, self.frequencies), kind[:, None].expand(-1, cloud.shape[1], -1)], 2
        )
        found: Tensor = self.points(told.flatten(0, 1))
        return self.head(found.unflatten(0, told.shape[:2]).amax(dim=1)).squeeze(1)


def fourier(x: Tensor, frequencies: int) -> Tensor:
    """(..., D) -> (..., D + 2 D F): x, then sin and cos of pi x, 2 pi x, 4 pi x, ...

    Narrow layers tell places apart that are millimetres from each other, where a finger would hit and where not, only
    if these are far apart in what they are given (Tancik et al., Fourier Features, NeurIPS 2020).
    """
    phase = (x[..., None] * (math.pi * 2.0 ** torch.arange(frequencies, device=x.device, dtype=x.dtype))).flatten(-2)
    return torch.cat([x, phase.sin(), phase.cos()], dim=-1)


@torch.no_grad()
def grasp_logits(network: PointNet, cloud: Tensor, grasp_type: Tensor) -> Tensor:
    """Logits (S,) f32 of clouds (S, P, 3) of any precision, in parts."""
    parts = zip(cloud.split(CHUNK), grasp_type.split(CHUNK), strict=True)
    return torch.cat([network(some.float(), kinds) for some, kinds in parts])


def balanced_loss(logit: Tensor, grasp_type: Tensor, success: Tensor) -> Tensor:
    """Mean cross-entropy over the kinds of trials, each being a type and an outcome, however many each has."""
    each = binary_cross_entropy_with_logits(logit, success.to(logit.dtype), reduction="none")
    return (each * balance(grasp_type, success).to(each)).sum()


def balance(grasp_type: Tensor, success: Tensor) -> Tensor:
    """(S,) f64 weights that sum to 1, the same sum for every type and outcome that occurs."""
    kind = 2 * grasp_type + success
    count = torch.bincount(kind)
    return 1 / (count[kind].double() * (count > 0).sum())


def augmented(cloud: Tensor, symmetric: Tensor, config: AugmentConfig, generator: torch.Generator) -> Tensor:
    """Clouds (B, P, 3) -> (B, P', 3): fewer points, mirrored, turned and shifted as a whole, each point moved.

    The mirror image is that of x, the closing direction: it exchanges the two fingers of a hand that is `symmetric`
    (B,) bool; others are not mirrored.
    """

    def noise(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, device=cloud.device)

    B = len(cloud)
    chosen = torch.randperm(cloud.shape[1], generator=generator, device=cloud.device)[: config.points]
    moved = cloud[:, chosen]
    if config.mirror:
        half = torch.rand(B, 1, generator=generator, device=cloud.device) < 0.5
        sign = 1 - 2 * (half & symmetric[:, None]).to(cloud.dtype)
        moved = torch.cat([moved[..., :1] * sign[:, None], moved[..., 1:]], dim=2)
    if config.rotation_deg:
        moved = moved @ rotation_about(math.radians(config.rotation_deg) * noise(B, 3))
    return moved + config.shift * noise(B, 1, 3) + config.jitter * noise(*moved.shape)


def _layers(widths: Sequence[int], generator: torch.Generator) -> nn.Sequential:
    """Linear layers with ReLU behind each."""
    return nn.Sequential(
        *(part for a, b in pairwise(widths) for part in (_linear(a, b, generator), nn.ReLU(inplace=True)))
    )


def _linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """A linear layer whose outputs have the variance of its inputs behind a ReLU (He et al. 2015)."""
    layer = nn.Linear(inputs, outputs)
    nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu", generator=generator)
    nn.init.zeros_(layer.bias)
    return layer
