"""The search for a start: it leaves local optima that Lloyd steps are caught in."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from spgf_torch.ops.kmeans_start import Weighted, settle
from spgf_torch.prototypes import kmeans_search
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import inertia, lloyd
from spgf_torch.prototypes.kmeans_search import (
    AXES_FROM,
    Settled,
    Summary,
    _added,
    _kept,
    breathe,
    initial_centres,
    principal_components,
)
from spgf_torch.settings import settings


def blobs(middles: Tensor, members: int = 100, spread: float = 0.1) -> Tensor:
    noise = torch.randn(len(middles), members, middles.shape[1], generator=torch.Generator().manual_seed(0))
    return (middles[:, None] + spread * noise).flatten(0, 1)


def test_principal_components_keep_what_varies_most() -> None:
    """Coordinates of variance 100, 1 and 1e-4: one axis says most, two nearly all, three everything."""
    points = torch.randn(500, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([0.01, 10.0, 1.0]) + 5
    centred = points - points.mean(0)
    one, two, all_three = (principal_components(points, count) for count in (1, 2, 3))
    assert one.shape == (500, 1) and torch.allclose(one[:, 0].abs(), centred[:, 1].abs(), atol=0.3)
    assert torch.allclose(torch.cdist(two, two), torch.cdist(points, points), atol=0.1)
    assert torch.equal(all_three, centred)


def test_axes_that_single_precision_does_not_find(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a small object alone, which has fewer features than these have numbers: LAPACK may give up."""
    points = torch.randn(20, 40, generator=torch.Generator().manual_seed(0))
    expected, eigh = principal_components(points, 3), torch.linalg.eigh

    def gives_up(matrix: Tensor) -> object:
        if matrix.dtype == torch.float32:
            raise torch.linalg.LinAlgError("linalg.eigh: The algorithm failed to converge")
        return eigh(matrix)

    monkeypatch.setattr(torch.linalg, "eigh", gives_up)
    found = principal_components(points, 3)
    assert found.dtype == torch.float32 and torch.allclose(found.abs(), expected.abs(), atol=1e-4)


@pytest.mark.parametrize(("dims", "clusters"), [(1, 1), (3, 5), (4, 2), (16, 20), (18, 7)])
def test_nearest_equals_the_loop(dims: int, clusters: int) -> None:
    """More points than a block holds, and coordinates that are no whole number of fours."""
    generator = torch.Generator().manual_seed(0)
    points, centres = torch.randn(1300, dims, generator=generator), torch.randn(clusters, dims, generator=generator)
    exact = torch.cdist(points.double(), centres.double()).square()
    _, _, distance, second, ids = settle(Weighted.of(points, torch.ones(1300)), centres, 0, 0.0)
    np.testing.assert_allclose(exact.gather(1, ids[:, None])[:, 0], exact.amin(1), rtol=1e-5)
    np.testing.assert_allclose(distance, exact.amin(1), rtol=1e-4, atol=1e-6)
    if clusters > 1:
        np.testing.assert_allclose(second, exact.sort(1).values[:, 1], rtol=1e-4, atol=1e-6)


def test_weights_are_copies() -> None:
    """Lloyd steps on points with whole weights are those on as many copies, also where a centre has none."""
    generator = torch.Generator().manual_seed(0)
    points, weights = torch.randn(200, 5, generator=generator), torch.randint(1, 5, (200,), generator=generator)
    far = torch.full((1, 5), 90.0)
    for start in (points[:4], torch.cat([points[:3], far])):
        few, many = (summary_of(p, w) for p, w in ((points, weights), (points.repeat_interleave(weights, 0), None)))
        one, other = few.settle(start.numpy(), 5, -1.0), many.settle(start.numpy(), 5, -1.0)
        np.testing.assert_allclose(one.centres, other.centres, atol=1e-5)
        assert abs(one.inertia - other.inertia) < 1e-3
        expected = lloyd(points.repeat_interleave(weights, 0), start, 5, -1.0)[0]
        np.testing.assert_allclose(one.centres, expected, atol=1e-5)


def summary_of(points: Tensor, weights: Tensor | None = None) -> Summary:
    """A summary in which every point is a part of its own."""
    summary = Summary(points[:1], 1)
    summary.points = Weighted.of(points, torch.ones(len(points)) if weights is None else weights.float())
    return summary


