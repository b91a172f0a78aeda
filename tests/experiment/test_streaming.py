"""Objects in turn: whatever is in memory together, and however many spaces, the results are the same to the bit."""

import gc
import weakref

import pytest
import torch
from small_world import AFFORDANCE, KINDS, bits, everything, experiment, run, world

from spgf_torch.affordance.model import learn
from spgf_torch.experiment import training_space as module
from spgf_torch.experiment.described_object import DescribedObject, Made
from spgf_torch.experiment.learning import learn_model
from spgf_torch.experiment.training_space import TrainingSpace, _blocks
from spgf_torch.prototypes.kmeans import assign


def test_one_prototype_at_a_time_and_one_object_asking(monkeypatch: pytest.MonkeyPatch) -> None:
    examples = world(cells=4)
    before = everything(run(examples, inner_grasps=25, trials_per_object=20))
    monkeypatch.setattr(module, "PARTICLES_TOGETHER", 1)
    monkeypatch.setattr(module, "ASKED_TOGETHER", 1)
    assert TrainingSpace(examples, torch.eye(KINDS), AFFORDANCE).block.tolist() == [0, 1, 2]
    assert everything(run(examples, inner_grasps=25, trials_per_object=20)) == before
    assert everything(run(examples, inner_grasps=25, trials_per_object=19)) != before


def test_blocks_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of ten at most: 4 + 6, then 11 alone, then 0 + 10; one that is empty joins whatever is there."""
    monkeypatch.setattr(module, "PARTICLES_TOGETHER", 10)
    assert _blocks([4, 6, 11, 0, 10]).tolist() == [0, 0, 1, 2, 2]


def test_a_model_in_turn_is_that_of_all_particles_together() -> None:
    examples = world(cells=4)
    made = experiment(examples)
    centres = made.prototypes(None)
    parts = [(e.pairs, assign(e.relations, centres), e.outcomes) for e in examples]
    together = learn(parts, centres, made.config.affordance, types=2)
    in_turn = learn_model(Made(examples.__getitem__, range(6)), centres, made.config.affordance)
    assert bits([together.condensed, together.calibration]) == bits([in_turn.condensed, in_turn.calibration])
    assert len(in_turn.condensed.cell) > 10


def test_objects_are_made_again_and_dropped() -> None:
    """Of forty objects no more than a few are there at a time, while their particles are counted and added."""
    examples = world(cells=4)
    alive: weakref.WeakSet[DescribedObject] = weakref.WeakSet()
    made, most = 0, 0

    class Watched(DescribedObject):
        __hash__ = object.__hash__

    def make(i: int) -> DescribedObject:
        nonlocal made, most
        obj = Watched(**vars(examples[i % 6].of_grasps(torch.arange(50))))
        alive.add(obj)
        made, most = made + 1, max(most, len(alive))
        return obj

    objects = Made(make, range(40))
    learn_model(objects, experiment(examples).prototypes(None), experiment(examples).config.affordance)
    gc.collect()
    assert made == 1 + 2 * 40 and most <= 10 and not alive
