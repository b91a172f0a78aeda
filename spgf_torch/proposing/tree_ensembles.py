"""Gradient-boosted trees and logistic regressions as plain arrays: evaluated without the library that learned them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.ops.leaves import Nodes, leaves


@dataclass(frozen=True)
class Trees:
    """The log-odds of a binary class as a sum over trees, whose nodes lie one tree after the other.

    Attributes:
        root: (T,) int32, index of each tree's first node. baseline: (1,) f64, added to the sum.
        feature: (M,) int16; -1: a leaf. threshold: (M,) f64, of an inner node; a number up to it goes left.
        left, right: (M,) int32, the nodes below; a leaf's own index. value: (M,) f64, of a leaf.
    """

    root: Tensor
    baseline: Tensor
    feature: Tensor
    threshold: Tensor
    left: Tensor
    right: Tensor
    value: Tensor

    def log_odds(self, numbers: Tensor) -> Tensor:
        """(G,) f64 for numbers (G, D)."""
        nodes = Nodes(self.root, self.feature, self.threshold, self.left, self.right, self.value)
        return leaves(numbers.double(), nodes).sum(1) + self.baseline

    def check(self, width: int) -> None:
        """InputError for trees that would read numbers beyond `width`, never end, or hold no numbers."""
        count = len(self.feature)
        shapes = {len(part) for part in (self.threshold, self.left, self.right, self.value)}
        inner, own = self.feature >= 0, torch.arange(count, dtype=self.left.dtype)
        below = torch.stack([self.left, self.right])
        ends = bool(
            (below[:, inner] > own[inner]).all() and (below < count).all() and (below[:, ~inner] == own[~inner]).all()
        )
        known = bool((self.feature < width).all() and (self.root >= 0).all() and (self.root < count).all())
        finite = all(bool(part.isfinite().all()) for part in (self.threshold, self.value, self.baseline))
        if shapes != {count} or self.baseline.shape != (1,) or not (ends and known and finite):
            raise InputError(f"expected trees of nodes in order, got {count} nodes with one out of order or range")


@dataclass(frozen=True)
class Logistic:
    """The log-odds of a binary class as a weighted sum of standardised numbers and of their squares.

    Attributes:
        mean, scale: (D,) f64, of the numbers learned from. weight: (2 D,) f64, of the numbers, then of the squares.
        baseline: (1,) f64.
    """

    mean: Tensor
    scale: Tensor
    weight: Tensor
    baseline: Tensor

    def log_odds(self, numbers: Tensor) -> Tensor:
        """(G,) f64 for numbers (G, D)."""
        return self.terms(numbers, self.mean, self.scale) @ self.weight + self.baseline

    @staticmethod
    def terms(numbers: Tensor, mean: Tensor, scale: Tensor) -> Tensor:
        """(G, 2 D) f64: what is weighed. Beyond four standard deviations a number counts no further."""
        x = ((numbers.double() - mean) / scale).clamp(-4, 4)
        return torch.cat([x, x.square()], dim=1)

    def check(self, width: int) -> None:
        """InputError for others than `width` numbers and their weights."""
        parts = (self.mean, self.scale, self.weight, self.baseline)
        shapes = [tuple(part.shape) for part in parts]
        finite = all(bool(part.isfinite().all()) for part in parts) and bool((self.scale > 0).all())
        if shapes != [(width,), (width,), (2 * width,), (1,)] or not finite:
            raise InputError(
                f"expected weights of {width} numbers and their squares, got shapes {shapes}, finite: {finite}"
            )


Form = Trees | Logistic
FORMS: Mapping[str, type[Trees] | type[Logistic]] = {"trees": Trees, "logistic": Logistic}
