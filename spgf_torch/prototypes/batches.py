"""What k-means is given: relations that are checked, in mini-batches whose order a seed tells."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from spgf_torch.errors import InputError


class MiniBatches:
    """relations (L, D) in batches of every n-th of them: each has something of every object, and nothing is copied.

    The order of an epoch depends on seed and epoch alone: resumable. A plain iterable: a DataLoader would only add its
    collation, and a warning on machines with many cores.
    """

    def __init__(self, relations: Tensor, batch_size: int, seed: int, epoch: int) -> None:
        self.relations, self.batch_size, self.stream = relations, batch_size, (seed, epoch)

    def __len__(self) -> int:
        return -(-len(self.relations) // self.batch_size)

    def __iter__(self) -> Iterator[Tensor]:
        generator = torch.Generator().manual_seed(int(np.random.SeedSequence(self.stream).generate_state(1)[0]))
        count = len(self)
        return (self.relations[first::count] for first in torch.randperm(count, generator=generator).tolist())


def check_relations(relations: Tensor, num_clusters: int) -> None:
    """InputError where relations are not finite numbers of shape (L, D), or fewer than `num_clusters` differ."""
    if relations.ndim != 2:
        raise InputError(f"relations: expected shape (L, D), got {tuple(relations.shape)}")
    if not relations.sum().isfinite():  # one pass, where all is well; a sum can also be too large for float32
        bad = torch.nonzero(~relations.isfinite().all(1)).flatten()
        if len(bad) > 0:
            raise InputError(
                f"relations: expected finite numbers, got others in {len(bad)} rows, first in {int(bad[0])}"
            )
    distinct: set[bytes] = set()
    for row in relations.numpy():
        distinct.add((row + 0).tobytes())  # + 0: a zero with a sign is the same zero
        if len(distinct) == num_clusters:
            return
    raise InputError(f"prototypes: expected at least K = {num_clusters} features that differ, got {len(distinct)}")
