"""Pairs of patches: four numbers worked out by hand, and which neighbour is drawn."""

import math

import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.patch_pairs import drawn_neighbours, patch_pairs
from spgf_torch.settings import settings

CONFIG = settings(FeatureConfig, descriptor="patch_pairs", radius=0.03)


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_a_pair_by_hand() -> None:
    """A patch on top of a box and one on its side wall, 10 mm beyond the edge and 10 mm below it.

    From the upper patch the other one lies 45 deg below the plane: alpha1 = +45 deg, in the direction x. From the
    side patch, whose normal is x, the upper one lies behind its plane, too, 45 deg: +45 deg, in the direction z. The
    normals are 90 deg apart. The distance is sqrt(2) * 10 mm of 30, of 90 deg.
    """
    positions = torch.tensor([[0.0, 0.0, 0.0], [0.01, 0.0, -0.01]])
    normals = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    found = patch_pairs(positions, normals, CONFIG, generator())
    expected = torch.tensor([math.pi / 4, math.pi / 4, math.pi / 2, math.sqrt(2) / 3 * math.pi / 2])
    assert torch.allclose(found.relations(), expected.expand(2, 4), atol=1e-6)
    T = found.T_object_feature
    assert torch.allclose(T[0, :3, 0], torch.tensor([1.0, 0.0, 0.0])) and torch.allclose(T[0, :3, 2], normals[0])
    assert torch.allclose(T[1, :3, 0], torch.tensor([0.0, 0.0, 1.0])) and torch.allclose(T[1, :3, 2], normals[1])
    assert found.valid.all()


def test_the_other_side_of_a_wall_right_behind_gives_no_direction() -> None:
    positions = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, -0.002]])
    found = patch_pairs(positions, torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), CONFIG, generator())
    assert not found.valid.any() and found.relations().isfinite().all()


def test_every_neighbour_is_drawn_about_as_often() -> None:
    """A patch with four neighbours, 2000 times: each 500 times, give or take five standard deviations (97)."""
    around = torch.tensor([[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [-0.01, 0.0, 0.0], [0.0, -0.01, 0.0], [1.0, 0.0, 0.0]])
    points, draws = torch.cat([torch.zeros(1, 3), around]), generator()
    drawn = torch.stack([drawn_neighbours(points, 0.012, draws)[0] for _ in range(2000)])
    assert ((torch.bincount(drawn[:, 0], minlength=6) - torch.tensor([0, 500, 500, 500, 500, 0])).abs() <= 97).all()
    assert (drawn[:, 1:5] == 0).all() and (drawn[:, 5] == 5).all()


def test_no_neighbours_at_all() -> None:
    found = patch_pairs(torch.eye(3), torch.eye(3), CONFIG, generator())
    assert not found.valid.any() and found.relations().shape == (3, 4)
    assert len(patch_pairs(torch.zeros(0, 3), torch.zeros(0, 3), CONFIG, generator())) == 0


def test_refusals() -> None:
    with pytest.raises(InputError, match="generator"):
        patch_pairs(torch.eye(3), torch.eye(3), CONFIG)
    with pytest.raises(InputError, match="normals"):
        patch_pairs(torch.eye(3), torch.full((3, 3), math.nan), CONFIG, generator())
    with pytest.raises(InputError, match="points"):
        patch_pairs(torch.full((3, 3), math.nan), torch.eye(3), CONFIG, generator())


def test_an_unequal_pair_by_hand() -> None:
    """The same box, 20 mm beyond the edge and 10 mm below it.

    From the upper patch the other one lies atan(10 / 20) below the plane; from the side patch the upper one lies 20 mm
    behind and 10 mm up: atan(20 / 10). So each has its own elevation first, and the other's second.
    """
    positions = torch.tensor([[0.0, 0.0, 0.0], [0.02, 0.0, -0.01]])
    normals = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    flat, steep, rest = math.atan(0.5), math.atan(2), [math.pi / 2, math.sqrt(5) / 3 * math.pi / 2]
    found = patch_pairs(positions, normals, CONFIG, generator()).relations()
    assert torch.allclose(found, torch.tensor([[flat, steep, *rest], [steep, flat, *rest]]), atol=1e-6)


def test_a_pair_above_and_below_by_hand() -> None:
    """Two parallel patches, one 10 mm higher and 20 mm aside: above is negative, each to the other the opposite."""
    positions, normals = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.02, 0.01]]), torch.tensor([[0.0, 0.0, 1.0]] * 2)
    rise, rest = math.atan(0.5), [0.0, math.sqrt(5) / 3 * math.pi / 2]
    found = patch_pairs(positions, normals, CONFIG, generator()).relations()
    assert torch.allclose(found, torch.tensor([[-rise, rise, *rest], [rise, -rise, *rest]]), atol=1e-4)
