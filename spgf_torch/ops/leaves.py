"""Where rows of numbers end in decision trees: rows and trees -> the value of a leaf for each pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import lean
from spgf_torch.ops.registration import memory, operator


class Nodes(NamedTuple):
    """Decision trees whose nodes lie one tree after the other.

    Attributes:
        root: (T,) int32, index of each tree's first node.
        feature: (M,) int16; -1: a leaf. threshold: (M,) f64, of an inner node; a number up to it goes left.
        left, right: (M,) int32, the nodes below; a leaf's own index. value: (M,) f64, of a leaf.
    """

    root: Tensor
    feature: Tensor
    threshold: Tensor
    left: Tensor
    right: Tensor
    value: Tensor


@operator("leaves(Tensor x, Tensor[] nodes) -> Tensor")
def leaves(x: Tensor, nodes: Nodes) -> Tensor:
    """(G, T) f64: the values of the leaves at which rows x (G, D) f64 end in each tree (`Nodes`)."""
    root, feature, threshold, left, right, value = nodes
    node = root.long().expand(len(x), len(root))
    rows = torch.arange(len(x), device=x.device).unsqueeze(1)
    while bool(((asked := feature[node].long()) >= 0).any()):  # of a leaf the nodes below are itself
        node = torch.where(x[rows, asked] <= threshold[node], left[node], right[node]).long()
    return value[node]


@leaves.on_cpu
def _in_loops(x: Tensor, nodes: Nodes) -> Tensor:
    values = np.empty((len(x), len(nodes[0])))
    root, feature, threshold, left, right, value = map(memory, nodes)
    _descend(memory(x), root, feature, threshold, left, right, value, values)
    return torch.from_numpy(values)


@leaves.fake
def _shapes(x: Tensor, nodes: Nodes) -> Tensor:
    return x.new_empty(x.shape[0], nodes[0].shape[0])


@lean
def _descend(
    x: np.ndarray,
    root: np.ndarray,
    feature: np.ndarray,
    threshold: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    value: np.ndarray,
    values: np.ndarray,
) -> None:
    """Out: values (G, T)."""
    for tree in range(len(root)):
        for g in range(len(x)):
            node = root[tree]
            while feature[node] >= 0:
                node = left[node] if x[g, feature[node]] <= threshold[node] else right[node]
            values[g, tree] = value[node]
