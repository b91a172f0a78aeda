"""The lattice over SE(3): closed-form indices agree with the cells' centres, and cells are as small as said."""

import math

import pytest
import torch

from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import SE3Grid, gaussian_kernel

GRID = SE3Grid(reach=0.05, voxel=0.01, rotation_deg=30.0)


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def random_quaternions(n: int, generator: torch.Generator) -> torch.Tensor:
    return se3.quaternion_of(se3.random_poses(n, generator))


def test_centres_lie_in_their_own_cells() -> None:
    rotation = torch.arange(GRID.rotations)
    assert torch.equal(GRID.rotation_index(GRID.rotation_centres()), rotation)
    inner = ((GRID.voxel_centres().abs() / GRID.voxel) < GRID.side / 2 - 1).all(1)
    assert torch.equal(GRID.voxel_index(GRID.voxel_centres())[inner], torch.arange(GRID.voxels)[inner])


def test_opposite_quaternions_are_one_rotation(generator: torch.Generator) -> None:
    q = random_quaternions(2000, generator)
    assert torch.equal(GRID.rotation_index(q), GRID.rotation_index(-q))


def test_rotation_cells_are_no_wider_than_said(generator: torch.Generator) -> None:
    """A cell spans at most 30 deg an axis: a member is at most sqrt(3) * 15 deg from the centre."""
    q = random_quaternions(20_000, generator)
    centre = GRID.rotation_centres()[GRID.rotation_index(q)]
    angle = 2 * torch.acos((q * centre).sum(1).abs().clamp(max=1))
    assert math.degrees(angle.max()) <= math.sqrt(3) * 15 + 1e-3


def test_positions_within_reach_keep_a_free_border(generator: torch.Generator) -> None:
    direction = torch.nn.functional.normalize(torch.randn(5000, 3, generator=generator), dim=1)
    position = direction * GRID.reach * torch.rand(5000, 1, generator=generator)
    centre = GRID.voxel_centres()[GRID.voxel_index(position)]
    assert (position - centre).abs().max() <= GRID.voxel / 2 + 1e-7
    i = GRID.voxel_index(position)
    for axis in (i // GRID.side**2, i // GRID.side % GRID.side, i % GRID.side):
        assert int(axis.min()) >= 1 and int(axis.max()) <= GRID.side - 2


def test_index_and_centres_are_inverse(generator: torch.Generator) -> None:
    direction = torch.nn.functional.normalize(torch.randn(3000, 3, generator=generator), dim=1)
    cell = GRID.index(direction * 0.04, random_quaternions(3000, generator))
    assert torch.equal(GRID.index(*GRID.centres(cell)), cell)


def test_kernel_weights_by_hand() -> None:
    """At one standard deviation a Gaussian weighs exp(-1/2); voxel faces are 10 mm away, corners 17.3 > 2 * 6 mm."""
    kernel = gaussian_kernel(GRID, sigma=0.01, sigma_deg=0.0)
    weights = dict(zip(kernel.offset.tolist(), kernel.weight.tolist(), strict=True))
    assert weights[0] == 1.0
    assert weights[1] == pytest.approx(math.exp(-0.5))
    assert weights[GRID.side + 1] == pytest.approx(math.exp(-1.0))
    assert len(gaussian_kernel(GRID, 0.006, 0.0).weight) == 7  # the centre and six faces
    assert kernel.turn.tolist() == [[r] for r in range(GRID.rotations)] and (kernel.turn_weight == 1).all()


def test_rotation_neighbours_are_all_within_two_deviations() -> None:
    kernel = gaussian_kernel(GRID, sigma=0.0, sigma_deg=15.0)
    centres = GRID.rotation_centres().double()
    angle = torch.rad2deg(2 * torch.acos((centres @ centres.T).abs().clamp(max=1)))
    expected = torch.where(angle <= 30.0 + 1e-4, torch.exp(-0.5 * (angle / 15.0) ** 2), torch.zeros_like(angle))
    found = torch.zeros_like(expected)
    found.scatter_add_(1, kernel.turn.long(), kernel.turn_weight.double())
    assert torch.allclose(found, expected, atol=2e-3)
    assert torch.equal(found, found.T)
    assert (kernel.turn_weight.diff(dim=1) <= 0).all()  # what is padded comes last
