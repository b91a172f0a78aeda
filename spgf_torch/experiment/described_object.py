"""One object as the learner sees it: features, their pairs with the grasps on it, and their outcomes if known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from spgf_torch.affordance.joined_pairs import JoinedPairs
from spgf_torch.affordance.pairs import Pairs
from spgf_torch.affordance.particles import known_outcomes
from spgf_torch.prototypes.constellations import Surroundings


@dataclass(frozen=True)
class DescribedObject:
    """One object as the learner sees it.

    Attributes:
        relations (F, D) f32: the relational part of its features.
        pairs: its features' pairs with the grasps.
        collides (G,) bool: a sensed point lies inside the open hand.
        grasp_types: names of the hand's grasp types.
        success (G,) bool: how the grasps ended; None where nobody tried them.
        around: the neighbours of its features, where their constellations are asked for.
    """

    relations: Tensor
    pairs: Pairs
    collides: Tensor
    grasp_types: tuple[str, ...]
    success: Tensor | None = None
    around: Surroundings | None = None

    def __len__(self) -> int:
        """How many grasps."""
        return len(self.collides)

    @property
    def grasp_type(self) -> Tensor:
        """(G,) int64: index into `grasp_types`."""
        return self.pairs.grasp_type

    @property
    def outcomes(self) -> Tensor:
        """(G,) bool: `success`. Raises ValueError where nobody tried the grasps."""
        return known_outcomes(self.success)

    @staticmethod
    def joined(parts: Sequence[DescribedObject]) -> DescribedObject:
        """One object of what was seen of it in several clouds, each with its own grasps, in their order."""
        if len(parts) == 1:
            return parts[0]
        pairs = JoinedPairs([part.pairs for part in parts], [len(part.relations) for part in parts])
        relations, collides, success = (
            torch.cat([getattr(part, name) for part in parts]) for name in ("relations", "collides", "outcomes")
        )
        return DescribedObject(relations, pairs, collides, parts[0].grasp_types, success)

    def with_success(self, success: Tensor) -> DescribedObject:
        """With the outcomes (G,) bool of its grasps."""
        return replace(self, success=success.to(self.collides.device))

    def of_grasps(self, chosen: Tensor) -> DescribedObject:
        """With the grasps `chosen` (C,) int64, ascending, alone."""
        if len(chosen) == len(self):
            return self
        success = None if self.success is None else self.success[chosen]
        pairs = self.pairs.of_grasps(chosen)
        return replace(self, pairs=pairs, collides=self.collides[chosen], success=success)

    def sample(self, count: int, generator: torch.Generator) -> Tensor:
        """At most `count` of its grasps, drawn at random: indices (C,) int64, ascending."""
        drawn = torch.randperm(len(self), generator=generator)[:count]
        return drawn.sort().values.to(self.collides.device)

    def sample_of_each_type(self, count: int, generator: torch.Generator) -> Tensor:
        """At most `count` of its grasps of each type, drawn at random: indices (C,) int64, ascending."""
        return sample_of_each_type(self.grasp_type, count, generator)


class Made(Sequence[DescribedObject]):
    """Objects that are made of others when they are asked for, and not kept: they are not in memory twice.

    Args:
        make: the object of a number. numbers: those of the objects, in their order.
    """

    def __init__(self, make: Callable[[int], DescribedObject], numbers: Sequence[int]) -> None:
        self.make, self.numbers = make, numbers

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, i: int) -> DescribedObject:  # type: ignore[override]  # one at a time
        return self.make(self.numbers[i])


def sample_of_each_type(grasp_type: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """At most `count` grasps of each type, of types (G,), drawn at random: indices (C,) int64, ascending."""
    order = torch.randperm(len(grasp_type), generator=generator).to(grasp_type.device)
    shuffled = grasp_type[order]
    drawn = [order[shuffled == code][:count] for code in grasp_type.unique().tolist()]
    return torch.cat([order[:0], *drawn]).sort().values
