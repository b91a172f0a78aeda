"""Arguments that every operator is tried with: small, of a seed, and reaching every branch."""

import torch

from spgf_torch.geometry import se3

Case = tuple[object, ...]


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def points_in_volume() -> list[Case]:
    """Points about two boxes, one of them open to a side; then none."""
    draws = generator()
    T = se3.random_poses(300, draws, extent=0.05)
    box = torch.cat([torch.eye(3), -torch.eye(3)])
    near = torch.cat([box, torch.tensor([0.05, 0.01, 0.02, -0.03, 0.01, 0.02])[:, None]], dim=1)
    far = torch.cat([box[:5], torch.tensor([-0.03, 0.01, 0.02, 0.05, 0.01])[:, None]], dim=1)
    bounds = torch.tensor([[-0.05, -0.01, -0.02], [0.05, 0.01, 0.02]])
    points = (torch.rand(40, 3, generator=draws) - 0.5) * 0.2
    volume = (torch.cat([near, far]), [6, 11], bounds)
    return [(points, T, *volume), (points[:0], T, *volume), (points, T[:0], *volume)]


CASES = {"points_in_volume": points_in_volume}
