"""Spread features and non-maximum suppression: against loops, under motion, in another order, by hand."""

import math

import pytest
import torch

from spgf_torch.geometry import se3
from spgf_torch.proposing.sampling import farthest_point_sampling, non_maximum_suppression

HALF_TURN = torch.diag(torch.tensor([-1.0, -1, 1, 1], dtype=torch.float64))


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def crowd(n: int, generator: torch.Generator) -> torch.Tensor:
    """Poses of float64, close enough to suppress one another, some of them turned half round."""
    T = se3.pose(
        0.02 * torch.rand(n, 3, generator=generator, dtype=torch.float64),
        torch.tensor([1.0, 0, 0, 0]) + 0.15 * torch.randn(n, 4, generator=generator, dtype=torch.float64),
    )
    return torch.where((torch.rand(n, generator=generator) < 0.5)[:, None, None], T @ HALF_TURN, T)


def loop_suppression(
    T: torch.Tensor, group: torch.Tensor, score: torch.Tensor, distance: float, deg: float
) -> list[int]:
    """The definition: from the highest score down, a pose stays unless one that stays is near."""

    def near(a: int, b: int) -> bool:
        if group[a] != group[b] or float((T[a, :3, 3] - T[b, :3, 3]).norm()) > distance:
            return False
        angles = [float(se3.relative_angle(T[a], turned)) for turned in (T[b], T[b] @ HALF_TURN)]
        return math.degrees(min(angles)) <= deg

    kept: list[int] = []
    for i in sorted(range(len(T)), key=lambda i: (-float(score[i]), i)):
        if not any(near(i, j) for j in kept):
            kept.append(i)
    return kept


def test_suppression_equals_the_loop(generator: torch.Generator) -> None:
    T, score = crowd(150, generator), torch.rand(150, generator=generator).mul(20).round()  # with ties
    group = torch.randint(2, (150,), generator=generator)
    expected = loop_suppression(T, group, score, 0.01, 25.0)
    assert 20 < len(expected) < 120
    assert non_maximum_suppression(T, group, score, 0.01, 25.0).tolist() == expected


def test_suppression_in_any_frame_and_order(generator: torch.Generator) -> None:
    T, score = crowd(100, generator), torch.rand(100, generator=generator)
    group = torch.randint(2, (100,), generator=generator)
    kept = non_maximum_suppression(T, group, score, 0.01, 25.0)
    moved = se3.random_poses(1, generator).double() @ T
    assert torch.equal(non_maximum_suppression(moved, group, score, 0.01, 25.0), kept)
    order = torch.randperm(100, generator=generator)
    assert torch.equal(order[non_maximum_suppression(T[order], group[order], score[order], 0.01, 25.0)], kept)


def test_suppression_by_hand() -> None:
    """Four grasps: 1 lies 4 mm from 0, 2 lies there turned half round, 3 there too but turned a quarter: it stays."""
    quarter = torch.tensor([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=torch.float64)
    T = torch.eye(4, dtype=torch.float64).repeat(4, 1, 1)
    T[2:] = torch.stack([HALF_TURN, quarter])
    T[1:, 0, 3] = 0.004
    score, one_type = torch.tensor([0.5, 0.9, 0.4, 0.1]), torch.zeros(4, dtype=torch.long)
    assert non_maximum_suppression(T, one_type, score, 0.005, 20.0).tolist() == [1, 3]
    assert non_maximum_suppression(T, one_type, score, 0.003, 20.0).tolist() == [1, 0, 3]
    assert non_maximum_suppression(T, torch.tensor([0, 1, 0, 1]), score, 0.005, 20.0).tolist() == [1, 0, 3]
    assert non_maximum_suppression(T[:0], one_type[:0], score[:0], 0.005, 20.0).tolist() == []


def test_farthest_point_sampling_equals_the_loop(generator: torch.Generator) -> None:
    T = se3.random_poses(60, generator)
    point = torch.cat([T[:, :3, 3], 0.5 * T[:, :3, 2]], dim=1)
    chosen = [int((point - point.mean(0)).norm(dim=1).argmax())]
    while len(chosen) < 20:
        chosen.append(int(torch.cdist(point, point[chosen]).amin(1).argmax()))
    assert farthest_point_sampling(T, 20, 0.5).tolist() == chosen
    assert sorted(farthest_point_sampling(T, 100, 0.5).tolist()) == list(range(60))
    assert farthest_point_sampling(T[:0], 5, 0.5).tolist() == []


def test_farthest_point_sampling_sees_both_sides_of_a_wall() -> None:
    """Two pairs of features back to back: with normals in the distance the second is the other side, else not."""
    flip = torch.diag(torch.tensor([1.0, -1, -1, 1]))
    T = torch.eye(4).repeat(4, 1, 1)
    T[1] = T[3] = flip
    T[2:, 0, 3] = 0.05
    first, second = farthest_point_sampling(T, 2, 1.0).tolist()
    assert float(T[first, 2, 2] * T[second, 2, 2]) == -1
    assert sorted(T[farthest_point_sampling(T, 2, 0.0), 0, 3].tolist()) == pytest.approx([0, 0.05])
