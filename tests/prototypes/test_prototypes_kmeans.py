"""The steps of k-means: by hand, against loops in float64, and their symmetries."""

import pytest
import torch
from torch import Tensor

from spgf_torch.ops import assignment
from spgf_torch.ops import lloyd as lloyd_operator
from spgf_torch.ops.lloyd import nearest_of, reassign_empty
from spgf_torch.prototypes.kmeans import (
    assign,
    canonical_order,
    inertia,
    kmeans_plusplus,
    lloyd,
    minibatch_step,
)

FOUR_POINTS = torch.tensor([[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [1.0, 1.0]])
CORNERS = torch.tensor([[0.0, 0.0], [1.0, 1.0]])


def random_data(points: int = 200, dims: int = 7, clusters: int = 5, seed: int = 0) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(points, dims, generator=generator), torch.randn(clusters, dims, generator=generator)


def lloyd_step_loop(points: Tensor, centres: Tensor) -> tuple[list[int], Tensor, float]:
    """The obvious loops, in float64: ids, new centres, inertia of the old ones."""
    rows, places = points.double().tolist(), centres.double().tolist()
    ids, least = [], []
    for row in rows:
        distances = [sum((a - b) ** 2 for a, b in zip(row, place, strict=True)) for place in places]
        ids.append(distances.index(min(distances)))
        least.append(min(distances))
    moved, farthest = [], sorted(range(len(rows)), key=least.__getitem__)
    for k in range(len(places)):
        members = [rows[i] for i, home in enumerate(ids) if home == k]
        middle = [sum(axis) / len(members) for axis in zip(*members, strict=True)]
        moved.append(middle if members else rows[farthest.pop()])
    return ids, torch.tensor(moved, dtype=torch.float64), sum(least)


def lloyd_step(points: Tensor, centres: Tensor) -> Tensor:
    return lloyd(points, centres, 1, 0.0)[0]


def test_four_points_by_hand() -> None:
    """Squared distances to (0, 0): 0, 1/4, 5/4, 2, to (1, 1): 2, 5/4, 1/4, 0. So two and two, inertia 1/2.

    The means are (1/4, 0) and (3/4, 1), each point 1/4 away from its own: inertia 4 / 16, and nobody moves again.
    """
    assert assign(FOUR_POINTS, CORNERS).tolist() == [0, 0, 1, 1]
    assert inertia(FOUR_POINTS, CORNERS) == pytest.approx(0.5)
    centres, counts = lloyd(FOUR_POINTS, CORNERS, 1, 0.0)
    assert torch.allclose(centres, torch.tensor([[0.25, 0.0], [0.75, 1.0]]))
    assert counts.tolist() == [2, 2]
    assert inertia(FOUR_POINTS, centres) == pytest.approx(0.25)
    assert torch.allclose(lloyd(FOUR_POINTS, CORNERS, 10, 0.0)[0], centres)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("size", [1 << 20, 16])
def test_steps_equal_the_loops(dtype: torch.dtype, size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assignment, "CHUNK", size)
    monkeypatch.setattr(lloyd_operator, "PART", size)
    points, centres = (data.to(dtype) for data in random_data())
    ids, moved, total = lloyd_step_loop(points, centres)
    distance, found = nearest_of(points, centres)
    assert assign(points, centres).tolist() == found.tolist() == ids
    new = lloyd_step(points, centres)
    assert new.dtype == dtype and torch.allclose(new.double(), moved, atol=1e-5)
    assert inertia(points, centres) == pytest.approx(total, rel=1e-5)
    assert torch.allclose(distance, (points - centres[found]).square().sum(1), atol=1e-4)


@pytest.mark.parametrize(("clusters", "spread"), [(1, 0.0), (2, 0.0), (5, 0.0), (12, 0.0), (12, 5.0), (40, 2.0)])
def test_many_steps_equal_the_loops(clusters: int, spread: float) -> None:
    """What the bounds leave out changes nothing: points at random, and about places that are `spread` apart."""
    points, centres = random_data(150, 6, clusters, seed=3)
    points += spread * centres[torch.arange(150) % clusters]
    expected = centres.double()
    for steps in range(1, 11):
        expected = lloyd_step_loop(points, expected)[1]
        if steps in (2, 5, 10):
            found, counts = lloyd(points, centres, steps, -1.0)
            assert torch.allclose(found.double(), expected, atol=1e-5)
            assert torch.equal(counts, torch.bincount(assign(points, found), minlength=clusters))


def test_one_and_two_threads_step_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lloyd_operator, "PART", 64)
    points, centres = random_data(1000, 20, 8)
    threads = torch.get_num_threads()
    try:
        found = []
        for count in (1, 2):
            torch.set_num_threads(count)
            found.append(lloyd(points, centres, 10, 0.0)[0])
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(*found)


def test_assigning_nothing_gives_nothing() -> None:
    assert assign(torch.zeros(0, 2), CORNERS).shape == (0,)


def test_lloyd_never_raises_the_inertia() -> None:
    points, centres = random_data()
    history = [inertia(points, lloyd(points, centres, steps, -1.0)[0]) for steps in range(1, 11)]
    assert history == sorted(history, reverse=True) and history[-1] < history[0]


