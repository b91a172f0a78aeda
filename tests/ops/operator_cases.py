"""Arguments that every operator is tried with: small, of a seed, and reaching every branch."""

import proposal_cases
import torch
from torch import Tensor

from spgf_torch.geometry import se3
from spgf_torch.geometry.se3_grid import SE3Grid, gaussian_kernel
from spgf_torch.ops.accumulate_votes import Candidates, Voters
from spgf_torch.ops.kmeans_start import Weighted
from spgf_torch.ops.look_up_points import Table
from spgf_torch.ops.neighbourhood_analysis import Queries, Space, Weights
from spgf_torch.ops.neighbourhood_analysis import populate as populate_operator
from spgf_torch.ops.ring_grid import Ring

Case = tuple[object, ...]


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def points_in_volume() -> list[Case]:
    """Points about two boxes, one of them open to a side; then none."""
    draws = generator()
    T = se3.random_poses(300, draws, extent=0.05)
    box = torch.cat([torch.eye(3), -torch.eye(3)])
    near = torch.cat([box, torch.tensor([0.05, 0.01, 0.02, -0.03, 0.01, 0.02])[:, None]], dim=1)
    far = torch.cat([box[:5], torch.tensor([-0.03, 0.01, 0.02, 0.05, 0.01])[:, None]], dim=1)
    bounds = torch.tensor([[-0.05, -0.01, -0.02], [0.05, 0.01, 0.02]])
    points = (torch.rand(40, 3, generator=draws) - 0.5) * 0.2
    volume = (torch.cat([near, far]), [6, 11], bounds)
    return [(points, T, *volume), (points[:0], T, *volume), (points, T[:0], *volume)]


GRID = SE3Grid(reach=0.05, voxel=0.012, rotation_deg=45.0)
PARTITIONS = 6


def poses(n: int, draws: torch.Generator) -> Tensor:
    return se3.random_poses(n, draws, extent=0.03)


def table(draws: torch.Generator) -> Table:
    """A third of all cells of each partition, but for one partition without any."""
    learned = torch.rand(PARTITIONS * GRID.cells, generator=draws) < 0.3
    learned[3 * GRID.cells : 4 * GRID.cells] = False
    before = torch.cat([torch.zeros(1), learned.view(-1, GRID.row_size).sum(1).cumsum(0)]).int()
    return Table(before, (learned.nonzero()[:, 0] % GRID.cells).int())


def nowhere() -> Table:
    """Of a space that learned nothing."""
    return Table(torch.zeros(PARTITIONS * GRID.rows + 1).int(), torch.zeros(0).int())


def cell_pairs() -> list[Case]:
    """More features than one part of the work has, exact poses in float64, and nothing."""
    draws = generator()
    features, grasps = poses(100, draws), poses(50, draws)
    cases = [(features, grasps), (features.double(), grasps.double()), (features[:0], grasps), (features, grasps[:0])]
    return [(*case, GRID.numbers) for case in cases]


def look_up() -> list[Case]:
    draws = generator()
    partition = torch.randint(PARTITIONS, (5000,), generator=draws).int()
    cell = torch.randint(GRID.cells, (5000,), generator=draws).int()
    cases = [(table(draws), partition, cell), (nowhere(), partition, cell), (table(draws), partition[:0], cell[:0])]
    return [(found, GRID.rows, GRID.row_size, *asked) for found, *asked in cases]


