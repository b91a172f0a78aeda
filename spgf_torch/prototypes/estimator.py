"""k-means of local shapes as an estimator with `fit` and `predict` (paper, sections 3.2 and 3.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.features.estimator import Numbers, tensor_of
from spgf_torch.features.interface import LocalFeatures
from spgf_torch.features.spgf import Features
from spgf_torch.prototypes.batches import MiniBatches, check_relations
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import assign, canonical_order, inertia, lloyd, minibatch_step
from spgf_torch.prototypes.kmeans_search import initial_centres
from spgf_torch.prototypes.naming import prototype_names
from spgf_torch.settings import settings
from spgf_torch.threads import one_thread

__all__ = ["NOTHING", "Prototypes"]

# The id of a feature that has nothing to describe.
NOTHING = -1

Described = LocalFeatures | Numbers


class Prototypes:
    """K recurring local shapes: `Prototypes(K).fit(features).predict(others)`.

    The fit is that of `train` (`prototypes.lightning_module.fit_prototypes`), without Lightning and its checkpoints:
    the same features, K, settings and seed give the same prototypes. It is done on the CPU.

    Args:
        K: how many prototypes, 1 to 1000; the paper's best is 20.
        seed: of the draws of the search.
        changes: settings of conf/prototypes, such as `restarts=4`.

    Attributes:
        centres_: (K, D) float32, after `fit`: commonest first.
        names_: a name for each, after `fit`: `rim 7` where SPGF was described, else `prototype 7`.
        inertia_: the sum of squared distances of the features to their nearest centre, after `fit`.

    Raises:
        InputError: K or a setting that there is not, or is out of range.

    Two heaps of points, the larger one first:

    >>> import torch
    >>> from spgf_torch import Prototypes
    >>> points = torch.tensor([[0.0, 1.0], [0.0, 3.0], [0.0, 2.0], [9.0, 9.0], [9.0, 7.0]])
    >>> prototypes = Prototypes(2, seed=0).fit(points)
    >>> prototypes.centres_
    tensor([[0., 2.],
            [9., 8.]])
    >>> prototypes.predict(torch.tensor([[8.0, 8.0], [1.0, 1.0]]))
    tensor([1, 0])
    >>> prototypes.inertia_
    4.0
    """

    centres_: Tensor
    names_: list[str]
    inertia_: float

    def __init__(self, K: int = 20, *, seed: int = 0, **changes: Any) -> None:
        if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
            raise InputError(f"seed: expected a whole number from 0 to 2^63 - 1, got {seed!r:.40}")
        self.config, self.seed = settings(PrototypeConfig, **{**changes, "num_clusters": K}), seed

    def fit(self, features: Described) -> Prototypes:
        """Learn the prototypes of features: what a descriptor made, or vectors (N, D). Returns the estimator.

        Raises:
            InputError: not finite numbers of shape (N, D), or fewer than K that differ.
        """
        vectors, valid = _vectors(features)
        known = vectors[valid].detach().cpu().float().contiguous()
        check_relations(known, self.config.num_clusters)
        self.centres_ = _fitted(known, self.config, self.seed).to(vectors.device)
        self.inertia_ = inertia(known, self.centres_.cpu())
        self.names_ = _names(self.centres_, features)
        return self

    def predict(self, features: Described) -> Tensor:
        """Ids (N,) int64 of the nearest prototypes (Eqs. 7, 8); -1 where a feature describes nothing.

        Raises:
            InputError: before `fit`, or for features of another width than those of `fit`.
        """
        if not hasattr(self, "centres_"):
            raise InputError("prototypes: expected fit(features) before predict(features)")
        vectors, valid = _vectors(features)
        if vectors.shape[1] != (D := self.centres_.shape[1]):
            raise InputError(f"features: expected shape (N, {D}), as those of fit; got {tuple(vectors.shape)}")
        ids = assign(vectors.to(self.centres_), self.centres_)
        return ids.masked_fill(~valid.to(ids.device), NOTHING)

    def __repr__(self) -> str:
        return f"Prototypes({self.config.num_clusters}, seed={self.seed})"


def _fitted(vectors: Tensor, config: PrototypeConfig, seed: int) -> Tensor:
    """The steps of `lightning_module.fit_prototypes`: a start, mini-batches over all vectors (N, D), Lloyd steps."""
    with one_thread():
        centres, counts = initial_centres(vectors, config, torch.Generator().manual_seed(seed))
        for epoch in range(config.epochs):
            for batch in MiniBatches(vectors, config.batch_size, seed, epoch):
                centres, counts = minibatch_step(batch, centres, counts)
    centres, counts = lloyd(vectors, centres, config.refine_steps, config.tolerance)
    return centres[canonical_order(centres, counts)]


def _vectors(features: Described) -> tuple[Tensor, Tensor]:
    """What is compared (N, D), and which of it describes something (N,) bool."""
    if isinstance(features, Tensor | np.ndarray):
        vectors = tensor_of("features", features)
        valid = torch.ones(vectors.shape[:1], dtype=torch.bool, device=vectors.device)
    elif hasattr(features, "relations"):
        vectors, valid = features.relations(), features.valid
    else:
        got = type(features).__name__
        raise InputError(f"features: expected those of a descriptor, or a tensor or array of shape (N, D); got {got}")
    if vectors.ndim != 2:
        raise InputError(f"features: expected shape (N, D), got {tuple(vectors.shape)}")
    return vectors, valid


def _names(centres: Tensor, features: Described) -> list[str]:
    """Names of the centres (K, D), by their rings where the features are SPGF."""
    if not isinstance(features, Features):
        return [f"prototype {k}" for k in range(len(centres))]
    rings = centres.double().cpu().reshape(len(centres), *features.rings.shape[1:])
    return prototype_names(np.degrees(rings.numpy()))
