"""From texlets to ranked grasps: frames, orders, threads, precision, and geometry that leaves nothing to hold on to."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "proposing"))
from proposing_models import AFFORDANCE, CONFIG, VOLUMES, learned

from spgf_torch.affordance.model import GraspModel, learn, vote
from spgf_torch.affordance.pairs import cell_pairs
from spgf_torch.affordance.ranking import score_grasps
from spgf_torch.affordance.voting import VotingIndex
from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.geometry import se3
from spgf_torch.proposing.proposals import Proposals
from spgf_torch.proposing.propose import Proposer
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.prototypes.lightning_module import fit_prototypes
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings

FEATURES = settings(FeatureConfig)
UP = torch.tensor([0.0, 0.0, 1.0])


def bowl(count: int = 300, seed: int = 3) -> Texlets:
    """An uneven half of a ball of 30 mm, its normals outwards, a little rough."""
    generator = torch.Generator().manual_seed(seed)
    normals = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=1)
    normals[:, 2] = normals[:, 2].abs()
    rough = torch.nn.functional.normalize(normals + 0.1 * torch.randn(count, 3, generator=generator), dim=1)
    return Texlets((normals * torch.tensor([0.03, 0.025, 0.02])).float(), rough.float())


def turned(texlets: Texlets, T: torch.Tensor) -> Texlets:
    positions = se3.transform_points(T, texlets.positions.double())
    return Texlets(positions.float(), (texlets.normals.double() @ T[:3, :3].T).float())


@pytest.fixture(scope="module")
def model() -> GraspModel:
    """Learned from the bowl's own features, so that these vote."""
    texlets, generator = bowl(), torch.Generator().manual_seed(0)
    features = spgf(texlets.positions, texlets.normals, FEATURES)
    centres = fit_prototypes(features.relations(), settings(PrototypeConfig, num_clusters=3, restarts=1), 0)
    grasps = se3.random_poses(400, generator, extent=0.03)
    pairs = cell_pairs(features.T_object_feature, grasps, torch.arange(400) % 2, AFFORDANCE)
    success = torch.rand(400, generator=generator) < 0.4
    made = learn([(pairs, assign(features.relations(), centres), success)], centres, AFFORDANCE, types=2)
    return GraspModel(made.centres, made.condensed, made.grid, made.calibration, learned(generator).settings)


@pytest.fixture(scope="module")
def proposer(model: GraspModel) -> Proposer:
    return Proposer.of(model, CONFIG, VOLUMES)


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def scores(model: GraspModel, texlets: Texlets) -> tuple[torch.Tensor, torch.Tensor]:
    """The scores of two hundred candidates around the bowl, and the prototypes that voted."""
    features = spgf(texlets.positions, texlets.normals, FEATURES)
    grasps = se3.random_poses(200, torch.Generator().manual_seed(5), extent=0.03)
    kinds = torch.arange(200) % 2
    ids = assign(features.relations(), model.centres)
    pairs = cell_pairs(features.T_object_feature, grasps.to(features.T_object_feature), kinds, AFFORDANCE)
    votes = vote(VotingIndex(model.condensed, model.grid), pairs, ids)
    scores = score_grasps(votes, model.condensed.base_rate, kinds, torch.zeros(200, dtype=torch.bool), AFFORDANCE)
    return scores.log_odds, ids


def same(a: Proposals, b: Proposals) -> bool:
    ranked = torch.equal(a.grasp_type, b.grasp_type) and torch.equal(a.support, b.support) and a.voted_by == b.voted_by
    return ranked and torch.equal(a.score, b.score) and torch.equal(a.T_object_tcp, b.T_object_tcp)


def test_one_and_two_threads_rank_alike(model: GraspModel, proposer: Proposer, threads: None) -> None:
    torch.set_num_threads(1)
    one, scored, centres = proposer.propose(bowl(120)), scores(model, bowl(120))[0], prototypes(0)
    torch.set_num_threads(2)
    two, again, centres_again = proposer.propose(bowl(120)), scores(model, bowl(120))[0], prototypes(0)
    assert len(one) > 5 and same(one, two)
    assert torch.equal(scored, again) and torch.equal(centres, centres_again)


def prototypes(seed: int) -> torch.Tensor:
    texlets = bowl(120)
    relations = spgf(texlets.positions, texlets.normals, FEATURES).relations()
    return fit_prototypes(relations, settings(PrototypeConfig, num_clusters=3, restarts=1), seed)


def test_what_ran_before_changes_nothing(model: GraspModel) -> None:
    """Two scenes, each first once: nothing is left behind in the proposer or in global generators."""
    first, second = bowl(), bowl(seed=4)
    forwards, backwards = (Proposer.of(model, CONFIG, VOLUMES) for _ in range(2))
    a, b = forwards.propose(first), forwards.propose(second)
    torch.rand(7)  # somebody else draws
    d, c = backwards.propose(second), backwards.propose(first)
    assert same(a, c) and same(b, d)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_moved_scene_has_the_same_features_and_votes(model: GraspModel, seed: int) -> None:
    """In a turned frame a feature's pose turns with it and its ring stays, but for cells that rounding moves."""
    T = se3.random_poses(1, torch.Generator().manual_seed(seed), extent=0.2)[0].double()
    texlets = bowl()
    here, there = (spgf(t.positions, t.normals, FEATURES) for t in (texlets, turned(texlets, T)))
    alike = (here.rings - there.rings).abs().flatten(1).amax(1) < 1e-3
    poses = (T @ here.T_object_feature.double() - there.T_object_feature.double()).abs().flatten(1).amax(1) < 1e-4
    assert alike.double().mean() > 0.95 and poses.double().mean() > 0.95
    ids, moved = (assign(f.relations(), model.centres) for f in (here, there))
    assert (ids == moved).double().mean() > 0.97


