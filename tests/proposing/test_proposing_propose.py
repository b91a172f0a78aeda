"""From features to ranked grasps: by hand, in any frame and order, top N, tables, and nothing to propose."""

import math
from dataclasses import replace

import pytest
import torch
from proposing_models import AFFORDANCE, CONFIG, SETTINGS, VOLUMES, centres, features_of, learned, patches

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.model import GraspModel
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.pairs import cell_pairs, grid_of, shape_grasp_particles
from spgf_torch.affordance.ranking import score_grasps
from spgf_torch.affordance.voting import cast_votes
from spgf_torch.features.spgf import Features
from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.proposing.clearance import Plane, Surroundings
from spgf_torch.proposing.proposals import Proposals
from spgf_torch.proposing.propose import Pool, Proposer, Voters
from spgf_torch.proposing.sampling import same_grasp
from spgf_torch.sensing.texlets import Texlets

NOTHING = torch.zeros(0, 3, dtype=torch.float64)


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


@pytest.fixture
def model(generator: torch.Generator) -> GraspModel:
    return learned(generator)


@pytest.fixture
def features(model: GraspModel, generator: torch.Generator) -> Features:
    ids = torch.randint(len(model.centres), (60,), generator=generator)
    return features_of(patches(60, generator), ids, model.centres)


@pytest.fixture
def proposer(model: GraspModel) -> Proposer:
    return Proposer.of(model, CONFIG, VOLUMES)


def same(a: Proposals, b: Proposals) -> bool:
    """But for the poses."""
    ranked = torch.equal(a.grasp_type, b.grasp_type) and torch.equal(a.support, b.support)
    return ranked and torch.allclose(a.score, b.score, atol=1e-6) and a.voted_by == b.voted_by


def single_point_model(lattice: SE3Grid, cell: int) -> GraspModel:
    """Two prototypes; the one promising point is in the space of prototype 1 and WPG: 45 of 50 held, base 0.5."""
    condensed = Condensed(
        torch.tensor([0, 0, 0, 0, 1]),
        torch.tensor([cell]),
        torch.tensor([0.9]),
        torch.tensor([50.0]),
        torch.full((2,), 0.5),
    )
    return GraspModel(centres(2), condensed, lattice, uncalibrated(condensed.base_rate), SETTINGS)


def test_one_feature_and_one_particle_by_hand() -> None:
    """One vote: P = (45 + 5 * 0.5) / 55 = 0.8636, gain = ln(0.8636 / 0.1364) = 1.8458 against a base rate of 0.5.

    The score is gain / (1 + 1000 votes of nothing). The probability takes the score of candidates, gain / (1 + 100),
    at its word: sigmoid(0.018275) = 0.50457. The feature of prototype 0 knows nothing.
    """
    lattice = grid_of(AFFORDANCE)
    cell = lattice.index(torch.tensor([0.0, 0.0, 0.03]), torch.tensor([1.0, 0.1, 0.2, 0.3]) / math.sqrt(1.14))
    model = single_point_model(lattice, int(cell))
    T = torch.eye(4).repeat(2, 1, 1)
    T[1, :3, 3] = torch.tensor([1.0, 2.0, 3.0])
    config = replace(CONFIG, rounds=0, vote_shrinkage=1000)
    found = Proposer.of(model, config, VOLUMES).propose_from(
        features_of(T, torch.tensor([0, 1]), model.centres), NOTHING
    )
    position, quaternion = lattice.centres(cell.unsqueeze(0))
    assert torch.allclose(found.T_object_tcp, T[1] @ se3.pose(position, quaternion), atol=1e-6)
    assert found.grasp_type.tolist() == [1] and found.support.tolist() == [1] and found.voted_by == (((1, 1),),)
    gain = math.log(47.5 / 7.5)
    assert found.score.tolist() == pytest.approx([gain / 1001], rel=1e-5)
    assert found.probability.tolist() == pytest.approx([1 / (1 + math.exp(-gain / 101))], rel=1e-5)


def test_moved_features_give_the_same_grasps_moved(proposer: Proposer, features: Features, generator) -> None:
    """In float64 rounding moves no relative pose into another cell."""
    points = 0.02 * torch.randn(30, 3, generator=generator, dtype=torch.float64)
    T = se3.random_poses(1, generator).double()[0]
    moved = Features(T @ features.T_object_feature, features.rings, features.valid)
    a = proposer.propose_from(features, points)
    b = proposer.propose_from(moved, se3.transform_points(T, points))
    assert len(a) > 10 and same(a, b)
    assert torch.allclose(T.float() @ a.T_object_tcp, b.T_object_tcp, atol=1e-5)


