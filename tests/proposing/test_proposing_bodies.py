"""Which texlets are of one thing: by distance, and by hollows between them."""

import math
from dataclasses import replace

import pytest
import torch

from spgf_torch.predictor import block
from spgf_torch.proposing.bodies import bodies_of, body_at
from spgf_torch.proposing.config import proposing_named
from spgf_torch.sensing.texlets import Texlets

CONFIG = proposing_named("clutter").neighbours
BLOCK = block(0.005, 0.04)


def beside(gap: float) -> Texlets:
    """Two blocks of 4 cm whose faces are so far apart along x, m."""
    shift = torch.tensor([0.04 + gap, 0, 0])
    return Texlets(torch.cat([BLOCK.positions, BLOCK.positions + shift]), BLOCK.normals.repeat(2, 1))


@pytest.mark.parametrize(("gap", "count"), [(0.02, 2), (0.008, 2), (0.006, 1)])
def test_things_apart_are_two(gap: float, count: int) -> None:
    bodies = bodies_of(beside(gap), replace(CONFIG, body_hollow_deg=180))
    n = len(BLOCK)
    assert len(bodies.unique()) == count
    assert len(bodies[:n].unique()) == len(bodies[n:].unique()) == 1


@pytest.mark.parametrize(("angle", "one"), [(13, True), (17, False), (-35, True), (-100, True)])
def test_a_hollow_is_where_two_things_touch(angle: float, one: bool) -> None:
    """Two sheets that meet in a line: the second rises by the angle (a hollow) or falls (an edge)."""
    u, v = torch.cartesian_prod(torch.arange(5) + 0.5, torch.arange(5) + 0.5).mul(0.005).unbind(1)
    rise = math.radians(angle)
    flat = torch.stack([-u, v, 0 * u], 1)
    other = torch.stack([u * math.cos(rise), v, u * math.sin(rise)], 1)
    normals = torch.tensor([[0.0, 0, 1], [-math.sin(rise), 0, math.cos(rise)]]).repeat_interleave(25, 0)
    bodies = bodies_of(Texlets(torch.cat([flat, other]), normals), CONFIG)
    assert len(bodies.unique()) == (1 if one else 2)


def test_a_place_is_at_the_nearest_body() -> None:
    texlets = beside(0.02)
    bodies = bodies_of(texlets, CONFIG)
    first, second = int(bodies[0]), int(bodies[-1])
    places = torch.tensor([[0.029, 0, 0], [0.031, 0, 0], [0, 0, 1.0]])
    assert body_at(places, texlets.positions, bodies).tolist() == [first, second, first]


def test_nothing_is_of_no_body() -> None:
    assert len(bodies_of(Texlets(torch.zeros(0, 3), torch.zeros(0, 3)), CONFIG)) == 0