def test_turned_and_moved_points_get_turned_and_moved_centres() -> None:
    points, centres = random_data()
    turn = torch.linalg.qr(torch.randn(7, 7, generator=torch.Generator().manual_seed(1))).Q
    moved = lloyd_step(points @ turn + 3, centres @ turn + 3)
    assert torch.allclose(moved, lloyd_step(points, centres) @ turn + 3, atol=1e-4)


def test_order_of_points_and_centres_does_not_matter() -> None:
    points, centres = random_data()
    shuffled = points[torch.randperm(len(points), generator=torch.Generator().manual_seed(2))]
    assert torch.allclose(lloyd_step(shuffled, centres.flip(0)).flip(0), lloyd_step(points, centres), atol=1e-5)


def test_a_batch_of_everything_is_a_lloyd_step() -> None:
    """Centres that stand for no point yet become the mean of what they are given; rows need not lie together."""
    points, centres = random_data()
    for batch in (points, torch.stack([points, points], dim=1)[:, 0]):
        moved, counts = minibatch_step(batch, centres, torch.zeros(len(centres)))
        assert torch.allclose(moved, lloyd_step(points, centres), atol=1e-5)
        assert torch.equal(counts, torch.bincount(assign(points, centres), minlength=len(centres)).float())


def test_minibatch_by_hand() -> None:
    """(0, 0) stands for 3 points and is given (2, 0): (3 * 0 + 2) / 4 = 0.5; the other centre is given nothing."""
    centres = torch.tensor([[0.0, 0.0], [9.0, 9.0]])
    moved, counts = minibatch_step(torch.tensor([[2.0, 0.0]]), centres, torch.tensor([3.0, 0.0]))
    assert moved.tolist() == [[0.5, 0.0], [9.0, 9.0]]
    assert counts.tolist() == [4.0, 0.0]


def test_empty_clusters_take_the_farthest_points() -> None:
    """Both far centres are empty: the nearest centre (0, 0) is 2 and 5/4 away from the points 3 and 2."""
    centres = torch.tensor([[50.0, 0.0], [0.0, 0.0], [60.0, 0.0]])
    moved = lloyd_step(FOUR_POINTS, centres)
    assert moved[0].tolist() == [1.0, 1.0] and moved[2].tolist() == [0.5, 1.0]
    assert moved[1].tolist() == [0.5, 0.5]
    full = torch.tensor([1.0, 2.0, 3.0])
    assert reassign_empty(FOUR_POINTS, centres, full, torch.zeros(4)) is centres


def test_lloyd_fills_every_cluster_that_points_can_fill() -> None:
    """Five distinct values, twenty copies each, five centres that start on one spot: one centre a value."""
    values = torch.arange(5.0)[:, None] * torch.ones(1, 3)
    centres, counts = lloyd(values.repeat(20, 1), torch.zeros(5, 3), 50, 0.0)
    assert torch.allclose(centres.sort(0).values, values) and counts.tolist() == [20] * 5


def test_plusplus_draws_no_copy_while_others_are_left() -> None:
    values = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 5.0], [7.0, 7.0]])
    starts = kmeans_plusplus(values.repeat(25, 1), 4, 10, torch.Generator().manual_seed(0))
    assert starts.shape == (10, 4, 2)
    for start in starts:
        assert sorted(start.tolist()) == sorted(values.tolist())


def test_plusplus_is_a_function_of_its_generator() -> None:
    points, _ = random_data()
    first, same, other = (
        kmeans_plusplus(points, 4, 3, torch.Generator().manual_seed(seed), tries)
        for seed, tries in ((0, 2),) * 2 + ((1, 2),)
    )
    assert torch.equal(first, same) and not torch.equal(first, other)


def test_plusplus_draws_by_squared_distance() -> None:
    """From 0, the points 1 and 3 are drawn in the ratio 1 : 9 (from 1: 1 : 4, from 3: 9 : 4), without greed."""
    points = torch.tensor([[0.0], [1.0], [3.0]])
    starts = kmeans_plusplus(points, 2, 30_000, torch.Generator().manual_seed(0), tries=1)[:, :, 0]
    after_zero = starts[starts[:, 0] == 0, 1]
    assert float((after_zero == 3).float().mean()) == pytest.approx(0.9, abs=0.01)


def test_plusplus_draws_by_weight() -> None:
    """Of 0, 1 and 3 with weights 2, 1 and 1, half of the starts begin at 0, and go on to 3 in 9 of 10."""
    points, weights = torch.tensor([[0.0], [1.0], [3.0]]), torch.tensor([2.0, 1.0, 1.0])
    generator = torch.Generator().manual_seed(0)
    starts = kmeans_plusplus(points, 2, 30_000, generator, tries=1, weights=weights)[:, :, 0]
    zero = starts[:, 0] == 0
    assert float(zero.float().mean()) == pytest.approx(0.5, abs=0.01)
    assert float((starts[zero, 1] == 3).float().mean()) == pytest.approx(0.9, abs=0.01)


def test_canonical_order_is_by_count_then_coordinates() -> None:
    centres = torch.tensor([[2.0, 0.0], [1.0, 5.0], [1.0, 4.0], [0.0, 0.0]])
    assert canonical_order(centres, torch.tensor([7, 7, 7, 9])).tolist() == [3, 2, 1, 0]
