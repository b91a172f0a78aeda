"""The start cell: plain maximum, runs of gaps, and that it goes round with the ring."""

import math

import numpy as np
import pytest
import torch

from spgf_torch.ops import alignment
from spgf_torch.ops.alignment import TIE, _run_lengths, aligned_poses, start_at

RIGHT = math.pi / 2


def rings_of(curvature: torch.Tensor) -> torch.Tensor:
    """Rings (N, 2, cells, 2) whose top alpha2 is given and that are otherwise 0."""
    rings = torch.zeros((len(curvature), 2, curvature.shape[1], 2))
    rings[:, 0, :, 1] = curvature
    return rings


def highest_curvature(rings: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(alignment.highest_curvature(rings.numpy()))


def aligned(rings: torch.Tensor, start: torch.Tensor) -> torch.Tensor:
    moved = torch.empty_like(rings)
    start_at(rings.numpy(), start.numpy(), np.arange(len(rings)), moved.numpy())
    return moved


def with_gaps(*cells: int) -> torch.Tensor:
    curvature = torch.full((1, 36), 0.2)
    curvature[0, list(cells)] = RIGHT
    return rings_of(curvature)


def test_a_single_maximum_is_the_start():
    curvature = torch.rand((50, 36), generator=torch.Generator().manual_seed(0))
    assert torch.equal(highest_curvature(rings_of(curvature)), curvature.argmax(dim=1))


@pytest.mark.parametrize(
    ("cells", "start"),
    [
        ([10, 11, 12], 11),  # an odd run: its centre
        ([10, 11, 12, 13], 11),  # an even run: the first of the two
        ([34, 35, 0, 1, 2], 0),  # across the end of the ring
        ([3, 20, 21, 22], 21),  # the widest of two
        ([20, 21, 22, 3], 21),
        ([7], 7),
    ],
)
def test_the_centre_of_the_widest_run_wins(cells, start):
    assert highest_curvature(with_gaps(*cells)).tolist() == [start]


def test_equal_runs_are_told_apart_by_what_follows():
    """Two runs of three cells; the surface falls away (alpha1 = 0.5) after the second one only."""
    rings = with_gaps(5, 6, 7, 25, 26, 27)
    rings[0, 0, 30, 0] = 0.5
    assert highest_curvature(rings).tolist() == [26]
    rings[0, 0, 30, 0], rings[0, 1, 30, 0] = 0, 0.5  # seen in the bottom layer only
    assert highest_curvature(rings).tolist() == [26]


def test_a_ring_that_is_all_gap_starts_by_the_other_layer():
    """No top neighbour at all (a spike's tip from behind): what the bottom layer shows decides, going round."""
    rings = rings_of(torch.full((1, 36), RIGHT))
    rings[0, 1, :, 0] = 0.4
    rings[0, 1, 12:15, 0] = 0.9
    assert highest_curvature(rings.roll(5, dims=2)).item() == (highest_curvature(rings).item() + 5) % 36


def test_differences_below_the_tie_do_not_break_a_run():
    rings = with_gaps(10, 11, 12)
    rings[0, 0, 12, 1] += 0.5 * TIE
    assert highest_curvature(rings).tolist() == [11]
    rings[0, 0, 12, 1] += TIE
    assert highest_curvature(rings).tolist() == [12]


@pytest.mark.parametrize("cells", [4, 36, 180])
def test_the_start_goes_round_with_the_ring(cells):
    """Rings of random gap patterns and random content, turned by every number of cells: the aligned rings stay."""
    generator = torch.Generator().manual_seed(0)
    rings = torch.rand((100, 2, cells, 2), generator=generator)
    gap = torch.rand((100, cells), generator=generator) < torch.linspace(0, 1, 100)[:, None]
    rings[:, 0] = torch.where(gap[:, :, None], RIGHT, rings[:, 0])
    before = aligned(rings, highest_curvature(rings))
    for turn in range(1, cells, max(1, cells // 12)):
        around = rings.roll(turn, dims=2)
        assert torch.equal(aligned(around, highest_curvature(around)), before)


def test_run_lengths_against_a_walk():
    tied = torch.rand((200, 10), generator=torch.Generator().manual_seed(0)) < torch.linspace(0, 1, 200)[:, None]
    lengths = np.empty(10, np.int64)
    for row in tied.tolist():
        _run_lengths(np.array(row), lengths)
        for cell in range(10):
            walk = next((k for k in range(10) if not row[(cell + k) % 10]), 10)
            is_first = row[cell] and (not row[cell - 1] or all(row))
            assert lengths[cell] == (walk if is_first else 0)


def test_start_at_moves_both_layers_to_their_rows():
    rings, moved = torch.arange(2 * 2 * 8 * 2.0).view(2, 2, 8, 2), torch.zeros((3, 2, 8, 2))
    start_at(rings.numpy(), np.array([3, 0]), np.array([2, 0]), moved.numpy())
    assert torch.equal(moved[2], rings[0].roll(-3, dims=1))
    assert torch.equal(moved[0], rings[1])
    assert not moved[1].any()


def test_poses_turn_the_frame_to_the_start_cell():
    """A quarter of the ring onwards x is where y was; the normal stays."""
    frame = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # columns: x = R_y of the world, and so on
    frames, positions = np.stack([frame.numpy()] * 2), np.array([[1, 2, 3]] * 2, np.float32)
    T = torch.from_numpy(aligned_poses(frames, np.array([0, 9]), 36, positions))
    assert torch.equal(T[0, :3, :3], frame)
    assert torch.allclose(T[1, :3, :3], torch.stack([frame[:, 1], -frame[:, 0], frame[:, 2]], dim=1), atol=1e-7)
    assert T[:, :3, 3].tolist() == [[1, 2, 3]] * 2
    assert T[:, 3].tolist() == [[0, 0, 0, 1]] * 2
