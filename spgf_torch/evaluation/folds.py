"""Folds of a cross-validation over objects, stratified by class (paper, section 4), and stratified subsets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def stratified_folds(classes: Sequence[str], folds: int, seed: int) -> np.ndarray:
    """The fold (0 .. folds - 1) of each object, (objects,) int64.

    Each class is shuffled and dealt out in turn, each class starting where the one before stopped: the folds'
    sizes, and the number of each class in them, differ by at most one.
    """
    rng = np.random.default_rng(seed)
    labels = np.asarray(classes)
    fold = np.empty(len(labels), dtype=np.int64)
    dealt = 0
    for name in sorted(set(classes)):
        members = rng.permutation(np.flatnonzero(labels == name))
        fold[members] = (dealt + np.arange(len(members))) % folds
        dealt += len(members)
    return fold


def classwise_folds(classes: Sequence[str], folds: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The fold and the class of each object, both (objects,) int64, where each class has `folds` folds of its own.

    Folds are numbered through: 0 .. folds - 1 are of the first class by name.
    """
    labels = np.asarray(classes)
    names, part = np.unique(labels, return_inverse=True)
    fold = np.empty(len(labels), dtype=np.int64)
    for number, name in enumerate(names):
        members = labels == name
        fold[members] = number * folds + stratified_folds(labels[members].tolist(), folds, seed)
    return fold, part


def stratified_order(classes: Sequence[str], seed: int) -> np.ndarray:
    """A random order (objects,) int64 of all objects whose every beginning has nearly the classes' proportions."""
    rng = np.random.default_rng(seed)
    labels = np.asarray(classes)
    place = np.empty(len(labels))
    for name in sorted(set(classes)):
        members = rng.permutation(np.flatnonzero(labels == name))
        place[members] = (np.arange(len(members)) + rng.random()) / len(members)
    return np.argsort(place, kind="stable")
