"""Which feature voted for which grasp, against a slow loop: as many votes and gains as the ranking counted."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from asymmetric import GRIPPERS, asymmetric
from proposing_models import CONFIG, VOLUMES, features_of, learned, patches

from spgf_torch.affordance.voting import vote_totals
from spgf_torch.features.spgf import Features
from spgf_torch.geometry import se3
from spgf_torch.hands import records
from spgf_torch.predictor import Predictor
from spgf_torch.proposing.proposals import Proposals
from spgf_torch.proposing.propose import Proposer
from spgf_torch.proposing.voters import voters_of_each
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings

NOTHING = torch.zeros(0, 3)


@pytest.fixture(scope="module")
def proposer() -> Proposer:
    return Proposer.of(learned(torch.Generator().manual_seed(0)), CONFIG, VOLUMES)


@pytest.fixture(scope="module")
def features(proposer: Proposer) -> Features:
    """60 of them, of which every fifth is not valid: indices of texlets are not those of voters."""
    generator = torch.Generator().manual_seed(1)
    ids = torch.randint(3, (60,), generator=generator)
    found = features_of(patches(60, generator).float(), ids, proposer.model.centres)
    return replace(found, valid=torch.arange(60) % 5 != 0)


@pytest.fixture(scope="module")
def found(proposer: Proposer, features: Features) -> Proposals:
    return proposer.propose_from(features, NOTHING)


def slowly(proposer: Proposer, features: Features, T: torch.Tensor, kind: int) -> dict[int, tuple[int, float, float]]:
    """Of one grasp: texlet -> prototype, probability, support, by looking each feature's pose of the grasp up."""
    model, found, cells = proposer.model, {}, proposer.model.condensed.cell.tolist()
    for i in features.valid.nonzero()[:, 0].tolist():
        relative = torch.linalg.inv(features.T_object_feature[i].double()) @ T.double()
        cell = int(model.grid.index(relative[:3, 3], se3.quaternion_of(relative)))
        prototype = int(torch.cdist(features.relations()[i : i + 1], model.centres).argmin())
        first, end = model.condensed.partition_start[2 * prototype + kind :][:2].tolist()
        for point in range(first, end):
            if cells[point] == cell:
                known = float(model.condensed.probability[point]), float(model.condensed.support[point])
                found[i] = (prototype, *known)
    return found


def test_voters_are_those_that_a_slow_loop_finds(proposer: Proposer, features: Features, found: Proposals) -> None:
    chosen, votes = [0, 3, 4, len(found) - 1], 0
    for i, voters in zip(chosen, proposer.who_voted(found, chosen), strict=True):
        expected = slowly(proposer, features, found.T_object_tcp[i], int(found.grasp_type[i]))
        rows = zip(voters.prototype.tolist(), voters.probability.tolist(), voters.support.tolist(), strict=True)
        assert dict(zip(voters.texlet.tolist(), rows, strict=True)) == expected
        votes += len(expected)
        at = features.T_object_feature[voters.texlet].double().numpy()
        assert np.array_equal(voters.position, at[:, :3, 3]) and np.array_equal(voters.normal, at[:, :3, 2])
    assert votes > 4


def test_they_add_up_to_what_was_ranked_by(proposer: Proposer, features: Features, found: Proposals) -> None:
    """Counts, prototypes and the sum of the gains; the score is that sum over the votes and those of nothing."""
    voters = proposer.voters(features)
    given = voters.T_object_feature, voters.prototype, found.T_object_tcp, found.grasp_type
    totals = vote_totals(proposer.index, proposer.gains, *given)
    for i, each in enumerate(proposer.who_voted(found, list(range(len(found))))):
        assert len(each) == int(found.support[i]) == int(totals.votes[i])
        counts = np.bincount(each.prototype, minlength=3)
        assert {k: n for k, n in enumerate(counts.tolist()) if n} == dict(found.voted_by[i])
        assert each.gain.sum(dtype=np.float64) == pytest.approx(float(totals.log_odds_gain[i]), rel=1e-6, abs=1e-6)
        assert each.gain.sum() / (len(each) + CONFIG.vote_shrinkage) == pytest.approx(float(found.score[i]), abs=1e-6)
        assert (np.diff(each.gain) <= 0).all()


