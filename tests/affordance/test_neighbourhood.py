"""Neighbourhood analysis, condensation, votes and rankings against loops that follow the definitions."""

import math
from dataclasses import fields, replace

import pytest
import torch

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.neighbourhood import (
    Condensed,
    Counts,
    ShapeGraspSpace,
    analyse,
    base_rates,
    condense,
    significant_points,
)
from spgf_torch.affordance.pairs import CellPairs, cell_pairs, pose_pairs, shape_grasp_particles
from spgf_torch.affordance.particles import Particles
from spgf_torch.affordance.voting import NO_POINT, VotingIndex, cast_votes, counted_votes
from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import Kernel, SE3Grid, gaussian_kernel
from spgf_torch.settings import settings

GRID = SE3Grid(reach=0.03, voxel=0.01, rotation_deg=60.0)
PROTOTYPES = 3


def random_particles(n: int, generator: torch.Generator) -> Particles:
    """Particles crowded into a few cells, so that neighbourhoods overlap."""
    direction = torch.nn.functional.normalize(torch.randn(n, 3, generator=generator), dim=1)
    quaternion = torch.nn.functional.normalize(
        torch.tensor([1.0, 0, 0, 0]) + 0.3 * torch.randn(n, 4, generator=generator), dim=1
    )
    cell = GRID.index(direction * 0.012, quaternion)
    prototype = torch.randint(PROTOTYPES, (n,), generator=generator)
    partition = prototype * 2 + torch.randint(2, (n,), generator=generator)
    return Particles(partition.int(), cell.int(), 2, torch.rand(n, generator=generator) < 0.3)


def taken(particles: Particles, which: torch.Tensor) -> Particles:
    """The particles of these indices, in their order."""
    assert particles.success is not None
    columns = (particles.partition[which], particles.cell[which])
    return Particles(*columns, particles.types, particles.success[which])


def loop_condense(particles: Particles, kernel_mm: float, kernel_deg: float, min_support: float) -> dict:
    """The definition in float64: for every populated point, all particles of its id and type, weighted."""
    points = {}
    position, quaternion = (t.double().tolist() for t in GRID.centres(particles.cell))
    keys = list(zip(*(getattr(particles, k).tolist() for k in ("prototype", "grasp_type", "cell")), strict=True))
    for i, key in enumerate(keys):
        if key in points:
            continue
        success = support = 0.0
        for j, other in enumerate(keys):
            if other[:2] != key[:2]:
                continue
            distance = math.dist(position[i], position[j])
            cosine = abs(sum(a * b for a, b in zip(quaternion[i], quaternion[j], strict=True)))
            angle = math.degrees(2 * math.acos(min(1.0, cosine)))
            if distance > 2 * kernel_mm + 1e-6 or angle > 2 * kernel_deg + 1e-4:
                continue
            weight = math.exp(-0.5 * (distance / kernel_mm) ** 2) * math.exp(-0.5 * (angle / kernel_deg) ** 2)
            support += weight
            success += weight * bool(particles.success[j])
        if support >= min_support:
            points[key] = (success / support, support)
        else:
            points[key] = None
    return {key: value for key, value in points.items() if value is not None}


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


@pytest.fixture
def kernel() -> Kernel:
    return gaussian_kernel(GRID, 0.006, 30.0)


