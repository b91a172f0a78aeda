"""Neighbour pairs against a loop over all pairs."""

import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.ops import neighbours
from spgf_torch.ops.neighbours import Neighbourhoods, radius_pairs


def loop_pairs(points: torch.Tensor, radius: float) -> list[tuple[int, int]]:
    p = points.double()
    return [(i, j) for i in range(len(p)) for j in range(len(p)) if i != j and (p[i] - p[j]).norm() <= radius]


def as_list(pairs: tuple[torch.Tensor, torch.Tensor]) -> list[tuple[int, int]]:
    return list(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True))


@pytest.fixture
def cloud() -> torch.Tensor:
    points = torch.rand((60, 3), generator=torch.Generator().manual_seed(0))
    return torch.cat([points, points[:3]])  # three of them twice


@pytest.mark.parametrize("candidates", [1 << 18, 200, 1])
@pytest.mark.parametrize("scale", [1.0, 40.0, 1e12])
def test_pairs_are_those_of_the_loop_in_its_order(cloud, scale, candidates, monkeypatch):
    """In one part or in many; close together and so far apart that cubes cannot be counted through."""
    monkeypatch.setattr(neighbours, "CANDIDATES", candidates)
    far = torch.cat([cloud, cloud[:5] + scale])
    assert as_list(radius_pairs(far, 0.3)) == loop_pairs(far, 0.3)


@pytest.mark.parametrize("radius", [1e-6, 0.07, 5.0])
def test_any_radius(cloud, radius):
    assert as_list(radius_pairs(cloud, radius)) == loop_pairs(cloud, radius)


def test_parts_are_the_order_cut_by_candidates(cloud, monkeypatch):
    monkeypatch.setattr(neighbours, "CANDIDATES", 100)
    near = Neighbourhoods(cloud, 0.3)
    assert sorted(near.order.tolist()) == list(range(63))
    assert [place for part in near.parts for place in range(part.start, part.stop)] == list(range(63))
    found = set()
    for part in near.parts:
        start, neighbour = near.of(part)
        for centre, a, b in zip(near.order[part].tolist(), start[:-1], start[1:], strict=True):
            found |= {(centre, int(near.order[place])) for place in neighbour[a:b]}
    assert found == set(loop_pairs(cloud, 0.3))


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