@pytest.mark.parametrize("parts", [1, 2, 37, 400])
def test_parts_hold_every_point_once_and_stand_at_its_mean(parts: int) -> None:
    points = torch.randn(400, 6, generator=torch.Generator().manual_seed(0))
    summary = Summary(points, parts)
    assert len(summary.points.rows) == parts and summary.points.weights.sum() == 400
    for part, (row, weight) in enumerate(zip(summary.points.rows, summary.points.weights, strict=True)):
        members = points[summary.part == part]
        assert len(members) == weight > 0
        np.testing.assert_allclose(row, members.mean(0), atol=1e-5)


def test_parts_split_where_the_error_is() -> None:
    """0, 1 and 10, 11: first between 1 and 10 (mean 5.5), then each pair; copies of one point are never split."""
    points = torch.tensor([[0.0], [10.0], [1.0], [11.0]]).repeat(3, 1)
    assert Summary(points, 2).points.rows[:, 0].tolist() == [0.5, 10.5]
    assert Summary(points, 99).points.rows[:, 0].tolist() == [0.0, 1.0, 10.0, 11.0]
    assert Summary(torch.full((5, 2), 0.1), 3).points.weights.tolist() == [5.0]


def test_breathing_leaves_a_local_optimum() -> None:
    """Two centres in one blob, one for two blobs that are near each other: Lloyd is caught, a breath is not.

    Freed, each blob has its centre: the inertia is that of the noise, 300 points x 2 coordinates x 0.1^2 = 6.
    """
    points = blobs(torch.tensor([[0.0, 0.0], [20.0, 0.0], [22.0, 0.0]]))
    caught = lloyd(points, torch.tensor([[0.0, -0.1], [0.0, 0.1], [21.0, 0.0]]), 100, 0.0)[0]
    assert inertia(points, caught) > 100
    summary = summary_of(points)
    freed = breathe(summary, summary.settle(caught.numpy()), 1, torch.Generator().manual_seed(0))
    assert freed.inertia < 7 and inertia(points, torch.from_numpy(freed.centres)) < 7


def test_no_breath_changes_nothing_but_settles() -> None:
    points = blobs(torch.tensor([[0.0, 0.0], [5.0, 0.0]]))
    settled, summary = lloyd(points, points[[0, 100]], 100, 0.0)[0], summary_of(points)
    still = breathe(summary, summary.settle(settled.numpy()), 0, torch.Generator())
    np.testing.assert_allclose(still.centres, settled, atol=1e-6)
    alone = breathe(summary, summary.settle(settled[:1].numpy()), 4, torch.Generator())
    np.testing.assert_allclose(alone.centres, points.mean(0)[None], atol=1e-5)


def test_initial_centres_find_every_blob() -> None:
    middles = 5 * torch.randn(12, 30, generator=torch.Generator().manual_seed(1))
    config = settings(PrototypeConfig, num_clusters=12, subsample=600)
    centres, counts = initial_centres(blobs(middles), config, torch.Generator().manual_seed(0))
    assert torch.cdist(centres, middles).amin(0).max() < 0.2
    assert counts.sum() == 600 and counts.min() > 0


def line(*centres: float, **columns: list[float]) -> tuple[Summary, Settled]:
    """Centres on a line, in two dimensions, and a point at each; columns: weights, distance, second."""
    at = torch.tensor([[x, 0.0] for x in centres])
    distance, second = (np.float32(columns.get(name, [0.0] * len(at))) for name in ("distance", "second"))
    weights = torch.tensor(columns["weights"]) if "weights" in columns else None
    return summary_of(at, weights), Settled(at.numpy(), 0.0, distance, second, np.arange(len(at)))


def test_the_least_useful_centres_go_and_no_two_of_them_close() -> None:
    """The next centre is 1, 1, 1.5, 1.5 and 5.5 away, 2.1 in the mean: closer than 2.31 are the first two and the next.

    Without them the inertia rises by 1, 2, 3, 4 and 100. The cheapest goes; then not the next, which is close to it,
    but the third; and of three the last one is the fifth: of the others each is close to one that went.
    """
    summary, settled = line(0, 1, 5, 6.5, 12, distance=[1, 1, 1, 1, 1], second=[2, 3, 4, 5, 101])
    assert _kept(summary, settled, 1).tolist() == [False, True, True, True, True]
    assert _kept(summary, settled, 2).tolist() == [False, True, False, True, True]
    assert _kept(summary, settled, 3).tolist() == [False, True, False, True, False]


