"""What prototypes, particles and voting need of a descriptor: where a feature is, and numbers that are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

__all__ = ["LocalFeatures", "VectorFeatures"]


class LocalFeatures(Protocol):
    """N local features of a surface. `spgf.Features` are some; `VectorFeatures` will do for any other."""

    @property
    def T_object_feature(self) -> Tensor:  # noqa: N802
        """(N, 4, 4), m: a pose that turns with the object; shape-grasp particles are relative to it."""

    @property
    def valid(self) -> Tensor:
        """(N,) bool: False where there is nothing to describe; such features neither teach nor vote."""

    def relations(self) -> Tensor:
        """(N, D) float32, the same for a turned object: prototypes are k-means centres of them."""


@dataclass(frozen=True)
class VectorFeatures:
    """Features with the vectors (N, D) float32 as their relations; `LocalFeatures` has the other shapes and frames.

    >>> import torch
    >>> own = VectorFeatures(torch.eye(4).repeat(5, 1, 1), torch.rand(5, 33), torch.ones(5, dtype=torch.bool))
    >>> len(own), own.relations().shape
    (5, torch.Size([5, 33]))
    """

    T_object_feature: Tensor
    vectors: Tensor
    valid: Tensor

    def __len__(self) -> int:
        return len(self.vectors)

    def relations(self) -> Tensor:
        """The vectors."""
        return self.vectors
