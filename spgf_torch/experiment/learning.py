"""Learning prototypes, and a model of all objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel
from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.training_space import TrainingSpace
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.threads import in_parts

T = TypeVar("T")
R = TypeVar("R")

# Folds at work at once, at most, each on one thread: what is between their torch calls runs side by side too.
THREADS = 2


@dataclass(frozen=True)
class PrototypeFit:
    """Finds prototypes (paper, section 3.2), and keeps them for later runs where there is a cache."""

    config: PrototypeConfig
    seed: int
    cache: Cache

    def __call__(self, relations: Tensor) -> Tensor:
        """Prototypes (K, D) of relations (L, D), on the same device."""
        name = "spgf_torch.prototypes.lightning_module"
        key = fingerprint(code_fingerprint(name), relations, self.config, self.seed, relations.device.type)
        return self.cache.tensors("prototypes", key, lambda: self._fit(relations))["centres"].to(relations.device)

    def _fit(self, relations: Tensor) -> dict[str, Tensor]:
        from spgf_torch.prototypes.lightning_module import fit_prototypes  # brings Lightning: seconds to import

        return {"centres": fit_prototypes(relations, self.config, self.seed)}


def learn_model(examples: Sequence[DescribedObject], centres: Tensor, config: AffordanceConfig) -> GraspModel:
    """Condensed shape-grasp particles (section 3.4) of all examples, given prototypes; not calibrated."""
    return TrainingSpace(examples, centres, config).model()


def side_by_side(
    work: Callable[[T], R], items: Iterable[T], advance: Callable[[int], None], most: int = THREADS
) -> list[R]:
    """`work` of each item, in order, on at most so many threads, in which torch uses one thread each.

    With one at most, the threads share each piece of work instead.
    """
    results = []
    for result in in_parts(work, items, most):
        results.append(result)
        advance(1)
    return results
