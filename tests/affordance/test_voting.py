"""Pairs, their cells and votes, against loops in float64."""

import math
from dataclasses import replace

import pytest
import torch

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.particles import Particles
from spgf_torch.affordance.ranking import log_odds_gain, point_gains, score_grasps, shrunk_mean
from spgf_torch.affordance.voting import VotingIndex, cast_votes, vote_totals
from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import SE3Grid
from spgf_torch.ops.cell_pairs import cell_pairs
from spgf_torch.ops.look_up_points import NO_POINT
from spgf_torch.settings import settings

GRID = SE3Grid(reach=0.05, voxel=0.012, rotation_deg=45.0)
CONFIG = settings(AffordanceConfig)
PROTOTYPES = 3


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def poses(n: int, generator: torch.Generator) -> torch.Tensor:
    return se3.random_poses(n, generator, extent=0.03)


def loop_pairs(features: torch.Tensor, grasps: torch.Tensor) -> list[tuple[int, int, int]]:
    """The definition in float64: origins within reach, and the cell by arcs of the largest component's chart."""
    found, n, side = [], GRID.chart_side, GRID.side
    for f, T in enumerate(features.double()):
        for g, grasp in enumerate(grasps.double()):
            relative = se3.inverse(T) @ grasp
            if float(relative[:3, 3].norm()) > GRID.reach:
                continue
            voxel = [min(max(math.floor(x / GRID.voxel + side / 2), 1), side - 2) for x in relative[:3, 3].tolist()]
            q = se3.quaternion_of(relative).tolist()
            chart = max(range(4), key=lambda i: abs(q[i]))
            arcs = [math.atan(q[i] / q[chart]) for i in range(4) if i != chart]
            rotation = chart
            for arc in arcs:
                rotation = rotation * n + math.floor((arc / (math.pi / 2) + 0.5) * n)
            found.append((f, g, ((rotation * side + voxel[0]) * side + voxel[1]) * side + voxel[2]))
    return found


def test_pairs_equal_the_loop(generator: torch.Generator) -> None:
    features, grasps = poses(70, generator), poses(30, generator)
    expected = loop_pairs(features, grasps)
    found = torch.stack(cell_pairs(features, grasps, GRID.numbers), dim=1)
    assert [tuple(row) for row in found.tolist()] == expected
    assert 500 < len(expected) < 2100


def test_pairs_of_nothing(generator: torch.Generator) -> None:
    some, none = poses(3, generator), torch.zeros(0, 4, 4)
    for features, grasps in ((some, none), (none, some), (none, none), (some, some + 1)):
        assert [len(column) for column in cell_pairs(features, grasps, GRID.numbers)] == [0, 0, 0]


def learned(generator: torch.Generator) -> VotingIndex:
    """A third of all cells of each partition, but for one partition without any."""
    start, cells = [0], []
    for s in range(2 * PROTOTYPES):
        chosen = torch.rand(GRID.cells, generator=generator) < (0.0 if s == 3 else 0.3)
        cells.append(chosen.nonzero()[:, 0].int())
        start.append(start[-1] + len(cells[-1]))
    probability, support = torch.rand(start[-1], generator=generator), 20 * torch.rand(start[-1], generator=generator)
    rates = torch.tensor([0.2, 0.4])
    return VotingIndex(Condensed(torch.tensor(start), torch.cat(cells), probability, support + 2, rates), GRID)


def test_points_are_found_as_by_a_dictionary(generator: torch.Generator) -> None:
    index = learned(generator)
    keys = zip(index.condensed.partition_of_point().tolist(), index.condensed.cell.tolist(), strict=True)
    points = {key: i for i, key in enumerate(keys)}
    partition = torch.randint(2 * PROTOTYPES, (5000,), generator=generator).int()
    cell = torch.randint(GRID.cells, (5000,), generator=generator).int()
    expected = [points.get(key, NO_POINT) for key in zip(partition.tolist(), cell.tolist(), strict=True)]
    assert index.find(partition, cell).tolist() == expected
    assert 1000 < sum(i != NO_POINT for i in expected) < 2000


def test_gains_of_points_are_those_of_their_votes(generator: torch.Generator) -> None:
    index = learned(generator)
    partition = index.condensed.partition_of_point().int()
    votes = cast_votes(index, Particles(partition, index.condensed.cell, 2), partition % 2)
    expected = log_odds_gain(votes, index.condensed.base_rate, torch.arange(2), CONFIG)
    assert torch.equal(point_gains(index.condensed, CONFIG), expected)


def test_totals_say_what_listed_votes_say(generator: torch.Generator) -> None:
    """More grasps than one part of the work holds; on one thread and on two."""
    index, features, grasps = learned(generator), poses(40, generator), poses(1100, generator)
    ids, kind = torch.randint(PROTOTYPES, (40,), generator=generator), torch.arange(1100) % 2
    feature, grasp, cell = cell_pairs(features, grasps, GRID.numbers)
    votes = cast_votes(index, Particles((ids[feature] * 2 + kind[grasp]).int(), cell, 2), grasp)
    rates = index.condensed.base_rate
    scores = score_grasps(votes, rates, kind, torch.zeros(1100, dtype=torch.bool), CONFIG)
    threads, totals = torch.get_num_threads(), []
    for count in (1, 2):
        torch.set_num_threads(count)
        totals.append(vote_totals(index, point_gains(index.condensed, CONFIG), features, ids, grasps, kind))
        torch.set_num_threads(threads)
    assert torch.equal(totals[0].votes, scores.votes) and torch.equal(totals[1].votes, scores.votes)
    assert torch.equal(totals[0].log_odds_gain, totals[1].log_odds_gain)
    found = shrunk_mean(totals[0].log_odds_gain, totals[0].votes, CONFIG)
    assert torch.allclose(found, scores.log_odds, atol=1e-5) and int(scores.votes.max()) > 10


def test_totals_of_a_model_that_learned_nothing(generator: torch.Generator) -> None:
    full = learned(generator).condensed
    nothing = replace(full, **{name: getattr(full, name)[:0] for name in ("cell", "probability", "support")})
    index = VotingIndex(replace(nothing, partition_start=torch.zeros(7, dtype=torch.int64)), GRID)
    ids, kind = torch.zeros(5, dtype=torch.int64), torch.zeros(8, dtype=torch.int64)
    found = vote_totals(index, nothing.support, poses(5, generator), ids, poses(8, generator), kind)
    assert found.votes.tolist() == [0] * 8 and found.log_odds_gain.tolist() == [0] * 8
