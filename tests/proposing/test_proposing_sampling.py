"""Spread features and non-maximum suppression: against loops, under motion, in another order, by hand."""

import math

import pytest
import torch

from spgf_torch.geometry import se3
from spgf_torch.proposing.sampling import farthest_point_sampling, non_maximum_suppression, same_grasp

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


def turn(deg: float) -> torch.Tensor:
    """(4, 4) f64 about the approach."""
    half = math.radians(deg) / 2
    return se3.pose(torch.zeros(3).double(), torch.tensor([math.cos(half), 0, 0, math.sin(half)]).double())


@pytest.mark.parametrize("symmetry", [1, 2, 3, 4, 5])
def test_turns_that_make_the_same_grasp(symmetry: int, generator: torch.Generator) -> None:
    """Any pose turned by multiples of 360 deg / n is the same grasp, on any side of a displacement and in any frame;
    turned by 20 deg more or less, or by half such a turn, or about another axis it is not."""
    poses, frame = se3.random_poses(20, generator).double(), se3.random_poses(1, generator)[0].double()
    step = 360 / symmetry
    for k in range(1, symmetry + 1):
        for T in poses:
            apart = [turn(k * step), turn(k * step + 20), turn(k * step - 20), turn((k + 0.5) * step)]
            aside = torch.diag(torch.tensor([1.0, -1, -1, 1]).double())
            others = frame @ torch.stack([T, *(T @ d for d in apart), T @ turn(k * step) @ aside])
            found = same_grasp(others, 1e-6, 19.0, symmetry)
            assert found[0].tolist() == [True, True, False, False, False, False]
            assert torch.equal(found, found.mT)


def test_the_same_grasp_by_two_types(generator: torch.Generator) -> None:
    """A pinch (2) and a power grasp (1): half a turn of the one is the same pinch, so they are one grasp either way; a
    quarter is not. A pinch and a sphere (3) are one at each 60 deg; two power grasps half a turn apart are two."""
    T = se3.random_poses(1, generator)[0].double()
    for first, second, alike in ((2, 1, {0, 180}), (2, 3, set(range(0, 360, 60))), (1, 1, {0}), (3, 3, {0, 120, 240})):
        for deg in range(0, 360, 30):
            both = torch.stack([T, T @ turn(deg)])
            found = same_grasp(both, 0.001, 10.0, torch.tensor([first, second]))
            assert bool(found[0, 1]) == bool(found[1, 0]) == (deg in alike)
    T = torch.eye(4).double().repeat(4, 1, 1)
    T[1::2] = HALF_TURN
    group, score, turns = torch.tensor([0, 0, 1, 1]), torch.tensor([0.4, 0.3, 0.2, 0.1]), torch.tensor([2, 2, 1, 1])
    assert non_maximum_suppression(T, group, score, 0.005, 20.0, turns).tolist() == [0, 2, 3]
    assert non_maximum_suppression(T, torch.zeros_like(group), score, 0.005, 20.0, turns).tolist() == [0]


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
