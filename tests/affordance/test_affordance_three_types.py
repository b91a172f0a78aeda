"""A hand of three grasp types, of which there are unlike numbers: every step from particles to probabilities by hand.

Prototypes 0 and 1, types 0, 1 and 2: partitions prototype * 3 + type, 0 to 5. There is no smoothing.
"""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from spgf_torch.affordance.calibration import fit_calibration
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, learn, load_model, save_model, vote
from spgf_torch.affordance.neighbourhood import Condensed, condense, partition_counts
from spgf_torch.affordance.pairs import CellPairs, shape_grasp_particles
from spgf_torch.affordance.particles import Particles
from spgf_torch.affordance.ranking import log_odds_gain, point_gains, score_grasps
from spgf_torch.affordance.voting import VotingIndex, cast_votes, vote_totals
from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import SE3Grid, gaussian_kernel
from spgf_torch.hands.config import HandConfig, PreshapeConfig
from spgf_torch.ops.cell_pairs import cell_pairs
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import plain, settings

GRID = SE3Grid(reach=0.03, voxel=0.01, rotation_deg=60.0)
EXACT = gaussian_kernel(GRID, 0.0, 0.0)
CONFIG = settings(AffordanceConfig, reach=0.03, rotation_deg=60, kernel=0, kernel_deg=0, min_support=1, shrinkage=0)
TYPES = 3


@pytest.fixture
def particles() -> Particles:
    """Of partition 0 (prototype 0, type 0) two of three held; of 1 none, of 3 (1, 0) the only one; of 5 one of two.

    All lie in one cell, but for the second of partition 5.
    """
    partition = torch.tensor([5, 0, 3, 0, 1, 5, 0], dtype=torch.int32)
    cell = torch.tensor([7, 7, 7, 7, 7, 9, 7], dtype=torch.int32)
    return Particles(partition, cell, TYPES, torch.tensor([True, True, True, False, False, False, True]))


@pytest.fixture
def condensed(particles: Particles) -> Condensed:
    return condense([particles], 2, GRID, EXACT, min_support=1)


def test_particles_of_pairs() -> None:
    """Features of prototypes 1 and 0; the first meets grasps of types 2 and 0, the second the one of type 2."""
    feature, grasp, cell = torch.tensor([[0, 0, 1], [0, 1, 0], [7, 8, 9]], dtype=torch.int32)
    pairs = CellPairs(feature, grasp, cell, grasp_type=torch.tensor([2, 0]))
    found = shape_grasp_particles(pairs, torch.tensor([1, 0]), TYPES, torch.tensor([True, False]))
    assert found.partition.tolist() == [5, 3, 2] and found.success is not None
    assert found.prototype.tolist() == [1, 1, 0] and found.grasp_type.tolist() == [2, 0, 2]
    assert found.success.tolist() == [True, False, True]


def test_base_rates_are_each_types_own(particles: Particles, condensed: Condensed) -> None:
    """Type 0: three of four over both prototypes; type 1: none of one; type 2: one of two."""
    by_type = partition_counts(particles, 2).view(2, 3, 2).sum(0)
    assert by_type.tolist() == [[1, 3], [1, 0], [1, 1]]  # failures, successes
    assert condensed.base_rate.tolist() == [0.75, 0.0, 0.5] and condensed.types == TYPES


def test_points_of_each_partition(condensed: Condensed) -> None:
    """Partitions 2 and 4 are empty; the point of partition 5 in cell 7 held, that in cell 9 did not."""
    assert condensed.partition_start.tolist() == [0, 1, 2, 2, 3, 3, 5]
    assert condensed.cell.tolist() == [7, 7, 7, 7, 9] and condensed.support.tolist() == [3, 1, 1, 1, 1]
    assert condensed.probability.tolist() == pytest.approx([2 / 3, 0, 1, 1, 0])


def test_votes_know_their_prototype(condensed: Condensed) -> None:
    """Asked at partitions 5, 4, 3 and 0: the second finds nothing; the others vote as prototypes 1, 1 and 0."""
    asked = Particles(torch.tensor([5, 4, 3, 0], dtype=torch.int32), torch.full((4,), 7, dtype=torch.int32), TYPES)
    votes = cast_votes(VotingIndex(condensed, GRID), asked, torch.tensor([2, 0, 0, 1]))
    assert votes.grasp.tolist() == [2, 0, 1] and votes.prototype.tolist() == [1, 1, 0]
    assert votes.probability.tolist() == pytest.approx([1, 1, 2 / 3])


