"""Which grasps are executed, and what their outcomes come to."""

import pytest
import torch
import trimesh

from spgf_torch.evaluate import outcomes_of
from spgf_torch.experiment.execution import Executed, best_grasps, candidate_grasps
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import settings
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.table import OUTCOMES


@pytest.fixture
def block() -> GraspObject:
    mesh = trimesh.creation.box((0.05, 0.06, 0.08))
    return GraspObject("block", "boxes", mesh, (mesh.vertices,), 0.2, mesh.center_mass, mesh.moment_inertia)


def test_best_grasps_by_hand() -> None:
    """NPG: 0 (0.9), 2 (0.1); WPG: 3 and 1 tie at 0.5, the earlier first; both: 0, 1."""
    best = best_grasps(torch.tensor([0.9, 0.5, 0.1, 0.5]), torch.tensor([0, 1, 0, 1]), 2, ("NPG", "WPG"))
    assert {kind: chosen.tolist() for kind, chosen in best.items()} == {"NPG": [0, 2], "WPG": [1, 3], "CG": [0, 1]}


def test_best_grasps_of_three_types() -> None:
    """Of one claw, a hook without a vote and three pinches; of all, the first two by score."""
    score, types = torch.tensor([0.3, -torch.inf, 0.1, 0.9, 0.4]), torch.tensor([0, 1, 2, 2, 2])
    best = best_grasps(score, types, 2, ("claw", "hook", "pinch"))
    found = {kind: chosen.tolist() for kind, chosen in best.items()}
    assert found == {"claw": [0], "hook": [], "pinch": [3, 4], "CG": [3, 4]}


def test_candidates_of_each_type_are_by_its_sampler(block: GraspObject) -> None:
    """Approaches look along the normal of a face; the type before them has the poses that it has alone."""
    sampler = settings(SamplerConfig, jitter_deg=0, jitter=0)
    both = candidate_grasps(block, 20, sampler, 0, {"claw": "surface_pairs", "scoop": "approach"})
    alone = candidate_grasps(block, 20, sampler, 0, {"claw": "surface_pairs"})
    assert torch.equal(both.T_object_tcp[:20], alone.T_object_tcp) and both.grasp_type.tolist() == [0] * 20 + [1] * 20
    assert torch.allclose(both.T_object_tcp[20:, :3, 2].abs().max(1).values, torch.ones(20), atol=1e-6)


def test_candidates_follow_from_seed_and_name(block: GraspObject) -> None:
    sampler, samplers = settings(SamplerConfig), dict.fromkeys(("NPG", "WPG"), "surface_pairs")
    first, again, other = (candidate_grasps(block, 20, sampler, seed, samplers) for seed in (0, 0, 1))
    assert torch.equal(first.T_object_tcp, again.T_object_tcp)
    assert not torch.equal(first.T_object_tcp, other.T_object_tcp)
    assert first.grasp_type.tolist() == [0] * 20 + [1] * 20


def test_rates_of_an_object_by_hand(block: GraspObject) -> None:
    """Best NPG: grasps 0, 1 -> 1/2; CG: 0, 2 -> 1; random NPG 1 -> 0, WPG 2, 3 -> 1/2; of all three 1/3."""
    executed = Executed(
        best={"NPG": torch.tensor([0, 1]), "CG": torch.tensor([0, 2])},
        outcome=torch.tensor([OUTCOMES.index(word) for word in ("success", "missed", "success", "collision")]),
        random={"NPG": torch.tensor([1]), "WPG": torch.tensor([2, 3])},
    )
    (outcome,) = outcomes_of([block], [executed], seconds=0.5)
    assert outcome.best == {"NPG": 0.5, "CG": 1.0}
    assert outcome.random == pytest.approx({"NPG": 0.0, "WPG": 0.5, "CG": 1 / 3})
    assert executed.rate(torch.tensor([], dtype=torch.int64)) == 0