def test_a_turned_scene_is_proposed_the_turned_grasps(proposer: Proposer) -> None:
    """The quality of what is proposed is the same; ties and rounding may swap neighbours in the order."""
    T = se3.random_poses(1, torch.Generator().manual_seed(9), extent=0.1)[0].double()
    here, there = proposer.propose(bowl()), proposer.propose(turned(bowl(), T))
    best, moved = here.score.max(), there.score.max()
    assert abs(float(best - moved)) < 0.05 * abs(float(best)) + 1e-3
    expected = se3.transform_points(T, here.T_object_tcp[:5, :3, 3].double())
    nearest = torch.cdist(expected, there.T_object_tcp[:, :3, 3].double()).amin(1)
    assert nearest.median() < 0.005


def test_the_order_of_texlets_does_not_matter(model: GraspModel) -> None:
    texlets, order = bowl(), torch.randperm(300, generator=torch.Generator().manual_seed(1))
    shuffled = Texlets(texlets.positions[order], texlets.normals[order])
    (one, ids), (other, moved) = scores(model, texlets), scores(model, shuffled)
    assert torch.equal(ids[order], moved)
    torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_float32_ranks_as_float64(model: GraspModel) -> None:
    """Texlets are stored as float32; what float64 would rank is the same but for near ties."""
    single = bowl()
    double = Texlets(single.positions.double(), single.normals.double())
    (one, ids), (other, exact) = scores(model, single), scores(model, double)
    assert (ids == exact).double().mean() > 0.98
    top, top_exact = (set(s.argsort(descending=True, stable=True)[:20].tolist()) for s in (one, other))
    assert len(top & top_exact) >= 19


def line(count: int) -> torch.Tensor:
    return torch.linspace(0, 0.05, count)[:, None] * torch.tensor([1.0, 0.5, 0.25])


PLANE = torch.cat([torch.cartesian_prod(torch.arange(8.0), torch.arange(8.0)) * 0.006, torch.zeros(64, 1)], dim=1)
DEGENERATE = {
    "nothing": Texlets(torch.zeros(0, 3), torch.zeros(0, 3)),
    "one point": Texlets(torch.zeros(1, 3), UP[None]),
    "two points": Texlets(torch.tensor([[0.0, 0, 0], [0.01, 0, 0]]), UP.expand(2, 3)),
    "all in one place": Texlets(torch.zeros(50, 3), UP.expand(50, 3)),
    "one place, all normals": Texlets(torch.zeros(300, 3), bowl().normals),
    "a line": Texlets(line(40), UP.expand(40, 3)),
    "a line along its normals": Texlets(UP * torch.linspace(0, 0.05, 40)[:, None], UP.expand(40, 3)),
    "a plane": Texlets(PLANE, UP.expand(64, 3)),
    "a plane's two sides": Texlets(PLANE.repeat(2, 1), torch.cat([UP.expand(64, 3), -UP.expand(64, 3)])),
    "every point twice": Texlets(bowl().positions.repeat(2, 1), bowl().normals.repeat(2, 1)),
    "far apart": Texlets(bowl(20).positions * 1000, bowl(20).normals),
    "far from the origin": Texlets(bowl().positions + 9.0, bowl().normals),
    "normals all alike": Texlets(bowl().positions, UP.expand(300, 3)),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_geometry_goes_all_the_way(name: str, model: GraspModel, proposer: Proposer) -> None:
    """Features are numbers and frames are frames, whatever lies there; grasps are none or finite ones."""
    texlets = DEGENERATE[name]
    features = spgf(texlets.positions, texlets.normals, FEATURES)
    assert len(features) == len(texlets.positions) and features.relations().isfinite().all()
    R = features.T_object_feature[:, :3, :3].double()
    torch.testing.assert_close(R @ R.mT, torch.eye(3, dtype=torch.float64).expand_as(R), atol=1e-5, rtol=0)
    found = proposer.propose(texlets)
    for values in (found.T_object_tcp, found.score, found.probability):
        assert values.isfinite().all()
    assert ((found.probability >= 0) & (found.probability <= 1)).all()
    if len(texlets.positions):
        scored, ids = scores(model, texlets)
        assert not scored.isnan().any() and ((ids >= 0) & (ids < 3)).all()


@pytest.mark.parametrize("name", ["all in one place", "a plane", "nothing"])
def test_too_little_to_learn_from_is_said(name: str) -> None:
    """All features alike: no two prototypes."""
    relations = spgf(DEGENERATE[name].positions[:1], DEGENERATE[name].normals[:1], FEATURES).relations()
    with pytest.raises(InputError, match=r"prototypes: expected at least K = 2 features that differ, got [01]$"):
        fit_prototypes(relations, settings(PrototypeConfig, num_clusters=2, restarts=1), 0)
