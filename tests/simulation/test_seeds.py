"""Candidates follow from the seed, the object's name and the grasp type: another of them, other candidates."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import torch
from toys import TRIALS, Toy

from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.execute import Poses, made_with, provenance_of, sample
from spgf_torch.simulation.table import Provenance


def poses(name: str = "egg", seed: int = 0, samplers: Mapping[str, str] = TRIALS.samplers) -> Poses:
    """Twenty of each type."""
    toy = Toy(name)
    sampler = vars(settings(SamplerConfig))
    made = Provenance(toy.name, toy.digest, TRIALS.hand.digest, sampler, {}, candidates=20, seed=seed)
    return sample(toy, made, samplers)


def test_candidates_follow_seed_name_and_type() -> None:
    first = poses()
    assert torch.equal(first.position, poses().position) and torch.equal(first.quaternion, poses().quaternion)
    for other in (poses(seed=1), poses(name="pear")):
        assert not torch.isclose(first.position, other.position).all(1).any()
    assert not torch.isclose(first.position[:20], first.position[20:]).all(1).any()


def test_candidates_of_a_type_do_not_depend_on_other_types() -> None:
    """With a third type between them, drawn by another sampler, NPG and WPG stay to the bit."""
    two, three = poses(), poses(samplers={"NPG": "surface_pairs", "claw": "approach", "WPG": "surface_pairs"})
    assert three.grasp_types == ("NPG", "claw", "WPG") and three.grasp_type.tolist() == [0] * 20 + [1] * 20 + [2] * 20
    for name in ("position", "quaternion"):
        of_two, of_three = getattr(two, name), getattr(three, name)
        assert torch.equal(of_two, torch.cat([of_three[:20], of_three[40:]]))


def test_each_type_has_the_sampler_of_its_preshape() -> None:
    """Of one name and seed the two samplers draw other poses."""
    paired, approached = (poses(samplers={"NPG": name}) for name in ("surface_pairs", "approach"))
    assert not torch.isclose(paired.position, approached.position).all(1).any()


def test_a_table_says_the_settings_of_its_own_samplers() -> None:
    """How deep approaches go is nothing to a hand whose candidates are all pairs, and was unknown to older tables."""
    config, told = settings(SamplerConfig, depth=0.03), []
    for sampler in ("surface_pairs", "approach"):
        made: Any = SimpleNamespace(hand=TRIALS.hand, episode=settings(EpisodeConfig), samplers={"NPG": sampler})
        told.append(provenance_of(Toy("egg"), made, config, 20, 0).sampler)
        assert made_with(made, config, 20, 0)["sampler"] == told[-1]
    pairs = {"jitter_deg": config.jitter_deg, "jitter": config.jitter}
    assert told == [pairs, {**pairs, "depth": 0.03}]