def test_new_centres_come_where_the_error_is() -> None:
    """Errors 8 of weight 4, 2 of 2, 54 of 3: in two dimensions a deviation of 1 and of 3. Half of it, at random."""
    summary, settled = line(0, 10, 20, weights=[4.0, 2.0, 3.0], distance=[2, 1, 18])
    noise = torch.randn(2, 2, generator=torch.Generator().manual_seed(5)).numpy()
    expected = [[20, 0] + 0.5 * 3 * noise[0], [0, 0] + 0.5 * 1 * noise[1]]
    found = _added(summary, settled, 2, torch.Generator().manual_seed(5))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_all_points_are_looked_at_where_they_are_few_enough() -> None:
    """Every second point lies elsewhere: axis and start know it where there are just as many as may be looked at.

    With one more, every second is left out.
    """
    odd = torch.arange(AXES_FROM) % 2 == 1
    points = torch.where(odd[:, None], torch.tensor([0.0, 3.0]), torch.tensor([1.0, 0.0]))
    points *= torch.arange(AXES_FROM).div(2, rounding_mode="floor").remainder(2)[:, None] * 2 - 1
    assert principal_components(points, 1)[odd].abs().min() > 2.9
    few = torch.cat([points, points[:1]])
    assert principal_components(few, 1)[1::2].abs().max() < 0.1
    for allowed, sampled in ((500, 500), (499, 250)):
        config = settings(PrototypeConfig, num_clusters=2, subsample=allowed, restarts=2)
        assert initial_centres(points[:500], config, torch.Generator().manual_seed(0))[1].sum() == sampled


@pytest.mark.parametrize(
    ("centres", "cost", "dropped", "kept"),
    [
        ([0, 1, 5, 6.05], [1, 2, 9, 4], 1, [1, 2, 3]),
        ([0, 1, 5, 6.05], [1, 2, 9, 4], 2, [1, 2]),
        ([0, 1, 5, 6.05], [1, 2, 9, 4], 3, [2]),
        ([0, 1, 10], [0, 0, 5], 2, [1]),
        ([0, 1.2, 10, 11], [3, 4, 5, 6], 2, [1, 3]),
    ],
)
def test_the_cheapest_go_but_no_neighbours(
    centres: list[float], cost: list[float], dropped: int, kept: list[int]
) -> None:
    """Beside a centre that went, one as near as neighbours are goes last, even where nothing but it costs nothing."""
    settled: Any = SimpleNamespace(centres=np.array(centres)[:, None], second=np.array(cost, float), distance=0.0)
    summary: Any = SimpleNamespace(by_cluster=lambda settled, values: values.copy())
    assert np.flatnonzero(_kept(summary, settled, dropped)).tolist() == kept


def test_breathing_goes_on_while_it_gains_a_ten_thousandth(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 1000 to 999 is such a gain, with two centres in and out; then to 998.95 is none, so it goes on with one.

    With one 998.8 is a gain on 999; the same again is none, and it ends. More than all but one centre never go.
    """
    tried: list[int] = []
    inertias = iter([1000.0, 5.0, 999.0, 5.0, 998.95, 5.0, 998.8, 5.0, 998.8])

    def settle(centres: np.ndarray) -> Settled:
        return Settled(centres, next(inertias), *[np.zeros(0)] * 2, np.zeros(0, int))

    def added(summary: Any, settled: Settled, count: int, generator: torch.Generator) -> np.ndarray:
        tried.append(count)
        return settled.centres[:count]

    monkeypatch.setattr(kmeans_search, "_added", added)
    monkeypatch.setattr(kmeans_search, "_kept", lambda summary, settled, dropped: np.arange(3))
    summary: Any = SimpleNamespace(settle=settle)
    start: Any = SimpleNamespace(centres=np.zeros((3, 2)))
    best = breathe(summary, start, 9, torch.Generator())
    assert tried == [2, 2, 1, 1] and best.inertia == 998.8
