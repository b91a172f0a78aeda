"""Counts of outcomes: how many shape-grasp particles each partition has, and how many of them are successes."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from spgf_torch.ops.neighbourhood_loops import outcomes
from spgf_torch.ops.registration import memory, operator


@operator("outcome_counts(Tensor partition, Tensor success, int partitions) -> Tensor")
def outcome_counts(partition: Tensor, success: Tensor, partitions: int) -> Tensor:
    """(partitions, 2) int64: failures and successes among particles of partition (P,) int32, success (P,) bool."""
    outcome = partition.long() * 2 + success
    return torch.bincount(outcome, minlength=2 * partitions).view(partitions, 2)


@outcome_counts.on_cpu
def _outcome_counts_in_loops(partition: Tensor, success: Tensor, partitions: int) -> Tensor:
    counts = np.zeros((partitions, 2), np.int64)
    outcomes(memory(partition), memory(success), counts)
    return torch.from_numpy(counts)


@outcome_counts.fake
def _outcome_counts_shapes(partition: Tensor, success: Tensor, partitions: int) -> Tensor:
    return partition.new_empty((partitions, 2), dtype=torch.int64)
