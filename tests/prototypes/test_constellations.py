"""Constellations: shares of prototypes in sectors about a feature, the same for a turned object."""

import torch

from spgf_torch.geometry.se3 import from_rotation, random_poses
from spgf_torch.prototypes.config import ConstellationConfig
from spgf_torch.prototypes.constellations import constellations, surroundings

CONFIG = ConstellationConfig(words=2, inner=0.03, outer=0.06, sectors=4, own=0.5)


def lying(*places: tuple[float, float, float]) -> torch.Tensor:
    """Feature poses at these places (m) with the axes of the object."""
    return from_rotation(torch.eye(3), torch.tensor(places))


def test_shares_of_a_feature_by_hand() -> None:
    """Along x two neighbours of prototypes 0 and 1, along y one of 1; nearer than 30 mm or beyond 60 mm none counts."""
    poses = lying((0, 0, 0), (0.04, 0, 0), (0.05, 0.01, 0), (0, 0.04, 0.02), (0.02, 0, 0), (0.07, 0, 0))
    ids = torch.tensor([1, 0, 1, 1, 0, 0])
    own, *sectors = constellations(ids, 2, surroundings(poses, CONFIG), CONFIG)[0].split(2)
    assert own.tolist() == [0.0, 0.5]
    assert [sector.tolist() for sector in sectors] == [[0.5, 0.5], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]


def test_a_sector_lies_about_its_direction_in_the_features_frame() -> None:
    """A feature whose x points along the object's y sees a neighbour on y in sector 0, one on x in sector 3."""
    poses = lying((0, 0, 0), (0, 0.04, 0), (0.04, 0, 0))
    poses[0, :3, :3] = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    around = surroundings(poses, CONFIG)
    of_first = {int(n): int(s) for c, n, s in zip(*vars(around).values(), strict=True) if c == 0}
    assert of_first == {1: 0, 2: 3}


def test_a_turned_object_has_the_same_constellations() -> None:
    generator = torch.Generator().manual_seed(0)
    poses, ids = random_poses(60, generator, extent=0.05), torch.randint(0, 5, (60,), generator=generator)
    turned = random_poses(1, generator)[0] @ poses
    first, second = (constellations(ids, 5, surroundings(each, CONFIG), CONFIG) for each in (poses, turned))
    assert first.shape == (60, 25) and first[:, 5:].any()
    torch.testing.assert_close(first, second, rtol=0, atol=1e-6)
