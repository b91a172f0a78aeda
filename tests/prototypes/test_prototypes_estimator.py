"""Prototypes as an estimator: the same as the functions, and words for what does not fit."""

import numpy as np
import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.features.estimator import SPGF
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.estimator import NOTHING, Prototypes
from spgf_torch.prototypes.lightning_module import fit_prototypes
from spgf_torch.settings import settings

QUICK = {"restarts": 2, "subsample": 200, "batch_size": 64, "epochs": 2}


def vectors(seed: int, count: int = 400) -> torch.Tensor:
    """(count, 12) around four corners, of unequal weight."""
    generator = torch.Generator().manual_seed(seed)
    corner = 5 * torch.rand(4, 12, generator=torch.Generator().manual_seed(9))
    return corner[torch.arange(count) % 7 % 4] + torch.rand(count, 12, generator=generator)


@pytest.mark.parametrize("seed", [0, 3])
def test_the_fit_is_that_of_train(seed: int) -> None:
    """With and without Lightning, to the digit."""
    found = Prototypes(5, seed=seed, **QUICK).fit(vectors(1))
    expected = fit_prototypes(vectors(1), settings(PrototypeConfig, num_clusters=5, **QUICK), seed)
    assert torch.equal(found.centres_, expected)
    assert torch.equal(found.centres_, Prototypes(5, seed=seed, **QUICK).fit(vectors(1).numpy()).centres_)


def test_the_nearest_centre_and_the_distances_to_it() -> None:
    found, others = Prototypes(4, **QUICK).fit(vectors(1)), vectors(2, 50)
    distance = (others[:, None] - found.centres_).square().sum(2)
    assert torch.equal(found.predict(others), distance.argmin(1))
    assert torch.equal(found.predict(others.double().numpy()), distance.argmin(1))
    taught = (vectors(1)[:, None] - found.centres_).square().sum(2).amin(1).sum().item()
    assert found.inertia_ == pytest.approx(taught, rel=1e-4)
    assert found.names_ == [f"prototype {k}" for k in range(4)]


def test_features_that_describe_nothing_neither_teach_nor_get_an_id() -> None:
    """Ten far outliers, that would be a cluster of their own, are not valid."""
    rows = torch.cat([vectors(1), torch.full((10, 12), 1e4)])
    valid = torch.arange(len(rows)) < 400
    features = VectorFeatures(torch.eye(4).repeat(len(rows), 1, 1), rows, valid)
    found = Prototypes(4, **QUICK).fit(features)
    assert torch.equal(found.centres_, Prototypes(4, **QUICK).fit(vectors(1)).centres_)
    ids = found.predict(features)
    assert (ids[400:] == NOTHING).all() and torch.equal(ids[:400], found.predict(vectors(1)))


def test_prototypes_of_spgf_have_names() -> None:
    """A sheet of 15 x 15 texlets: flat within, and it ends."""
    at = 0.01 * torch.arange(15.0)
    positions = torch.cartesian_prod(at, at, torch.zeros(1))
    features = SPGF()(positions.numpy(), np.tile(np.float32([0, 0, 1]), (225, 1)))
    found = Prototypes(3, **QUICK).fit(features)
    assert "surface" in {name.split()[0] for name in found.names_}
    assert [name.split()[-1] for name in found.names_] == ["0", "1", "2"]
    assert found.predict(features).shape == (225,)


@pytest.mark.parametrize(
    ("features", "words"),
    [
        (torch.zeros(3), "features: expected shape (N, D), got (3,)"),
        (torch.tensor(1.0), "features: expected shape (N, D), got ()"),
        ([[1.0]], "features: expected those of a descriptor, or a tensor or array of shape (N, D); got list"),
        (np.array([["a"]]), "features: expected a torch tensor or a numpy array of numbers, got <U1"),
        (torch.full((9, 2), torch.nan), "relations: expected finite numbers, got others in 9 rows, first in 0"),
        (torch.zeros(9, 2), "prototypes: expected at least K = 2 features that differ, got 1"),
    ],
    ids=str,
)
def test_what_cannot_be_learned_from(features: object, words: str) -> None:
    with pytest.raises(InputError) as told:
        Prototypes(2).fit(features)  # type: ignore[arg-type]
    assert str(told.value) == words


def test_what_cannot_be_asked() -> None:
    with pytest.raises(InputError, match=r"expected fit\(features\) before predict\(features\)"):
        Prototypes(2).predict(vectors(1))
    with pytest.raises(InputError, match=r"expected shape \(N, 12\), as those of fit; got \(5, 3\)"):
        Prototypes(2, **QUICK).fit(vectors(1)).predict(torch.zeros(5, 3))
    with pytest.raises(InputError, match="seed: expected a whole number from 0"):
        Prototypes(2, seed=-1)
    with pytest.raises(InputError, match="num_clusters: expected"):
        Prototypes(0)