def test_gains_are_over_the_base_rate_of_the_points_type(condensed: Condensed) -> None:
    """Point 0: 2/3 over 3/4; points 3 and 4 of type 2: 1 and 0, kept off by 1e-4, over 1/2."""
    gains = point_gains(condensed, CONFIG)
    far = math.log((1 - 1e-4) / 1e-4)
    assert gains[[0, 3, 4]].tolist() == pytest.approx([math.log(2) - math.log(3), far, -far], rel=1e-3)


def random_space(generator: torch.Generator) -> VotingIndex:
    """A third of all cells of each of 2 x 3 partitions."""
    cells = [(torch.rand(GRID.cells, generator=generator) < 0.3).nonzero()[:, 0].int() for _ in range(2 * TYPES)]
    start = torch.tensor([0, *torch.tensor([len(c) for c in cells]).cumsum(0).tolist()])
    probability, support = (torch.rand(int(start[-1]), generator=generator) for _ in range(2))
    rates = torch.tensor([0.2, 0.4, 0.7])
    return VotingIndex(Condensed(start, torch.cat(cells), probability, 20 * support + 2, rates), GRID)


def test_totals_say_what_listed_votes_say() -> None:
    """Grasps of the types 0, 0, 1, 2, 2, 2 in turn."""
    generator = torch.Generator().manual_seed(0)
    index = random_space(generator)
    features, grasps = (se3.random_poses(n, generator, extent=0.02) for n in (30, 120))
    ids, kind = torch.arange(30) % 2, torch.tensor([0, 0, 1, 2, 2, 2]).repeat(20)
    pairs = CellPairs(*cell_pairs(features, grasps, GRID.numbers), kind)
    votes = vote(index, pairs, ids)
    scores = score_grasps(votes, index.condensed.base_rate, kind, torch.zeros(120).bool(), CONFIG)
    totals = vote_totals(index, point_gains(index.condensed, CONFIG), features, ids, grasps, kind)
    expected = torch.zeros(120).index_add(
        0, votes.grasp, log_odds_gain(votes, torch.tensor([0.2, 0.4, 0.7]), kind, CONFIG)
    )
    assert torch.equal(totals.votes, scores.votes) and int(scores.votes.min()) > 0 and scores.types == TYPES
    assert torch.allclose(totals.log_odds_gain, expected, atol=1e-4)


def test_each_type_is_calibrated_by_its_own_grasps() -> None:
    """A score of 0 tells nothing: three of four, one of five and none of two grasps held, and the prior is weak."""
    grasp_type = torch.tensor([2, 0, 1, 0, 1, 0, 1, 0, 1, 2, 1])
    success = torch.tensor([0, 1, 1, 1, 0, 1, 0, 0, 0, 0, 0]).bool()
    zero, free = torch.zeros(11), torch.zeros(11).bool()
    found = fit_calibration(zero, grasp_type, free, success, TYPES)
    assert found.numbers.shape == (3, 5)
    assert found.probability(zero[:3], torch.arange(3), free[:3]).tolist() == pytest.approx([0.75, 0.2, 0.01], abs=0.01)


@pytest.fixture
def model() -> GraspModel:
    """Of a hand with the types claw, hook and pinch."""
    pairs = CellPairs(*torch.tensor([[0, 1, 0], [0, 1, 2], [3, 4, 5]], dtype=torch.int32), torch.tensor([0, 1, 2]))
    learned = learn([(pairs, torch.tensor([0, 1]), torch.tensor([True, False, True]))], torch.rand(2, 144), CONFIG, 3)
    preshapes = {name: PreshapeConfig() for name in ("pinch", "hook", "claw")}
    rooms = {"sensing": SensingConfig, "features": FeatureConfig, "prototypes": PrototypeConfig}
    made = {name: plain(settings(kind)) for name, kind in rooms.items()} | {"affordance": plain(CONFIG)}
    return replace(learned, settings={**made, "hand": plain(replace(settings(HandConfig), preshapes=preshapes))})


def test_a_model_of_three_types_comes_back(model: GraspModel, tmp_path: Path) -> None:
    save_model(model, tmp_path)
    back = load_model(tmp_path)
    assert back.grasp_types == ("claw", "hook", "pinch") and back.condensed.base_rate.tolist() == [1, 0, 1]
    assert '"grasp_types": [\n  "claw",\n  "hook",\n  "pinch"\n ]' in (tmp_path / "model.json").read_text()


def test_a_model_of_fewer_types_than_its_hand_is_refused(model: GraspModel, tmp_path: Path) -> None:
    """The tensors of two types beside a hand of three."""
    save_model(replace(model, calibration=replace(model.calibration, numbers=torch.zeros(2, 5))), tmp_path)
    with pytest.raises(InputError, match=r"model.safetensors: expected calibration of shape \(3, 5\), got \(2, 5\)"):
        load_model(tmp_path)
