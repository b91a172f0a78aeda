"""What a model says of an object follows from other objects alone: their features, their grasps, their outcomes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_world import FOLD, GRASPS, experiment, run, world

from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.experiment import Experiment

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
    assert same(models[0].calibration.numbers, models[1].calibration.numbers)
    assert not same(models[0].condensed.probability, models[2].condensed.probability)
    assert not same(models[0].calibration.numbers, models[2].calibration.numbers)


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


def inner_scores(made: Experiment) -> dict[tuple[int, int], GraspScores]:
    """(test fold, object that is held out for its sake) -> what is said of the object's sampled grasps."""
    scores: dict[tuple[int, int], GraspScores] = {}
    for taught, held_out in made.design.inner_folds().items():
        scores |= made.predict_inside(taught, made.prototypes(taught), held_out)
    return scores


def test_a_group_says_nothing_of_itself() -> None:
    """Outcomes of object 1 (fold 1) flipped: nothing said of fold 1 moves, whatever the test fold; of fold 2 all does.

    Object 2 is held out for test fold 0 from those of fold 1, for test fold 1 from those of fold 0.
    """
    examples = world(cells=4)
    before, after = (inner_scores(experiment(e)) for e in (examples, flipped(examples, [1])))
    assert before.keys() == {(test, i) for test in range(3) for i in range(len(FOLD)) if FOLD[i] != test}
    for pair, moves in {(0, 1): False, (2, 1): False, (0, 4): False, (1, 2): False, (0, 2): True, (2, 0): True}.items():
        first, second = before[pair], after[pair]
        assert same(first.probability, second.probability) != moves
        assert all(same(score, second.by_ranking[name]) != moves for name, score in first.by_ranking.items())


def test_the_calibration_does_not_see_the_group_that_is_held_out() -> None:
    """Outcomes are chance, in 700 cells: a grasp's own outcome is a good part of what its cells know.

    Held out, the score says nothing, and its weight says so. Judged by itself it would seem to say all: weight > 1.
    """
    made = experiment(world(cells=700, lawful=False), inner_grasps=GRASPS)
    scores = inner_scores(made)
    for test in range(3):
        assert made.nested(test, scores)[0].numbers[:, 1].abs().max() < 0.3


def known(success: torch.Tensor) -> GraspScores:
    """Scores that know outcomes: by `paper` one success comes first, then all failures; by the others the reverse."""
    one, none = torch.ones(len(success)), torch.zeros(len(success), dtype=torch.int64)
    paper, log_odds = (~success).float(), success.float()
    paper[success.nonzero()[0]], log_odds[(~success).nonzero()[0]] = 2.0, 2.0
    by_ranking = {"paper": paper, "log_odds": log_odds, "log_odds_free": log_odds}
    return GraspScores(one.long(), one, one, by_ranking, none, success & False, 2)


@pytest.mark.parametrize(("inner_grasps", "N", "chosen"), [(20, 3, "paper"), (20, 7, "log_odds"), (60, 3, "log_odds")])
def test_of_a_sample_the_same_share_counts(inner_grasps: int, N: int, chosen: str) -> None:
    """Of each object's 60 grasps 20 are sampled: instead of the best 3 then 1 counts, and paper has it.

    Instead of the best 7 count 7 / 3, rounded up: of 3, paper has 1 and log_odds 2. So it is of the best 3 of all 60.
    """
    examples = [replace(e, success=e.grasp_type == 1) for e in world(cells=4)]
    made = experiment(examples, inner_grasps=inner_grasps, N=N)
    scores = {(0, i): known(made.sampled[i].outcomes) for i in made.design.training(0)}
    assert made.nested(0, scores)[1] == chosen


def test_the_sample_follows_the_seed() -> None:
    """Of 60 grasps 20 calibrate: others with another seed. Of all 60 there is nothing to draw."""
    examples = world(cells=4)

    def numbers(inner_grasps: int, seed: int) -> torch.Tensor:
        made = experiment(examples, inner_grasps=inner_grasps, seed=seed)
        return made.nested(0, inner_scores(made))[0].numbers

    assert same(numbers(20, 0), numbers(20, 0)) and not torch.isclose(numbers(20, 0), numbers(20, 1))[:, :3].any()
    assert same(numbers(60, 0), numbers(60, 1))


def test_the_grasps_that_teach_follow_the_seed() -> None:
    """Ten of each type of each object; and of the objects no more than may teach, in the order given."""
    examples = world(cells=4)
    first, again, other = (experiment(examples, trials_per_object=10, seed=seed) for seed in (0, 0, 1))
    for one, same_one, another in zip(first.teach, again.teach, other.teach, strict=True):
        assert torch.bincount(one.grasp_type).tolist() == [10, 10]
        assert same(one.pairs.listed().cell, same_one.pairs.listed().cell)
        assert not torch.equal(one.pairs.listed().cell, another.pairs.listed().cell)
