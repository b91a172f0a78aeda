"""The shape-grasp space of some training objects, and what it says of grasps on others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, kernel_of
from spgf_torch.affordance.neighbourhood import (
    Condensed,
    Counts,
    ShapeGraspSpace,
    analyse,
    base_rates,
    partition_counts,
    significant_points,
)
from spgf_torch.affordance.pairs import grid_of, shape_grasp_particles
from spgf_torch.affordance.particles import Particles, concatenated
from spgf_torch.affordance.ranking import GraspScores, score_grasps
from spgf_torch.affordance.voting import counted_votes
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.threads import in_parts

# Particles in memory together, of some prototypes, and pairs that are asked about together, at most: a gigabyte for the
# first (13 bytes each), two and a half for the second (12 bytes). 50 objects have 40 million pairs at most.
PARTICLES_TOGETHER = 2**26
ASKED_TOGETHER = 200_000_000


class TrainingSpace:
    """Prototypes (K, D) and the space of training objects, analysed only where somebody asks.

    Particles of different prototypes have nothing to do with each other, so the space is made of some prototypes after
    the other, and dropped: all objects' pairs with their features are listed, counted and forgotten.
    """

    def __init__(self, objects: Sequence[DescribedObject], centres: Tensor, config: AffordanceConfig) -> None:
        self.objects, self.centres, self.config = objects, centres, config
        self.grid, self.kernel = grid_of(config), kernel_of(config)
        self.types = len(objects[0].grasp_types)
        most = torch.zeros(len(centres), dtype=torch.int64, device=centres.device)
        self.ids = []
        for ids, pairs in in_parts(lambda obj: (self.ids_of(obj), obj.pairs.most(len(obj.relations))), objects):
            self.ids.append(ids)
            most.index_add_(0, ids, pairs)
        self.block = _blocks(most.tolist()).to(centres.device)

    def ids_of(self, obj: DescribedObject) -> Tensor:
        """(F,) int64 prototypes of an object's features."""
        return assign(obj.relations, self.centres)

    def model(self) -> GraspModel:
        """Condensed shape-grasp particles (section 3.4) of the training objects; not calibrated."""
        points, counts = [], []
        for space, of_block in self._spaces():
            points.append(significant_points(space, self.grid, self.kernel, self.config.min_support))
            counts.append(of_block)
        rates = base_rates(torch.stack(counts).sum(0), self.types)
        return GraspModel(self.centres, Condensed.of(points, rates), self.grid, uncalibrated(rates))

    def score_grasps(self, objects: Sequence[DescribedObject]) -> list[GraspScores]:
        """What the training objects say of the grasps on each object."""
        return [scores for together in _groups(objects) for scores in self._score_together(together)]

    def _spaces(self) -> Iterator[tuple[ShapeGraspSpace, Tensor]]:
        """The space of each block of prototypes, and its `partition_counts`."""
        prototypes = len(self.centres)
        for block in range(int(self.block[-1]) + 1):
            make = partial(self._teaching, block)
            parts = list(in_parts(make, zip(self.objects, self.ids, strict=True)))
            counts = torch.stack(list(in_parts(lambda part: partition_counts(part, prototypes), parts))).sum(0)
            space = ShapeGraspSpace.of(parts, prototypes, self.grid)
            parts.clear()
            yield space, counts

    def _teaching(self, block: int, row: tuple[DescribedObject, Tensor]) -> Particles:
        return self._particles(*row, block, row[0].outcomes)

    def _particles(self, obj: DescribedObject, ids: Tensor, block: int, success: Tensor | None = None) -> Particles:
        """An object's particles of the prototypes in a block, given the prototypes ids (F,) of its features."""
        return shape_grasp_particles(obj.pairs.listed(self.block[ids] == block), ids, self.types, success)

    def _score_together(self, objects: Sequence[DescribedObject]) -> list[GraspScores]:
        rows = [(obj, self.ids_of(obj)) for obj in objects]
        found: list[list[Counts]] = [[] for _ in rows]
        total = []
        for block, (space, counts) in enumerate(self._spaces()):
            asked = [self._particles(*row, block) for row in rows]
            at_points = analyse(space, concatenated(asked), self.grid, self.kernel)
            for own, of_block in zip(found, at_points.split([len(each.cell) for each in asked]), strict=True):
                own.append(of_block)
            total.append(counts)
        rates = base_rates(torch.stack(total).sum(0), self.types)
        return list(in_parts(lambda row: self._scores(*row[0], row[1], rates), zip(rows, found, strict=True)))

    def _scores(self, obj: DescribedObject, ids: Tensor, counts: Sequence[Counts], rates: Tensor) -> GraspScores:
        pairs = obj.pairs.listed()
        points = shape_grasp_particles(pairs, ids, self.types)
        at_points = Counts.gathered(counts, self.block[ids].index_select(0, pairs.feature))
        votes = counted_votes(at_points, points, pairs.grasp, self.config.min_support)
        return score_grasps(votes, rates, obj.grasp_type, obj.collides, self.config)


def _blocks(particles: Sequence[int]) -> Tensor:
    """(K,) int64, from 0: the block of each prototype, given how many particles it has at most.

    Neighbours share a block of `PARTICLES_TOGETHER` at most; a prototype with more has its own.
    """
    block, held, found = 0, 0, []
    for count in particles:
        if held and held + count > PARTICLES_TOGETHER:
            block, held = block + 1, 0
        held += count
        found.append(block)
    return torch.tensor(found)


def _groups(objects: Sequence[DescribedObject]) -> Iterator[list[DescribedObject]]:
    """Neighbours in the order with about `ASKED_TOGETHER` pairs in all, or one object with more."""
    group: list[DescribedObject] = []
    pairs = 0
    for obj in objects:
        more = int(obj.pairs.most(len(obj.relations)).sum())
        if group and pairs + more > ASKED_TOGETHER:
            yield group
            group, pairs = [], 0
        group.append(obj)
        pairs += more
    yield group
