"""The shape-grasp space of some training objects, and what it says of grasps on others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, kernel_of, learn_from
from spgf_torch.affordance.neighbourhood import Counts, ShapeGraspSpace, analyse, base_rates, partition_counts
from spgf_torch.affordance.pairs import grid_of, shape_grasp_particles
from spgf_torch.affordance.particles import Particles, concatenated
from spgf_torch.affordance.ranking import GraspScores, score_grasps
from spgf_torch.affordance.voting import counted_votes
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.threads import in_parts

# Pairs that are asked about at once, at most: a gigabyte of places and counts. 50 objects have 6 million on a fold.
ASKED_TOGETHER = 2**25


class TrainingSpace:
    """Prototypes (K, D) and the space of training objects, analysed only where somebody asks.

    The particles of an object are made, counted or added to the space, and dropped.
    """

    def __init__(self, objects: Sequence[DescribedObject], centres: Tensor, config: AffordanceConfig) -> None:
        self.centres, self.config = centres, config
        self.grid, self.kernel = grid_of(config), kernel_of(config)
        self.types = len(objects[0].grasp_types)

        def particles(obj: DescribedObject) -> Particles:
            return shape_grasp_particles(obj.pairs, self.ids(obj), self.types, obj.outcomes)

        of_objects = in_parts(lambda obj: partition_counts(particles(obj), len(centres)), objects)
        counts = next(of_objects)
        for more in of_objects:
            counts += more
        self.space = ShapeGraspSpace.in_turn(in_parts(particles, objects), counts, self.grid)
        self.base_rate = base_rates(counts, self.types)

    def ids(self, obj: DescribedObject) -> Tensor:
        """(F,) int64 prototypes of an object's features."""
        return assign(obj.relations, self.centres)

    def model(self) -> GraspModel:
        """Condensed shape-grasp particles (section 3.4) of the training objects; not calibrated."""
        return learn_from(self.space, self.base_rate, self.centres, self.config)

    def score_grasps(self, objects: Sequence[DescribedObject]) -> list[GraspScores]:
        """What the training objects say of the grasps on each object."""
        return [scores for together in _groups(objects) for scores in self._score_together(together)]

    def _score_together(self, objects: Sequence[DescribedObject]) -> list[GraspScores]:
        asked = [shape_grasp_particles(obj.pairs, self.ids(obj), self.types) for obj in objects]
        points = concatenated(asked)
        counts = analyse(self.space, points, self.grid, self.kernel).split([len(each.cell) for each in asked])
        return list(in_parts(lambda row: self._scores(*row), zip(counts, asked, objects, strict=True)))

    def _scores(self, counts: Counts, points: Particles, obj: DescribedObject) -> GraspScores:
        votes = counted_votes(counts, points, obj.pairs.grasp, self.config.min_support)
        return score_grasps(votes, self.base_rate, obj.grasp_type, obj.collides, self.config)


def _groups(objects: Sequence[DescribedObject]) -> Iterator[list[DescribedObject]]:
    """Neighbours in the order with about `ASKED_TOGETHER` pairs in all, or one object with more."""
    group: list[DescribedObject] = []
    pairs = 0
    for obj in objects:
        if group and pairs + len(obj.pairs.cell) > ASKED_TOGETHER:
            yield group
            group, pairs = [], 0
        group.append(obj)
        pairs += len(obj.pairs.cell)
    yield group
