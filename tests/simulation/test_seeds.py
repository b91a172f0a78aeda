"""Candidates follow from the seed, the object's name and the grasp type: another of them, other candidates."""

import torch
from toys import TRIALS, Toy

from spgf_torch.settings import settings
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.execute import Poses, sample
from spgf_torch.simulation.table import Provenance


def poses(name: str = "egg", seed: int = 0) -> Poses:
    """Twenty of each type."""
    toy = Toy(name)
    sampler = vars(settings(SamplerConfig))
    made = Provenance(toy.name, toy.digest, TRIALS.hand.digest, sampler, {}, candidates=20, seed=seed)
    return sample(toy, made, TRIALS.samplers)


def test_candidates_follow_seed_name_and_type() -> None:
    first = poses()
    assert torch.equal(first.position, poses().position) and torch.equal(first.quaternion, poses().quaternion)
    for other in (poses(seed=1), poses(name="pear")):
        assert not torch.isclose(first.position, other.position).all(1).any()
    assert not torch.isclose(first.position[:20], first.position[20:]).all(1).any()
