"""What a model says of an object follows from other objects alone: their features, their grasps, their outcomes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_world import AFFORDANCE, FOLD, GRASPS, KINDS, experiment, run, world

from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.experiment.cross_validation import CrossValidation
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.training_space import TrainingSpace

NOVEL = [i for i in range(len(FOLD)) if FOLD[i] == 0]


def flipped(examples: list[DescribedObject], which: list[int]) -> list[DescribedObject]:
    """With the outcomes of the objects `which` the other way round."""
    return [replace(e, success=~e.outcomes) if i in which else e for i, e in enumerate(examples)]


def same(a: torch.Tensor, b: torch.Tensor) -> bool:
    """To the bit, infinities included."""
    return torch.equal(a, b)


def test_outcomes_of_novel_objects_change_nothing() -> None:
    """Not their scores in any ranking, not their probabilities, not the ranking that is chosen, not the fold's model.

    The same flip in the training folds changes all of these: the test can fail.
    """
    examples = world(cells=4)
    before, after, other = (run(e) for e in (examples, flipped(examples, NOVEL), flipped(examples, [1])))
    for i in NOVEL:
        first, second, third = (learned.scores[i] for learned in (before, after, other))
        assert first.by_ranking.keys() == second.by_ranking.keys() and len(first.by_ranking) == 5
        assert all(same(score, second.by_ranking[name]) for name, score in first.by_ranking.items())
        assert same(first.probability, second.probability) and first.chosen == second.chosen
        assert same(first.probability_before, second.probability_before)
        assert not any(same(score, third.by_ranking[name]) for name, score in first.by_ranking.items())
        assert not same(first.probability, third.probability)
    models = [learned.of_fold[0] for learned in (before, after, other)]
    for name in ("probability", "support", "base_rate"):
        assert same(getattr(models[0].condensed, name), getattr(models[1].condensed, name))
    assert same(models[0].calibration.weights, models[1].calibration.weights)
    assert not same(models[0].condensed.probability, models[2].condensed.probability)
    assert not same(models[0].calibration.weights, models[2].calibration.weights)


def test_prototypes_do_not_know_the_novel_objects() -> None:
    """Other features of fold 0 move the prototypes of the folds that they teach, and not those of their own."""
    examples = world(cells=4)
    moved = [replace(e, relations=e.relations + 1) if i in NOVEL else e for i, e in enumerate(examples)]
    before, after = run(examples).of_fold, run(moved).of_fold
    assert same(before[0].centres, after[0].centres)
    assert not torch.isclose(before[1].centres, after[1].centres).any()
    assert not torch.isclose(before[2].centres, after[2].centres).any()


def test_a_model_lists_who_taught_it() -> None:
    taught = {fold: set(model.settings["taught"]) for fold, model in run(world(cells=4)).of_fold.items()}
    everyone = {f"object {i}" for i in range(len(FOLD))}
    assert taught == {fold: everyone - {f"object {i}" for i in np.flatnonzero(fold == FOLD)} for fold in range(3)}


def groups_of(examples: list[DescribedObject]) -> list[list[DescribedObject]]:
    return [[e for e, fold in zip(examples, FOLD, strict=True) if fold == f] for f in range(3)]


def test_a_group_says_nothing_of_itself() -> None:
    """Its outcomes flipped, everything said of its own grasps without it stays, base rates included; with it, not."""
    examples, centres = world(cells=4), 4 * torch.eye(KINDS)
    own = [examples[i] for i in NOVEL]
    before, after = (TrainingSpace(groups_of(e), centres, AFFORDANCE) for e in (examples, flipped(examples, NOVEL)))
    for first, second in zip(before.score_grasps(own, [0, 0]), after.score_grasps(own, [0, 0]), strict=True):
        assert same(first.probability, second.probability) and same(first.votes, second.votes)
        assert all(same(score, second.by_ranking[name]) for name, score in first.by_ranking.items())
    for without in (1, None):
        first, second = (space.score_grasps(own, [without] * 2)[0] for space in (before, after))
        assert not same(first.log_odds, second.log_odds) and not same(first.probability, second.probability)


def test_the_calibration_does_not_see_the_group_that_is_held_out() -> None:
    """Outcomes are chance, in 700 cells: a grasp's own outcome is a good part of what its cells know.

    Held out, the score says nothing, and its weight says so. Judged by itself it would seem to say all: weight > 1.
    """
    examples = world(cells=700, lawful=False)
    centres = 4 * torch.eye(KINDS)
    validation = CrossValidation(AFFORDANCE, inner_grasps=GRASPS, N=10, seed=0)
    space = TrainingSpace(groups_of(examples), centres, AFFORDANCE)
    calibration, _ = validation.nested(space, groups_of(examples))
    assert calibration.weights[:, 1].abs().max() < 0.3


class Told:
    """In the place of a training space: of each grasp it knows the outcome, which is its type.

    By `paper` one success comes first, then all failures; by the other rankings a failure, then all successes.
    """

    def score_grasps(self, objects: list[DescribedObject], excluded_groups: list[int]) -> list[GraspScores]:
        return [self._scores(obj.grasp_type == 1) for obj in objects]

    def _scores(self, success: torch.Tensor) -> GraspScores:
        one, none = torch.ones(len(success)), torch.zeros(len(success), dtype=torch.int64)
        paper, log_odds = (~success).float(), success.float()
        paper[success.nonzero()[0]], log_odds[(~success).nonzero()[0]] = 2.0, 2.0
        by_ranking = {"paper": paper, "log_odds": log_odds, "log_odds_free": log_odds}
        return GraspScores(one.long(), one, one, by_ranking, none, success & False)


@pytest.mark.parametrize(("inner_grasps", "N", "chosen"), [(20, 3, "paper"), (20, 7, "log_odds"), (60, 3, "log_odds")])
def test_of_a_sample_the_same_share_counts(inner_grasps: int, N: int, chosen: str) -> None:
    """Of each object's 60 grasps 20 are sampled: instead of the best 3 then 1 counts, and paper has it.

    Instead of the best 7 count 7 / 3, rounded up: of 3, paper has 1 and log_odds 2. So it is of the best 3 of all 60.
    """
    groups = groups_of(world(cells=4))
    groups = [[replace(e, success=e.grasp_type == 1) for e in group] for group in groups]
    validation = CrossValidation(AFFORDANCE, inner_grasps, N, seed=0)
    assert validation.nested(Told(), groups)[1] == chosen  # type: ignore[arg-type]


def test_the_sample_follows_the_seed() -> None:
    """Of 60 grasps 20 calibrate: others with another seed. Of all 60 there is nothing to draw."""
    examples, centres = world(cells=4), 4 * torch.eye(KINDS)
    space = TrainingSpace(groups_of(examples), centres, AFFORDANCE)

    def weights(inner_grasps: int, seed: int) -> torch.Tensor:
        validation = CrossValidation(AFFORDANCE, inner_grasps, N=10, seed=seed)
        return validation.nested(space, groups_of(examples))[0].weights

    assert same(weights(20, 0), weights(20, 0)) and not torch.isclose(weights(20, 0), weights(20, 1))[:, :3].any()
    assert same(weights(60, 0), weights(60, 1))


def test_the_grasps_that_teach_follow_the_seed() -> None:
    """Ten of each type of each object; and of the objects no more than may teach, in the order given."""
    examples = world(cells=4)
    first, again, other = (experiment(examples, trials_per_object=10, seed=seed) for seed in (0, 0, 1))
    for one, same_one, another in zip(first.teach, again.teach, other.teach, strict=True):
        assert torch.bincount(one.grasp_type).tolist() == [10, 10]
        assert same(one.pairs.cell, same_one.pairs.cell)
        assert not torch.equal(one.pairs.cell, another.pairs.cell)
