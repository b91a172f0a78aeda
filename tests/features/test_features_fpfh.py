"""Open3D's histograms against the definition, in a slow loop."""

import math

import numpy as np
import pytest
import torch

from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.fpfh import fpfh
from spgf_torch.features.spgf import spgf
from spgf_torch.settings import settings

pytest.importorskip("open3d")

CONFIG = settings(FeatureConfig, descriptor="fpfh")


def test_the_pose_is_that_of_spgf() -> None:
    draws = torch.Generator().manual_seed(0)
    normals = torch.nn.functional.normalize(torch.randn(150, 3, generator=draws), dim=1)
    ours, theirs = fpfh(0.03 * normals, normals, CONFIG), spgf(0.03 * normals, normals, CONFIG)
    assert torch.equal(ours.T_object_feature, theirs.T_object_feature) and torch.equal(ours.valid, theirs.valid)


def test_a_plane_fills_three_bins() -> None:
    """On a plane the angle theta and both projections of the directions vanish: the middle bin of each histogram."""
    grid = torch.stack(torch.meshgrid(torch.arange(9.0), torch.arange(9.0), indexing="ij"), dim=-1).view(-1, 2)
    positions = torch.cat([0.005 * grid, torch.zeros(81, 1)], dim=1)
    found = fpfh(positions, torch.tensor([[0.0, 0.0, 1.0]]).expand(81, 3), CONFIG).relations()
    expected = torch.zeros(33)
    expected[[5, 16, 27]] = 1
    assert torch.allclose(found, expected.expand(81, 33), atol=1e-6)


def test_the_loop_of_the_paper() -> None:
    draws = torch.Generator().manual_seed(1)
    normals = torch.nn.functional.normalize(torch.randn(60, 3, generator=draws, dtype=torch.float64), dim=1)
    positions = 0.03 * normals * (1 + 0.1 * torch.rand(60, 1, generator=draws, dtype=torch.float64))
    expected = slow_fpfh(positions.numpy(), normals.numpy(), CONFIG.radius)
    found = fpfh(positions, normals, CONFIG).relations().numpy()
    close = np.abs(found - expected).max(axis=1) < 1e-4
    assert close.mean() > 0.95  # where a value lies on the border of two bins, rounding decides


def slow_fpfh(points: np.ndarray, normals: np.ndarray, radius: float) -> np.ndarray:
    """Rusu et al. (2009), Eqs. 1 to 3, with Open3D's weights: 1 / squared distance, scaled to one histogram in all."""
    N = len(points)
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    near = [[j for j in range(N) if j != i and distance[i, j] <= radius] for i in range(N)]
    simple = np.zeros((N, 33))
    for i in range(N):
        for j in near[i]:
            for k, bin_ in enumerate(bins(points[i], normals[i], points[j], normals[j])):
                simple[i, 11 * k + bin_] += 1 / len(near[i])
    full = np.zeros((N, 33))
    for i in range(N):
        weighted = sum(simple[j] / distance[i, j] ** 2 for j in near[i])
        for k in range(3):
            part = slice(11 * k, 11 * k + 11)
            full[i, part] = (simple[i, part] + weighted[part] / weighted[part].sum()) / 2
    return full


def bins(p1: np.ndarray, n1: np.ndarray, p2: np.ndarray, n2: np.ndarray) -> list[int]:
    """Eq. 1: theta, alpha, phi of a pair; the source is the one whose normal is closer to the line between them."""
    d = (p2 - p1) / np.linalg.norm(p2 - p1)
    if abs(n1 @ d) < abs(n2 @ d):
        n1, n2, d = n2, n1, -d
    v = np.cross(d, n1)
    v /= np.linalg.norm(v)
    theta = math.atan2(np.cross(n1, v) @ n2, n1 @ n2)
    shares = ((theta + math.pi) / (2 * math.pi), (v @ n2 + 1) / 2, (n1 @ d + 1) / 2)
    return [min(10, max(0, math.floor(11 * share))) for share in shares]
