"""The search for a start: it leaves local optima that Lloyd steps are caught in."""

import torch
from torch import Tensor

from spgf_torch.config import PrototypeConfig, settings
from spgf_torch.prototypes.kmeans import inertia, lloyd
from spgf_torch.prototypes.search import breathe, initial_centres, principal_components


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


def test_breathing_leaves_a_local_optimum() -> None:
    """Two centres in one blob, one for two blobs that are near each other: Lloyd is caught, a breath is not.

    Freed, each blob has its centre: the inertia is that of the noise, 300 points x 2 coordinates x 0.1^2 = 6.
    """
    points = blobs(torch.tensor([[0.0, 0.0], [20.0, 0.0], [22.0, 0.0]]))
    caught = lloyd(points, torch.tensor([[0.0, -0.1], [0.0, 0.1], [21.0, 0.0]]), 100, 0.0)
    assert inertia(points, caught) > 100
    assert inertia(points, breathe(points, caught, 1, torch.Generator().manual_seed(0))) < 7


def test_no_breath_changes_nothing_but_settles() -> None:
    points = blobs(torch.tensor([[0.0, 0.0], [5.0, 0.0]]))
    settled = lloyd(points, points[[0, 100]], 100, 0.0)
    assert torch.allclose(breathe(points, settled, 0, torch.Generator()), settled, atol=1e-6)
    assert torch.allclose(breathe(points, settled[:1], 4, torch.Generator()), points.mean(0)[None], atol=1e-5)


def test_initial_centres_find_every_blob() -> None:
    middles = 5 * torch.randn(12, 30, generator=torch.Generator().manual_seed(1))
    config = settings(PrototypeConfig, num_clusters=12, subsample=600)
    centres, counts = initial_centres(blobs(middles), config, torch.Generator().manual_seed(0))
    assert torch.cdist(centres, middles).amin(0).max() < 0.2
    assert counts.sum() == 600 and counts.min() > 0