def test_the_order_of_features_does_not_matter(proposer: Proposer, features: Features, generator) -> None:
    order = torch.randperm(60, generator=generator)
    shuffled = Features(features.T_object_feature[order], features.rings[order], features.valid[order])
    a, b = proposer.propose_from(features, NOTHING), proposer.propose_from(shuffled, NOTHING)
    assert same(a, b) and torch.equal(a.T_object_tcp, b.T_object_tcp)


def test_scores_are_those_of_candidates(proposer: Proposer, model: GraspModel, features: Features) -> None:
    """All features vote, as for candidates of a mesh; the score is theirs with another shrinkage."""
    found = proposer.propose_from(features, NOTHING)
    pairs = cell_pairs(features.T_object_feature.float(), found.T_object_tcp, found.grasp_type, AFFORDANCE)
    ids = torch.cdist(features.relations(), model.centres).argmin(1)
    votes = cast_votes(proposer.index, shape_grasp_particles(pairs, ids, 2), pairs.grasp.long())
    config = replace(AFFORDANCE, vote_shrinkage=CONFIG.vote_shrinkage)
    free = torch.zeros(len(found), dtype=torch.bool)
    scores = score_grasps(votes, model.condensed.base_rate, found.grasp_type, free, config)
    assert torch.allclose(scores.log_odds, found.score, atol=1e-3)
    assert (scores.votes - found.support).abs().max() <= 1  # float32 here: a pose may fall into the next cell
    assert [sum(n for _, n in by) for by in found.voted_by] == found.support.tolist()


def test_moves_make_scores_higher(model: GraspModel, features: Features) -> None:
    best = [
        Proposer.of(model, replace(CONFIG, rounds=rounds), VOLUMES).propose_from(features, NOTHING).score[0]
        for rounds in (0, 3)
    ]
    assert best[1] > best[0]


def test_the_best_n(proposer: Proposer, features: Features) -> None:
    found = proposer.propose_from(features, NOTHING)
    assert torch.equal(found.score, found.score.sort(descending=True).values)
    best = found.best(5)
    assert best["CG"].tolist() == [0, 1, 2, 3, 4]
    for code, kind in enumerate(("NPG", "WPG")):
        assert best[kind].tolist() == [i for i, t in enumerate(found.grasp_type.tolist()) if t == code][:5]
    assert len(found.best(1000)["CG"]) == len(found)
    few = Proposer.of(proposer.model, replace(CONFIG, count=3), VOLUMES).propose_from(features, NOTHING)
    assert few.grasp_type.bincount().tolist() == [3, 3]
    assert torch.equal(few.T_object_tcp[few.best(3)["WPG"]], found.T_object_tcp[found.best(3)["WPG"]])


def test_no_grasp_is_listed_twice(proposer: Proposer, features: Features) -> None:
    found = proposer.propose_from(features, NOTHING)
    for kind in range(2):
        alike = same_grasp(found.T_object_tcp[found.grasp_type == kind], CONFIG.apart, CONFIG.apart_deg)
        assert len(alike) > 3 and torch.equal(alike, torch.eye(len(alike), dtype=torch.bool))


def test_the_hand_touches_neither_points_nor_table(proposer: Proposer, features: Features, generator) -> None:
    points = 0.03 * torch.randn(20, 3, generator=generator, dtype=torch.float64)
    table = Plane.of((0, 0, 1), -0.01)
    found, anywhere = (
        proposer.propose_from(features, points, Surroundings(table=table)),
        proposer.propose_from(features, NOTHING),
    )
    clear = proposer.clearance
    assert len(found) > 3
    assert clear.free_of_points(points, found.T_object_tcp, found.grasp_type).all()
    assert clear.free_of_plane(table, found.T_object_tcp, found.grasp_type).all()
    assert clear.closes_on_points(points, found.T_object_tcp, found.grasp_type).all()
    assert not clear.free_of_points(points, anywhere.T_object_tcp, anywhere.grasp_type).all()
    assert not clear.free_of_plane(table, anywhere.T_object_tcp, anywhere.grasp_type).all()


