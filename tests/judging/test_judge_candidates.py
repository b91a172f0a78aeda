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
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.experiment import teaching
from spgf_torch.experiment.labelled_grasps import tables_of
from spgf_torch.hands.hand import load_hand
from spgf_torch.judging.candidates import EXCLUDED, CandidateRanking
from spgf_torch.judging.config import TreesConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.progress import ProgressReporter
from spgf_torch.sensing.sense import sense
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.execute import Trials
from spgf_torch.simulation.table import TrialTable

ROOT = Path(__file__).parents[2]
NAMES = ("bowl_sugar", "egg", "mug_coffee", "tumbler")
DESIGN = Design(np.array([0, 1, 0, 1]), np.arange(4), 100)
OF_EACH_TYPE, TAUGHT = 60, 40
FEW_PIXELS = ["sensing.cameras=1", "sensing.width=160", "sensing.height=120", "sensing.focal=144"]

Given = tuple[list[GraspObject], list[TrialTable], list[DescribedObject]]


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
    clearance, tables, examples = CandidateRanking.of(config, Cache(None)).search.clearance, [], []
    trials = Trials(load_hand(config.hand), config.episode)
    for obj, whole in zip(objects, tables_of(objects, config.trials, trials, config.sampler), strict=True):
        few = torch.cat([(whole.grasp_type == code).nonzero()[:OF_EACH_TYPE, 0] for code in (0, 1)])
        columns = {name: getattr(whole, name)[few] for name in ("position", "quaternion", "grasp_type", "outcome")}
        table = replace(whole, **columns)
        texlets, none = sense(obj, config.sensing, config.seed), torch.zeros(0, dtype=torch.int32)
        free = clearance.free_of_points(texlets.positions, table.T_object_tcp, table.grasp_type)
        pairs = CellPairs(none, none, none, table.grasp_type)
        tables.append(table)
        examples.append(DescribedObject(torch.zeros(1, 144), pairs, ~free, table.grasp_types, table.success))
    return objects, tables, examples


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


def scores(given: Given, config: TrainConfig, cache: Cache, design: Design = DESIGN) -> list[torch.Tensor]:
    """By judges of few trees."""
    ranking = CandidateRanking.of(config, cache)
    small = replace(ranking.config, learning=settings(TreesConfig, trees=5, least=5))
    return replace(ranking, config=small).scores(design, *given, ProgressReporter())


def flipped(given: Given, which: Sequence[torch.Tensor]) -> Given:
    """Of these trials (C,) of each object, what held has collided, and the others have held."""
    objects, tables, examples = given
    others = []
    for its, at in zip(tables, which, strict=True):
        outcome = its.outcome.clone()
        outcome[at] = (outcome[at] == 0).long()
        others.append(replace(its, outcome=outcome))
    return objects, others, [replace(e, success=t.success) for e, t in zip(examples, others, strict=True)]


def test_probabilities_of_what_is_free_and_the_rest_after_them(given: Given, config: TrainConfig, kept: Cache) -> None:
    for score, example in zip(scores(given, config, kept), given[2], strict=True):
        collides = example.collides
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