def test_condense_equals_the_loop(generator: torch.Generator, kernel: Kernel) -> None:
    particles = random_particles(300, generator)
    condensed = condense([particles], PROTOTYPES, GRID, kernel, 2.0)
    expected = loop_condense(particles, 0.006, 30.0, 2.0)
    found = {}
    for s, cell, p, n in zip(
        condensed.partition_of_point(), condensed.cell, condensed.probability, condensed.support, strict=True
    ):
        found[int(s) // 2, int(s) % 2, int(cell)] = (float(p), float(n))
    assert 20 < len(expected) < 300
    assert found.keys() == expected.keys()
    for key, (p, n) in expected.items():
        assert found[key] == pytest.approx((p, n), rel=2e-3)


def test_order_of_particles_does_not_matter(generator: torch.Generator, kernel: Kernel) -> None:
    particles = random_particles(500, generator)
    order = torch.randperm(500, generator=generator)
    shuffled = taken(particles, order)
    a, b = (condense([p], PROTOTYPES, GRID, kernel, 1.0) for p in (particles, shuffled))
    for name in ("partition_start", "cell", "probability", "support", "base_rate"):
        assert torch.equal(getattr(a, name), getattr(b, name))


def test_four_particles_by_hand() -> None:
    """No smoothing: two cells of prototype 0, NPG. Cell a: 2 successes of 3; cell b: 1 particle, not significant."""
    kernel = gaussian_kernel(GRID, 0.0, 0.0)
    cell = GRID.index(torch.tensor([[0.0, 0, 0]] * 3 + [[0.02, 0, 0]]), torch.tensor([[1.0, 0, 0, 0]] * 4))
    particles = Particles(torch.zeros(4, dtype=torch.int32), cell.int(), 2, torch.tensor([True, False, True, True]))
    condensed = condense([particles], 1, GRID, kernel, min_support=2)
    assert condensed.cell.tolist() == [int(cell[0])]
    assert condensed.probability.tolist() == pytest.approx([2 / 3])
    assert condensed.support.tolist() == [3.0]
    assert condensed.base_rate.tolist() == pytest.approx([0.75, 0.0])


def test_base_rates_by_hand() -> None:
    """Failures and successes of two prototypes and two types: two of three, one of one; of none 0, one of four."""
    counts = [[[1, 0], [0, 1], [0, 2], [0, 0]], [[0, 0], [2, 1], [0, 0], [1, 0]]]
    rates = [base_rates(torch.tensor(each), 2).tolist() for each in counts]
    assert rates == [pytest.approx([2 / 3, 1]), [0, 0.25]]


def test_points_of_parts_of_a_space_are_those_of_the_whole(generator: torch.Generator, kernel: Kernel) -> None:
    """Prototype 0, then the two others; what is counted at points comes back in their order."""
    particles = random_particles(500, generator)
    whole = condense([particles], PROTOTYPES, GRID, kernel, 2.0)
    which = [particles.prototype < 1, particles.prototype >= 1]
    parts = [taken(particles, here.nonzero()[:, 0]) for here in which]
    spaces = [ShapeGraspSpace.of([part], PROTOTYPES, GRID) for part in parts]
    joined = Condensed.of([significant_points(space, GRID, kernel, 2.0) for space in spaces], whole.base_rate)
    assert all(torch.equal(getattr(joined, f.name), getattr(whole, f.name)) for f in fields(Condensed))
    assert len(whole.cell) > 10 and whole.partition_start[2] > 0
    together = analyse(ShapeGraspSpace.of([particles], PROTOTYPES, GRID), particles, GRID, kernel)
    counts = [analyse(space, part, GRID, kernel) for space, part in zip(spaces, parts, strict=True)]
    gathered = Counts.gathered(counts, which[1].long())
    assert all(torch.equal(getattr(gathered, f.name), getattr(together, f.name)) for f in fields(Counts))


def test_pairs_as_poses_list_what_was_listed(generator: torch.Generator) -> None:
    """All, those of some features, those of some grasps; and none has more than is said."""
    poses = se3.random_poses(40, generator)
    poses[:, :3, 3] = 0.08 * torch.rand(40, 3, generator=generator)
    kinds = torch.arange(30) % 2
    config = settings(AffordanceConfig, features_per_object=6)
    unlisted = pose_pairs(poses[:10], poses[10:], kinds, config, torch.Generator().manual_seed(0))
    pairs = cell_pairs(poses[:10], poses[10:], kinds, config, torch.Generator().manual_seed(0))
    wanted, chosen = torch.arange(10) % 3 == 0, torch.tensor([2, 3, 11, 29])
    assert 0 < len(pairs.cell) < 6 * 30 and not wanted[pairs.feature].all() and wanted[pairs.feature].any()
    for one, other in [
        (unlisted.listed(), pairs),
        (unlisted.listed(wanted), pairs.listed(wanted)),
        (unlisted.of_grasps(chosen).listed(), pairs.of_grasps(chosen)),
    ]:
        assert all(torch.equal(getattr(one, f.name), getattr(other, f.name)) for f in fields(CellPairs))
    assert (pairs.most(10) <= unlisted.most(10)).all() and unlisted.most(10).sum() == 6 * 30
    assert pairs.most(10).tolist() == [int((pairs.feature == i).sum()) for i in range(10)]


def test_particles_without_outcomes_teach_nothing() -> None:
    cell = torch.zeros(1, dtype=torch.int32)
    with pytest.raises(ValueError, match="outcomes of trials"):
        ShapeGraspSpace.of([Particles(cell, cell, 2)], 1, GRID)


def test_votes_equal_brute_force(generator: torch.Generator, kernel: Kernel) -> None:
    condensed = condense([random_particles(400, generator)], PROTOTYPES, GRID, kernel, 2.0)
    asked = random_particles(300, generator)
    found = VotingIndex(condensed, GRID).find(asked.partition.long(), asked.cell.long())
    keys = list(zip(condensed.partition_of_point().tolist(), condensed.cell.tolist(), strict=True))
    expected = [
        keys.index(key) if key in keys else NO_POINT
        for key in zip(asked.partition.tolist(), asked.cell.tolist(), strict=True)
    ]
    assert found.tolist() == expected
    assert NO_POINT in expected and max(expected) > 0


def split(particles: Particles, objects: int) -> list[Particles]:
    """The particles dealt out to objects in turn."""
    return [taken(particles, torch.arange(i, len(particles.cell), objects)) for i in range(objects)]


def test_analysis_at_points_equals_the_condensed_space(generator: torch.Generator, kernel: Kernel) -> None:
    """Votes are the same whether the space is condensed first or analysed where the votes fall."""
    particles, asked = random_particles(400, generator), random_particles(300, generator)
    grasp = torch.randint(50, (300,), generator=generator)
    condensed = condense([particles], PROTOTYPES, GRID, kernel, 2.0)
    expected = cast_votes(VotingIndex(condensed, GRID), asked, grasp)
    space = ShapeGraspSpace.of(split(particles, 3), PROTOTYPES, GRID)
    counts = analyse(space, asked, GRID, kernel)
    votes = counted_votes(counts, asked, grasp, 2.0)
    assert 20 < len(votes.grasp) < 300
    for name in ("grasp", "prototype", "probability", "support"):
        assert torch.equal(getattr(votes, name), getattr(expected, name))


def test_analysis_of_nothing() -> None:
    kernel = gaussian_kernel(GRID, 0.0, 0.0)
    none = torch.zeros(0, dtype=torch.int32)
    space = ShapeGraspSpace.of([Particles(none, none, 2, none.bool())], 1, GRID)
    one = torch.ones(1, dtype=torch.int32)
    counts = analyse(space, Particles(one, one, 2), GRID, kernel)
    assert [float(t) for t in (counts.successes, counts.particles, counts.own_count)] == [0, 0, 0]
    assert len(counted_votes(counts, Particles(one, one, 2), one.long(), 0.0).grasp) == 0


@pytest.mark.parametrize("kernel_mm", [0.0, 0.006, 0.01])
def test_analysis_equals_the_loop(kernel_mm: float, generator: torch.Generator) -> None:
    """At points many of which are asked for more than once, and some hold nothing."""
    kernel = gaussian_kernel(GRID, kernel_mm, 40.0)
    particles, asked = random_particles(250, generator), random_particles(200, generator)
    space = ShapeGraspSpace.of(split(particles, 2), PROTOTYPES, GRID)
    found = torch.stack(list(vars(analyse(space, asked, GRID, kernel)).values()), dim=1)
    expected = torch.zeros(200, 3)
    for q in range(200):
        teaching = particles.partition == asked.partition[q]
        expected[q, 2] = (teaching & (particles.cell == asked.cell[q])).sum()
        if expected[q, 2] > 0:
            for i in teaching.nonzero()[:, 0].tolist():
                weight = weight_between(kernel, int(asked.cell[q]), int(particles.cell[i]))
                expected[q, :2] += weight * torch.tensor([float(particles.success[i]), 1.0])
    assert torch.allclose(found, expected, rtol=1e-5, atol=0)
    assert (expected[:, 2] == 0).any() and (expected[:, 1] > 1.5).any()


def weight_between(kernel: Kernel, cell: int, other: int) -> float:
    """By the kernel's own lists."""
    turns, r = kernel.turn[cell // GRID.voxels].tolist(), other // GRID.voxels
    shift = other % GRID.voxels - cell % GRID.voxels
    if r not in turns or shift not in kernel.offset.tolist():
        return 0.0
    turned = kernel.turn_weight[cell // GRID.voxels, turns.index(r)]
    return float(kernel.weight[kernel.offset.tolist().index(shift)]) * float(turned)


def test_two_threads_find_the_same(generator: torch.Generator, kernel: Kernel) -> None:
    particles, asked = random_particles(3000, generator), random_particles(2000, generator)
    found = []
    for count in (1, 2):
        threads = torch.get_num_threads()
        torch.set_num_threads(count)
        space = ShapeGraspSpace.of(split(particles, 3), PROTOTYPES, GRID)
        counts = analyse(space, asked, GRID, kernel)
        condensed = condense(split(particles, 3), PROTOTYPES, GRID, kernel, 2.0)
        torch.set_num_threads(threads)
        found.append([*vars(counts).values(), *vars(condensed).values()])
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True)) and len(found[0]) == 8


def test_keys_of_64_bits(generator: torch.Generator, kernel: Kernel) -> None:
    """Finer grids need them; what is found is the same."""
    particles, asked = random_particles(300, generator), random_particles(200, generator)
    space = ShapeGraspSpace.of(split(particles, 3), PROTOTYPES, GRID)
    wide = replace(space, particles=space.particles._replace(key=space.particles.key.long()))
    assert space.particles.key.dtype == torch.int32
    found, same = (analyse(each, asked, GRID, kernel) for each in (space, wide))
    assert all(torch.equal(a, b) for a, b in zip(vars(found).values(), vars(same).values(), strict=True))


def test_counts_split_in_order() -> None:
    row = torch.arange(5.0)
    parts = Counts(row, row + 10, row + 20).split([2, 3])
    assert parts[1].particles.tolist() == [12, 13, 14] and parts[0].own_count.tolist() == [20, 21]


def test_an_empty_model_supports_nothing() -> None:
    empty = torch.zeros(0)
    condensed = Condensed(torch.zeros(7, dtype=torch.long), empty.long(), empty, empty, torch.zeros(2))
    one = torch.zeros(1, dtype=torch.int32)
    assert len(cast_votes(VotingIndex(condensed, GRID), Particles(one, one, 2), one.long()).grasp) == 0


def test_pairs_of_some_grasps(generator: torch.Generator) -> None:
    """Grasps 4 and 1 become 0 and 1; the pairs of the others go."""
    grasp, cell = torch.tensor([0, 1, 4, 1]).int(), torch.tensor([9, 8, 7, 6]).int()
    pairs = CellPairs(torch.arange(4).int(), grasp, cell, torch.tensor([0, 1, 0, 1, 1]))
    some = pairs.of_grasps(torch.tensor([4, 1]))
    assert some.grasp.tolist() == [1, 0, 1] and some.cell.tolist() == [8, 7, 6] and some.feature.tolist() == [1, 2, 3]
    assert some.grasp_type.tolist() == [1, 1]


def test_as_many_particles_as_are_asked_for_are_enough() -> None:
    """Three particles in one cell, two of them successes: with a least support of 3 the point stands, with 3.1 not.

    Counts are exact, so the bound itself can be met: condensed, and analysed where the votes fall.
    """
    kernel = gaussian_kernel(GRID, 0.0, 0.0)
    cell = GRID.index(torch.zeros(3, 3), torch.tensor([[1.0, 0, 0, 0]] * 3)).int()
    particles = Particles(torch.zeros(3, dtype=torch.int32), cell, 2, torch.tensor([True, False, True]))
    space, asked = ShapeGraspSpace.of([particles], 1, GRID), Particles(particles.partition[:1], cell[:1], 2)
    counts = analyse(space, asked, GRID, kernel)
    for least, support in ((3.0, [3.0]), (3.1, [])):
        assert condense([particles], 1, GRID, kernel, least).support.tolist() == support
        assert counted_votes(counts, asked, torch.tensor([0]), least).support.tolist() == support


def test_points_of_pairs_by_hand() -> None:
    """Features of prototypes 2 and 0; the first is paired with an NPG and a WPG, the second with the WPG.

    A partition is prototype * 2 + type: 2 NPG = 4, 2 WPG = 5, 0 WPG = 1. The particles have their grasps' outcomes.
    """
    feature, grasp, cell = torch.tensor([[0, 0, 1], [0, 1, 1], [7, 8, 9]], dtype=torch.int32)
    pairs = CellPairs(feature, grasp, cell, grasp_type=torch.tensor([0, 1]))
    particles = shape_grasp_particles(pairs, torch.tensor([2, 0]), 2, torch.tensor([True, False]))
    assert particles.partition.tolist() == [4, 5, 1] and particles.cell.tolist() == [7, 8, 9]
    assert particles.prototype.tolist() == [2, 2, 0] and particles.grasp_type.tolist() == [0, 1, 1]
    assert particles.success.tolist() == [True, False, False]


def test_rounding_makes_no_probability_above_one() -> None:
    """Three successes of three, that add up to a little more; a point near which the kernel weighs nothing; none."""
    counts = Counts(torch.tensor([3.0000002, 0.0, 0.0]), torch.tensor([3.0, 0.0, 5.0]), torch.tensor([3.0, 1.0, 0.0]))
    points = Particles(torch.tensor([2, 0, 1], dtype=torch.int32), torch.zeros(3, dtype=torch.int32), 2)
    votes = counted_votes(counts, points, torch.tensor([7, 8, 9]), min_support=0.0)
    assert votes.grasp.tolist() == [7, 8] and votes.prototype.tolist() == [1, 0]
    assert votes.probability.tolist() == [1.0, 0.0] and votes.support.tolist() == [3.0, 0.0]
