"""The experiment's ranking `judge`: what teaches it, what does not, what comes last."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from spgf_torch.affordance.pairs import CellPairs
from spgf_torch.cache import Cache
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.describe import Described, Grasps
from spgf_torch.experiment.experiment import Design, teaching
from spgf_torch.experiment.labelled_grasps import Tried, tried_grasps
from spgf_torch.experiment.training_set import Example
from spgf_torch.judging.candidates import EXCLUDED, CandidateRanking
from spgf_torch.judging.config import TreesConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.progress import ProgressReporter
from spgf_torch.sensing.sense import sense
from spgf_torch.settings import settings, typed

ROOT = Path(__file__).parents[2]
NAMES = ("bowl_sugar", "egg", "mug_coffee", "tumbler")
DESIGN = Design(np.array([0, 1, 0, 1]), np.arange(4), 100)
OF_EACH_TYPE, TAUGHT = 60, 40
FEW_PIXELS = ["sensing.cameras=1", "sensing.width=160", "sensing.height=120", "sensing.focal=144"]

Given = tuple[list[GraspObject], list[Tried], list[Example]]


@pytest.fixture(scope="module")
def config() -> TrainConfig:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        overrides = ["K=4", "ranking=judge", f"trials_per_object={TAUGHT}", *FEW_PIXELS]
        return typed(TrainConfig, OmegaConf.to_container(compose("train", overrides=overrides), resolve=True))


@pytest.fixture(scope="module")
def given(config: TrainConfig) -> Given:
    """Four objects, the first candidates of each with their outcomes, and what one camera sees of them."""
    objects = [obj for obj in load_objects(ROOT / "data/objects") if obj.name in NAMES]
    config.trials = str(ROOT / "data/trials")
    clearance, tried, examples = CandidateRanking.of(config, Cache(None)).search.clearance, [], []
    for obj, all_of_it in zip(objects, tried_grasps(objects, config), strict=True):
        kind = all_of_it.grasps.grasp_type
        few = torch.cat([(kind == code).nonzero()[:OF_EACH_TYPE, 0] for code in (0, 1)])
        T, kind = all_of_it.grasps.T_object_tcp[few], kind[few]
        free = clearance.free_of_points(sense(obj, config.sensing, config.seed).positions, T, kind)
        none = torch.zeros(0, dtype=torch.int32)
        described = Described(torch.zeros(1, 144), CellPairs(none, none, none, kind), ~free)
        tried.append(Tried(Grasps(T, kind), all_of_it.outcome[few]))
        examples.append(Example(described, tried[-1].success))
    return objects, tried, examples


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


def scores(given: Given, config: TrainConfig, cache: Cache, design: Design = DESIGN) -> list[torch.Tensor]:
    """By judges of few trees."""
    ranking = CandidateRanking.of(config, cache)
    small = replace(ranking.config, learning=settings(TreesConfig, trees=5, least=5))
    objects, tried, examples = given
    return replace(ranking, config=small).scores(design, objects, tried, examples, ProgressReporter())


def flipped(given: Given, which: Sequence[torch.Tensor]) -> Given:
    """Of these trials (C,) of each object, what held has collided, and the others have held."""
    objects, tried, examples = given
    others = []
    for its, at in zip(tried, which, strict=True):
        outcome = its.outcome.clone()
        outcome[at] = (outcome[at] == 0).long()
        others.append(replace(its, outcome=outcome))
    return objects, others, [replace(e, success=t.success) for e, t in zip(examples, others, strict=True)]


def test_probabilities_of_what_is_free_and_the_rest_after_them(given: Given, config: TrainConfig, kept: Cache) -> None:
    for score, example in zip(scores(given, config, kept), given[2], strict=True):
        collides = example.described.collides
        assert collides.any() and (score[collides] == EXCLUDED).all()
        assert ((score[~collides] > 0) & (score[~collides] < 1)).all() and score[~collides].std() > 0.01


def test_a_held_out_fold_teaches_nothing_about_itself(given: Given, config: TrainConfig, kept: Cache) -> None:
    """Outcomes of fold 0 are turned about: its own scores stay to the bit, those of fold 1 do not."""
    before = scores(given, config, kept)
    nothing = torch.zeros(0, dtype=torch.int64)
    turned = [torch.arange(2 * OF_EACH_TYPE) if fold == 0 else nothing for fold in DESIGN.fold]
    after = scores(flipped(given, turned), config, kept)
    assert [torch.equal(a, b) for a, b in zip(before, after, strict=True)] == [fold == 0 for fold in DESIGN.fold]


def test_only_the_trials_that_teach_votes_teach_a_judge(given: Given, config: TrainConfig, kept: Cache) -> None:
    before, teach = scores(given, config, kept), teaching(given[2], config)
    assert [len(which) for which in teach] == [2 * TAUGHT] * 4
    every = torch.arange(2 * OF_EACH_TYPE)
    rest = [every[~torch.isin(every, which)] for which in teach]
    same = scores(flipped(given, rest), config, kept)
    assert all(torch.equal(a, b) for a, b in zip(before, same, strict=True))
    one = Design(DESIGN.fold, np.array([0, 1, 2, 3]), limit=1)  # object 1 alone teaches what ranks fold 0
    fewer = scores(given, config, kept, one)
    others = [every if i > 1 else every[:0] for i in range(4)]
    same = scores(flipped(given, others), config, kept, one)
    assert torch.equal(fewer[0], same[0]) and torch.equal(fewer[2], same[2])


def test_a_cache_changes_no_bit(given: Given, config: TrainConfig, kept: Cache) -> None:
    before = scores(given, config, kept)
    for cache, hits in ((Cache(None), 0), (Cache(kept.folder), len(NAMES))):
        assert all(torch.equal(a, b) for a, b in zip(before, scores(given, config, cache), strict=True))
        assert cache.hits["numbers"] == hits
    other = Cache(kept.folder)
    scores(given, replace(config, seed=1), other)  # another cloud
    assert not other.hits["numbers"]


def test_bools_are_no_outcomes() -> None:
    with pytest.raises(TypeError, match="outcome"):
        Tried(Grasps(torch.zeros(0, 4, 4), torch.zeros(0, dtype=torch.int64)), torch.zeros(0, dtype=torch.bool))
