"""Neighbour pairs against a loop over all pairs."""

import pytest
import torch

from spgf_torch.config import InputError
from spgf_torch.geometry import neighbours
from spgf_torch.geometry.neighbours import HalfPairs, half_pairs, radius_pairs


def loop_pairs(points: torch.Tensor, radius: float) -> list[tuple[int, int]]:
    p = points.double()
    return [(i, j) for i in range(len(p)) for j in range(len(p)) if i != j and (p[i] - p[j]).norm() <= radius]


def as_list(pairs: tuple[torch.Tensor, torch.Tensor]) -> list[tuple[int, int]]:
    return list(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True))


@pytest.fixture
def cloud() -> torch.Tensor:
    points = torch.rand((60, 3), generator=torch.Generator().manual_seed(0))
    return torch.cat([points, points[:3]])  # three of them twice


@pytest.mark.parametrize("block", [4096, 20, 1])
@pytest.mark.parametrize("search", ["_by_trees", "_by_distances"])
def test_pairs_are_those_of_the_loop_in_its_order(cloud, block, search, monkeypatch):
    monkeypatch.setattr(neighbours, "BLOCK", block)
    monkeypatch.setattr(neighbours, "_by_trees", getattr(neighbours, search))
    assert as_list(radius_pairs(cloud, 0.3)) == loop_pairs(cloud, 0.3)


def test_half_pairs_name_each_pair_once(cloud, monkeypatch):
    monkeypatch.setattr(neighbours, "BLOCK", 20)
    once = [tuple(sorted(pair)) for part in half_pairs(cloud, 0.3) for pair in as_list(part)]
    assert sorted(once) == [(i, j) for i, j in loop_pairs(cloud, 0.3) if i < j]


def test_the_radius_itself_belongs():
    assert as_list(radius_pairs(torch.tensor([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5001, 0]]), 0.5)) == [(0, 1), (1, 0)]


@pytest.mark.parametrize("N", [0, 1])
def test_too_few_points_have_no_pairs(N):
    centre, neighbour = radius_pairs(torch.zeros((N, 3)), 1.0)
    assert centre.shape == neighbour.shape == (0,)
    assert centre.dtype == neighbour.dtype == torch.int64


@pytest.mark.parametrize("bad", [torch.zeros(3), torch.zeros((4, 2)), torch.tensor([[0.0, float("nan"), 0.0]])])
def test_unusable_points_are_named(bad):
    with pytest.raises(InputError, match="points: expected"):
        radius_pairs(bad, 0.1)


@pytest.mark.parametrize("kept", [1 << 24, 10])
def test_pairs_can_be_gone_through_twice(monkeypatch, kept):
    """Whether they are kept or searched for again."""
    monkeypatch.setattr(neighbours, "KEPT", kept)
    monkeypatch.setattr(neighbours, "BLOCK", 16)
    points = torch.rand((60, 3), generator=torch.Generator().manual_seed(0))
    pairs, once = HalfPairs(points, 0.3), list(half_pairs(points, 0.3))
    for _ in range(2):
        for (i, j), (k, m) in zip(pairs, once, strict=True):
            assert torch.equal(i, k) and torch.equal(j, m)