def test_nothing_to_propose(proposer: Proposer, model: GraspModel, features: Features) -> None:
    """No feature, no valid one, or a model that learned nothing: no proposals, and no error."""
    nobody = replace(features, valid=torch.zeros_like(features.valid))
    empty = Condensed(*(t[:0] for t in (model.condensed.cell,) * 4), model.condensed.base_rate)
    blank = replace(model, condensed=replace(empty, partition_start=torch.zeros(7, dtype=torch.long)))
    lone = Texlets(torch.zeros(1, 3), torch.tensor([[0.0, 0, 1]]))
    for found in (
        proposer.propose_from(nobody, NOTHING),
        Proposer.of(blank, CONFIG, VOLUMES).propose_from(features, NOTHING),
        Proposer.of(model, CONFIG, VOLUMES).propose(lone),
        Proposer.of(model, CONFIG, VOLUMES).propose(Texlets(lone.positions[:0], lone.normals[:0])),
    ):
        assert len(found) == 0 and found.T_object_tcp.shape == (0, 4, 4) and found.voted_by == ()
        assert found.best(10)["CG"].tolist() == []


def test_from_texlets(model: GraspModel, generator: torch.Generator) -> None:
    """A bumpy sheet: the whole way, typed as promised."""
    grid = torch.cartesian_prod(torch.arange(8.0), torch.arange(8.0)) * 0.006
    height = 0.003 * torch.randn(64, 1, generator=generator)
    normals = torch.nn.functional.normalize(
        torch.tensor([0.0, 0, 1]) + 0.1 * torch.randn(64, 3, generator=generator), dim=1
    )
    found = Proposer.of(model, CONFIG, VOLUMES).propose(Texlets(torch.cat([grid, height], dim=1), normals))
    assert len(found) > 0 and found.T_object_tcp.dtype == torch.float32
    assert found.support.dtype == found.grasp_type.dtype == torch.int64
    assert ((found.probability >= 0) & (found.probability <= 1)).all()


def test_few_voters_stand_for_all(proposer: Proposer, generator: torch.Generator) -> None:
    """Eight features at one place, of one kind: two say what all do, the shrinkage being in proportion."""
    T, ids = patches(1, generator).repeat(8, 1, 1), torch.zeros(8, dtype=torch.int64)
    poses = T[0] @ se3.random_poses(3000, generator, extent=0.03).double()
    kind = torch.arange(3000) % 2
    few, all_ = (proposer.score(poses, kind, Voters(T, ids, ids), n) for n in (2, 8))
    assert int(all_.isfinite().sum()) > 20 and torch.allclose(few, all_, rtol=1e-4)


UP, IN_A_FINGER = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.03, 0.0, -0.015])


@pytest.mark.parametrize(
    ("between", "touched", "around", "moved"),
    [
        ([0.0, 0.0, 0.0], False, Surroundings(), True),
        ([0.0, 0.02, 0.0], False, Surroundings(), False),  # in the middle of where the hand was
        ([0.0, 0.0, 0.0], True, Surroundings(), False),
        ([0.0, 0.0, 0.0], False, Surroundings(obstacles=IN_A_FINGER[None]), False),
        ([0.0, 0.0, 0.0], False, Surroundings(table=Plane(UP, -0.1)), True),
        ([0.0, 0.0, 0.0], False, Surroundings(table=Plane(UP, 0.0)), False),
        ([0.0, 0.0, 0.0], False, Surroundings(up=(UP, 0.5)), False),
    ],
    ids=["free", "nothing to close on", "a point in a finger", "an obstacle", "high", "a table", "from below"],
)
def test_a_move_leaves_the_hand_free(between: list[float], touched: bool, around: Surroundings, moved: bool) -> None:
    """A hand 20 mm aside of the one pose with a vote, and the move that leads there: in the frame of that pose."""
    grid = grid_of(AFFORDANCE)
    cell = grid.index(torch.tensor([0.0, 0.0, 0.03]), torch.tensor([1.0, 0.0, 0.0, 0.0]))
    position, quaternion = grid.centres(cell.unsqueeze(0))
    voters = Voters(se3.inverse(se3.pose(position, quaternion)), torch.tensor([1]), torch.tensor([0]))
    aside, back = torch.eye(4), torch.eye(4)
    aside[1, 3], back[1, 3] = 0.02, -0.02
    pool = Pool(aside[None], torch.tensor([1]), torch.tensor([-math.inf]))
    points = torch.tensor([between]) if not touched else torch.stack([torch.tensor(between), IN_A_FINGER])
    proposer = Proposer.of(single_point_model(grid, int(cell)), CONFIG, VOLUMES)
    found = proposer.refine(pool, back[None], voters, points, around)
    assert torch.allclose(found.T[0], torch.eye(4) if moved else aside, atol=1e-6)
    assert bool(found.score.isfinite()) == moved
