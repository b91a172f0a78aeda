"""Promising points and the hypotheses they make: against loops, and one feature and one particle by hand."""

import math

import pytest
import torch
from proposing_models import AFFORDANCE, CONFIG, learned

from spgf_torch.affordance.ranking import point_gains
from spgf_torch.geometry import se3
from spgf_torch.proposing.grasp_seeds import GraspSeeds, grasp_seeds
from spgf_torch.settings import settings

HALF_TURN = torch.diag(torch.tensor([-1.0, -1, 1, 1]))


def near(a: torch.Tensor, b: torch.Tensor, distance: float, deg: float) -> bool:
    angle = min(float(se3.relative_angle(a, turned)) for turned in (b, b @ HALF_TURN))
    return float((a[:3, 3] - b[:3, 3]).norm()) <= distance and math.degrees(angle) <= deg


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_hypotheses_equal_the_loop(generator: torch.Generator) -> None:
    counts = torch.tensor([2, 0, 3, 1])  # prototype 0: two of NPG, none of WPG; prototype 1: three and one
    start = torch.cat([torch.zeros(1, dtype=torch.long), counts.cumsum(0)])
    listed = GraspSeeds(start, se3.random_poses(6, generator), 2)
    features, prototype = se3.random_poses(5, generator), torch.tensor([1, 0, 0, 1, 0])
    expected, types = [], []
    for T, p in zip(features, prototype.tolist(), strict=True):
        for kind in range(2):
            for point in range(int(start[2 * p + kind]), int(start[2 * p + kind + 1])):
                expected.append(T @ listed.T_feature_grasp[point])
                types.append(kind)
    T, grasp_type = listed.hypotheses(features, prototype)
    assert grasp_type.tolist() == types and len(types) == 14
    assert torch.allclose(T, torch.stack(expected), atol=1e-6)
    assert len(listed.hypotheses(features[:0], prototype[:0])[1]) == 0


def test_one_feature_and_one_particle_by_hand() -> None:
    """A feature at (0.1, 0, 0) whose x axis is the object's y; its particle is 20 mm ahead along its own x, turned
    90 deg about z: the grasp lies at (0.1, 0.02, 0), turned 180 deg about z in all."""
    quarter = torch.tensor([math.sqrt(0.5), 0, 0, math.sqrt(0.5)])
    T_object_feature = se3.pose(torch.tensor([0.1, 0, 0]), quarter)
    T_feature_grasp = se3.pose(torch.tensor([0.02, 0, 0]), quarter)
    listed = GraspSeeds(torch.tensor([0, 0, 1]), T_feature_grasp.unsqueeze(0), 2)  # one point of prototype 0, WPG
    T, grasp_type = listed.hypotheses(T_object_feature.unsqueeze(0), torch.tensor([0]))
    expected = torch.diag(torch.tensor([-1.0, -1, 1, 1]))
    expected[:2, 3] = torch.tensor([0.1, 0.02])
    assert grasp_type.tolist() == [1]
    assert torch.allclose(T[0], expected, atol=1e-6)


def test_grasp_seeds_equals_the_loop(generator: torch.Generator) -> None:
    """Of each partition: points better than the base rate, by gain; each stays unless a better one is near."""
    model = learned(generator)
    config = settings(type(CONFIG), point_support=2, points=4, pool=50)
    condensed, found = model.condensed, grasp_seeds(model, point_gains(model.condensed, AFFORDANCE), config, (2, 2))
    position, quaternion = model.grid.centres(condensed.cell)
    T = se3.pose(position, quaternion)
    some = 0
    for s in range(6):
        base = float(condensed.base_rate[s % 2])
        gains = {}
        for i in range(int(condensed.partition_start[s]), int(condensed.partition_start[s + 1])):
            p, n = float(condensed.probability[i]), float(condensed.support[i])
            shrunk = min(max((p * n + base * AFFORDANCE.shrinkage) / (n + AFFORDANCE.shrinkage), 1e-4), 1 - 1e-4)
            gain = math.log(shrunk / (1 - shrunk)) - math.log(base / (1 - base))
            if gain > 0 and n >= 2:
                gains[i] = round(gain, 5)
        kept: list[int] = []
        for i in sorted(gains, key=lambda i: (-gains[i], i))[:50]:
            if not any(near(T[i], T[j], config.point_distance, config.point_deg) for j in kept):
                kept.append(i)
        part = found.T_feature_grasp[int(found.start[s]) : int(found.start[s + 1])]
        assert torch.allclose(part, T[kept[:4]], atol=1e-6)
        some += len(part)
    assert some > 12