def accumulate_votes() -> list[Case]:
    """More grasps than one part of the work has; a space that learned nothing; nobody to vote, and nothing to."""
    draws = generator()
    voters = Voters(poses(40, draws), 2 * torch.randint(PARTITIONS // 2, (40,), generator=draws))
    candidates = Candidates(poses(700, draws), torch.arange(700) % 2)
    learned = table(draws)
    gain = torch.randn(len(learned.cell), generator=draws)
    nobody, nothing = Voters(*(c[:0] for c in voters)), Candidates(*(c[:0] for c in candidates))
    cases = [(voters, candidates, learned, gain), (voters, candidates, nowhere(), gain[:0])]
    cases += [(nobody, candidates, learned, gain), (voters, nothing, learned, gain)]
    return [(*case, GRID.numbers) for case in cases]


def blobs(draws: torch.Generator) -> Tensor:
    """600 points about six places."""
    return 3 * torch.randn(6, 9, generator=draws).repeat(100, 1) + torch.randn(600, 9, generator=draws)


def centres(draws: torch.Generator) -> list[Tensor]:
    """Centres among the points, and some that are so far from them that they stay empty."""
    points = blobs(draws)
    return [points[:8], torch.cat([points[:5], torch.full((2, 9), 90.0)])]


def assign() -> list[Case]:
    draws = generator()
    points = blobs(draws)
    return [(points, c) for c in centres(draws)] + [(points[:0], points[:3])]


def lloyd_step() -> list[Case]:
    """Rows that lie together, rows that do not, and in float64."""
    draws = generator()
    points, (few, far) = blobs(draws), centres(draws)
    return [(points, few), (points[::3], far), (points.double(), few.double())]


def member_sums() -> list[Case]:
    draws = generator()
    points, ids = blobs(draws), torch.randint(7, (600,), generator=draws)
    return [(points, ids, 9), (points[::2], ids[::2], 9)]


def lloyd() -> list[Case]:
    draws = generator()
    return [(blobs(draws), c, steps, 1e-6) for c in centres(draws) for steps in (1, 20)]


def partition() -> list[Case]:
    points = blobs(generator())
    return [(points, 40), (points[:3], 40), (torch.full((5, 2), 0.1), 3)]


def plusplus() -> list[Case]:
    draws = generator()
    points, weights = blobs(draws), torch.randint(1, 5, (600,), generator=draws).float()
    return [(points, weights, torch.rand(3, 7, 2, generator=draws, dtype=torch.float64))]


def settle() -> list[Case]:
    draws = generator()
    points, weights = blobs(draws), torch.randint(1, 5, (600,), generator=draws).float()
    return [(Weighted.of(points, weights), c, steps, 1e-4) for c in centres(draws) for steps in (0, 1, 30)]


def radius_pairs() -> list[Case]:
    """More than one cube, twins, places so far apart that cubes cannot be counted through, and no points."""
    draws = generator()
    points = torch.rand((60, 3), generator=draws)
    twins = torch.cat([points, points[:3]])
    return [(twins, 0.3), (torch.cat([points, points + 1e12]).double(), 0.3), (points[:0], 0.3), (points[:1], 0.3)]


def describe() -> list[Case]:
    """Both sides of a wall with an edge, dense and sparse, in both types; every alignment; lone texlets, and none."""
    draws = generator()
    X = (torch.rand(400, 3, generator=draws) - 0.5) * torch.tensor([0.08, 0.06, 0.002])
    n = torch.nn.functional.normalize(0.1 * torch.randn(400, 3, generator=draws) + X.sign() * torch.tensor([0, 0, 1.0]))
    start = torch.randint(12, (400,), generator=draws)
    ring, one, aside = Ring(36, 6, 2), Ring(12, 0, 1), X + torch.tensor([0.517, 0.031, 0.42])
    cases: list[Case] = [(X, n, None, 0.02, ring, "saturated", soft) for soft in (False, True)]
    cases += [(X, n, start, 0.02, one, "flat", False), (X.double(), n.double(), None, 0.01, ring, "saturated", False)]
    cases.append((aside, n, None, 0.02, ring, "saturated", False))
    return [*cases, (X[:30], n[:30], None, 0.001, ring, "flat", False), (X[:0], n[:0], None, 0.02, ring, "flat", True)]


COARSE = SE3Grid(reach=0.03, voxel=0.01, rotation_deg=60.0)


def particles(n: int, draws: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Slice, cell and success, crowded into a few cells."""
    direction = torch.nn.functional.normalize(torch.randn(n, 3, generator=draws), dim=1)
    turn = torch.nn.functional.normalize(torch.tensor([1.0, 0, 0, 0]) + 0.3 * torch.randn(n, 4, generator=draws), dim=1)
    partition = torch.randint(PARTITIONS, (n,), generator=draws)
    partition[partition == 2] = 3  # a partition without any
    return partition.int(), COARSE.index(direction * 0.012, turn).int(), torch.rand(n, generator=draws) < 0.3


def dealt(draws: torch.Generator) -> list[list[Tensor]]:
    """The particles of four objects, the third of which has none."""
    objects = [particles(n, draws) for n in (200, 150, 0, 250)]
    return [list(column) for column in zip(*objects, strict=True)]


def populate() -> list[Case]:
    """Four objects; finer lattices need keys of 64 bits."""
    columns = dealt(generator())
    return [(*columns, PARTITIONS, grid.numbers) for grid in (COARSE, SE3Grid(0.2, 0.005, 20.0))]


def space() -> Space:
    return Space(*populate_operator.in_torch(*dealt(generator()), PARTITIONS, COARSE.numbers))


def weights(sigma: float = 0.008, sigma_deg: float = 40.0) -> Weights:
    return Weights.of(gaussian_kernel(COARSE, sigma, sigma_deg), torch.device("cpu"))


def analyse() -> list[Case]:
    """With a kernel, and of cells alone; and nothing."""
    draws = generator()
    partition, cell, _ = particles(500, draws)
    partition[:20] = 2
    asked = Queries(partition, cell)
    nothing = Queries(*(column[:0] for column in asked))
    cases = [(asked, weights()), (asked, weights(0, 0)), (nothing, weights())]
    return [(space(), *case, COARSE.numbers) for case in cases]


def outcome_counts() -> list[Case]:
    partition, _, success = particles(500, generator())
    return [(partition, success, PARTITIONS + 1), (partition[:0], success[:0], 2)]


def condense() -> list[Case]:
    return [
        (space(), weights(*sigma), COARSE.numbers, least) for sigma in ((0.008, 40.0), (0.0, 0.0)) for least in (0, 2.5)
    ]


def farthest_first() -> list[Case]:
    points = blobs(generator()).double()
    return [(points, points.square().sum(1), 50), (points[:3], points[:3, 0], 3), (points[:0], points[:0, 0], 0)]


CASES = {
    f.__name__: f
    for f in (
        points_in_volume,
        cell_pairs,
        look_up,
        accumulate_votes,
        assign,
        lloyd_step,
        member_sums,
        lloyd,
        partition,
        plusplus,
        settle,
        radius_pairs,
        describe,
        populate,
        analyse,
        outcome_counts,
        condense,
        farthest_first,
        *proposal_cases.CASES,
    )
}
