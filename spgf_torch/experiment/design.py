"""Which objects teach, which are novel, and which are held out inside the training folds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Design:
    """Which objects teach and which are novel.

    Attributes:
        fold: (objects,) int, the fold in which each object is novel; -1: in none, which is so of all or of no object.
        order: (objects,) int, the order in which objects are taken where not all may teach.
        limit: how many objects may teach.
        part: (objects,) int, within which alone objects learn from one another, and folds are; None: all from all.
    """

    fold: np.ndarray
    order: np.ndarray
    limit: int
    part: np.ndarray | None = None

    @property
    def tests(self) -> list[int]:
        """The folds, each of which is novel once; none where all objects teach one model, and nothing is measured."""
        return np.unique(self.fold[self.fold >= 0]).tolist()

    def novel(self, test: int) -> list[int]:
        """Objects of the fold `test`."""
        return np.flatnonzero(self.fold == test).tolist()

    def training(self, test: int | None) -> list[int]:
        """Objects that teach what is used on the fold `test` (None: of all folds), in their own order."""
        allowed = [i for i in self.order.tolist() if self.fold[i] != test]
        if self.part is not None and test is not None:
            part = self.part[self.novel(test)[0]]
            allowed = [i for i in allowed if self.part[i] == part]
        return sorted(allowed[: self.limit])

    def groups(self, test: int | None) -> list[list[int]]:
        """The same by fold; a single fold in two halves, so that one can be held out; without folds one by one."""
        train = self.training(test)
        if not self.tests:
            return [[i] for i in train]
        groups = [[i for i in train if self.fold[i] == f] for f in self.tests]
        groups = [group for group in groups if group]
        return groups if len(groups) > 1 else [train[::2], train[1::2]]

    @property
    def asking(self) -> list[int | None]:
        """For whom objects are held out inside: the test folds; without folds the model of all (None), if it can be."""
        alone: list[int | None] = [None] if len(self.training(None)) > 1 else []
        return [*self.tests] or alone

    def inner_folds(self) -> dict[tuple[int, ...], list[tuple[int | None, int]]]:
        """Who teaches in the cross-validations inside the training folds, and who is held out from them.

        Objects that teach -> pairs of a test fold and an object that is held out for its sake. What teaches without
        the folds 1 and 2 serves both: objects of 2 are held out for the test fold 1, those of 1 for 2.
        """
        found: dict[tuple[int, ...], list[tuple[int | None, int]]] = {}
        for test in self.asking:
            for group in self.groups(test):
                teach = tuple(i for i in self.training(test) if i not in group)
                found.setdefault(teach, []).extend((test, i) for i in group)
        return found