def test_a_jaw_turned_half_round_has_its_own_voters(proposer: Proposer, features: Features, found: Proposals) -> None:
    """The same grasp in two poses, and one out of reach: each has the votes for that very pose."""
    tcp = found.T_object_tcp[0]
    T = torch.stack([tcp, tcp @ torch.diag(torch.tensor([-1.0, -1, 1, 1])), tcp])
    T[2, 0, 3] += 5.0
    kind, voters = found.grasp_type[:1].repeat(3), proposer.voters(features)
    each = voters_of_each(proposer.index, proposer.gains, voters, T, kind)
    totals = vote_totals(proposer.index, proposer.gains, voters.T_object_feature, voters.prototype, T, kind)
    assert [len(its) for its in each] == totals.votes.tolist() and len(each[2]) == 0
    assert each[2].position.shape == (0, 3) and each[0].texlet.tolist() != each[1].texlet.tolist()
    assert voters_of_each(proposer.index, proposer.gains, voters, T[:0], kind[:0]) == []


def test_predicted_grasps_have_them(proposer: Proposer, features: Features, found: Proposals) -> None:
    """Those of their own pose, whatever their place in the ranking; None where nobody voted."""
    predictor = Predictor(proposer.model, settings(SensingConfig), GRIPPERS, proposer, 0.1)
    grasps = predictor.grasps(found, 2)
    assert len({grasp.type for grasp in grasps}) == 2
    for grasp in grasps:
        (own,) = voters_of_each(
            proposer.index,
            proposer.gains,
            proposer.voters(features),
            torch.from_numpy(grasp.T_input_tcp)[None].float(),
            torch.tensor([found.grasp_types.index(grasp.type)]),
        )
        assert isinstance(grasp.voters, records.Voters) and np.array_equal(grasp.voters.texlet, own.texlet)
        assert len(grasp.voters) == grasp.support and "voters" not in repr(grasp)
    nobody = replace(found, voters=None)
    assert [grasp.voters for grasp in predictor.grasps(nobody, 1)] == [None, None]
    none = proposer.propose_from(replace(features, valid=torch.zeros_like(features.valid)), NOTHING)
    assert predictor.grasps(none, 2) == []


def test_texlets_of_several_targets_are_numbered_as_the_scenes(proposer: Proposer) -> None:
    """Two bumpy sheets side by side, the texlets of which take turns in the scene."""
    generator = torch.Generator().manual_seed(2)
    at = torch.cartesian_prod(torch.arange(8.0), torch.arange(8.0)).repeat_interleave(2, dim=0) * 0.006
    height = 0.003 * torch.randn(128, 1, generator=generator)
    labels = torch.tensor([2, 7]).repeat(64)
    positions = torch.cat([at, height], dim=1) + (labels == 7)[:, None] * torch.tensor([0.3, 0.1, 0.0])
    tilted = torch.tensor([0.0, 0, 1]) + 0.1 * torch.randn(128, 3, generator=generator)
    texlets = Texlets(positions, torch.nn.functional.normalize(tilted, dim=1))
    sensing = settings(SensingConfig)
    scene = Scene(texlets, labels, torch.zeros(0, 3), None, None, None, sensing.spacing, ())
    grasps = Predictor(proposer.model, sensing, GRIPPERS, proposer, 0.1).predict(scene, top=2)
    assert {grasp.target for grasp in grasps} == {2, 7}
    for grasp in grasps:
        assert grasp.voters is not None and len(grasp.voters) == grasp.support > 0
        assert set(labels[grasp.voters.texlet].tolist()) == {grasp.target}
        np.testing.assert_array_equal(grasp.voters.position, positions[grasp.voters.texlet].double())
        np.testing.assert_allclose(grasp.voters.normal, texlets.normals[grasp.voters.texlet], atol=1e-6)


def test_voters_move_with_their_grasp() -> None:
    """A quarter turn about z, then 1 m along x: (3, 4, 5) m becomes (1 - 4, 3, 5), and +x becomes +y."""
    one = np.ones(1, dtype=np.float32)
    voters = records.Voters(
        np.array([8]), np.array([[3.0, 4, 5]]), np.array([[1.0, 0, 0]]), np.array([2]), one, one, one
    )
    grasp = replace(asymmetric(), voters=voters)
    moved = grasp.transform(np.array([[0.0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    assert moved.voters is not None and moved.voters.texlet.tolist() == [8]
    assert moved.voters.position.tolist() == [[-3, 3, 5]] and moved.voters.normal.tolist() == [[0, 1, 0]]
    assert grasp.voters is voters and asymmetric().transform(np.eye(4)).voters is None
