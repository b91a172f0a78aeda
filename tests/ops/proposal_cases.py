"""Arguments of the operators that the search for hypotheses, and a judge's numbers, are made of."""

import torch
from torch import Tensor

from spgf_torch.geometry import se3
from spgf_torch.ops.depth_behind import Image
from spgf_torch.ops.leaves import Nodes
from spgf_torch.ops.nearest_piece import Blocks
from spgf_torch.ops.push_loops import CELL, ROOM

Case = tuple[object, ...]


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def boxes(*halves: tuple[float, float, float]) -> Tensor:
    """(P, 6, 4) planes of boxes about the origin."""
    sides = torch.cat([torch.eye(3), -torch.eye(3)])
    return torch.stack([torch.cat([sides, torch.tensor([*half, *half])[:, None]], dim=1) for half in halves])


def nearest_piece() -> list[Case]:
    """Two boxes, one about the other's end; points within and about them, and none."""
    planes = boxes((0.02, 0.01, 0.03), (0.004, 0.04, 0.01))
    draws = generator()
    points, T = 0.06 * torch.randn(300, 3, generator=draws), se3.random_poses(100, draws, extent=0.1)
    at = T[:, :3, :3].mT @ (points.T - T[:, :3, 3:])
    faces = planes[..., :3].contiguous(), planes[..., 3:].contiguous()
    blocks, none = Blocks.of(points, 0.03), Blocks.of(points[:0], 0.03)
    cases: list[Case] = [(at, *faces, most, blocks) for most in (0.05, 0.005, -0.005)]
    return [*cases, (at[:, :, :0], *faces, 0.005, none), (at[:0], *faces, 0.005, blocks)]


def extents() -> list[Case]:
    at = 0.02 * torch.randn(40, 3, 30, generator=generator())
    planes = torch.tensor([0.004, 0.03, 0.02]), torch.linspace(-0.03, 0.02, 7), torch.linspace(-0.02, 0.03, 7)
    return [(at, *planes), (at[:, :, :0], *planes), (at[:0], *planes)]


def pad_numbers() -> list[Case]:
    """Of some hands many points lie between the pads, of some one, of some none; of one there are none at all."""
    draws = generator()
    at = torch.linspace(0.002, 0.15, 200)[:, None, None] * torch.randn(200, 3, 50, generator=draws)
    cosine = 2 * torch.rand(200, 50, generator=draws) - 1
    limits = torch.tensor([0.025, 0.01, -0.01, 0.02, 0.003, 0.05, 0.004, 0.9, 0.5])
    return [(at, cosine, limits), (at[:3, :, :0], cosine[:3, :0], limits), (at[:0], cosine[:0], limits)]


def facing_gap() -> list[Case]:
    draws = generator()
    x, facing = 0.01 * torch.randn(30, 25, generator=draws), 2 * torch.rand(30, 25, generator=draws) - 1
    between = torch.rand(30, 25, generator=draws) < 0.3
    return [(x, facing, between), (x[:, :0], facing[:, :0], between[:, :0]), (x[:0], facing[:0], between[:0])]


def leaves() -> list[Case]:
    """A tree of three leaves, a leaf alone, and a tree of two; numbers on a threshold, and none that is a number."""
    nodes = Nodes(
        torch.tensor([0, 5, 6]).int(),
        torch.tensor([1, -1, 0, -1, -1, -1, 2, -1, -1]).short(),
        torch.tensor([0.5, 0, 0.25, 0, 0, 0, 0.75, 0, 0]).double(),
        torch.tensor([1, 1, 3, 3, 4, 5, 7, 7, 8]).int(),
        torch.tensor([2, 1, 4, 3, 4, 5, 8, 7, 8]).int(),
        torch.arange(9).double(),
    )
    x = torch.rand(40, 3, generator=generator()).double()
    x[:3] = torch.tensor([[0.25, 0.6, 0.75], [0.3, 0.5, 0.8], [torch.nan, torch.nan, torch.nan]])
    return [(x, nodes), (x[:0], nodes)]


def depth_behind() -> list[Case]:
    """Poses before, behind and beside an image with holes; what is known already is little, or all."""
    draws = generator()
    depth = 0.4 + 0.2 * torch.rand(16, 20, generator=draws)
    depth[depth < 0.45] = torch.inf
    rotation = se3.random_poses(1, draws, extent=0.0)[0, :3, :3]
    K = torch.tensor([[100.0, 0, 9.5], [0, 100, 7.5], [0, 0, 1]])
    image = Image(depth, torch.tensor([0.01, 0.02, 0.03]), torch.cat([rotation.T, K @ rotation.T]).double())
    T = se3.random_poses(60, draws, extent=0.05)
    T[:, :3, 3] += image.eye + 0.5 * rotation[:, 2]
    T[0, :3, 3] -= rotation[:, 2]
    points = 0.03 * torch.randn(25, 3, generator=draws)
    nothing, some = torch.full((60, 25), torch.inf), 0.1 * torch.randn(60, 25, generator=draws)
    given = [(0.0, nothing), (0.02, some), (torch.inf, some), (torch.inf, nothing)]
    cases: list[Case] = [(T, points, image, enough, least) for enough, least in given]
    return [*cases, (T[:0], points, image, 0.0, nothing[:0]), (T, points[:0], image, 0.0, nothing[:, :0])]


def deepest_free() -> list[Case]:
    """Two boxes across each other pushed through points: of all three kinds, of one, and of none."""
    draws = generator()
    half = (0.011, 0.007, 0.013)
    bounds = torch.tensor([[-part for part in half], half]).double()
    shape = ((bounds[1] - bounds[0] + 2 * ROOM) / CELL).ceil().long() + 2
    cells = torch.zeros(shape.tolist(), dtype=torch.int32)
    cells[1:-1, 1:-1, 1:-1] = 3
    planes = boxes((0.004, 0.007, 0.013), (half[0], 0.002, 0.003)).flatten(0, 1).double()
    volume = (bounds, planes, torch.tensor([6, 12]), cells)
    T = se3.random_poses(30, draws, extent=0.02)
    along = torch.linspace(0.03, -0.06, 12)[:, None, None] * T[:, None, None, :3, 2]
    where = (T[:, None, None, :3, 3] + along).expand(30, 12, 2, 3) + 0.01 * torch.randn(1, 1, 2, 3, generator=draws)
    possible = torch.rand(30, 12, 2, generator=draws) < 0.9
    points = [0.03 * torch.randn(count, 3, generator=draws) for count in (20, 5, 3)]
    least = [points[0][:0], points[1], points[2][:0]]
    asked = [
        (T, where, possible, 2, points),
        (T, where, possible, 0, points),
        (T, where, possible, 1, least),
        (T[:0], where[:0], possible[:0], 2, points),
    ]
    return [(*each, [*volume] * 3) for each in asked]


CASES = (nearest_piece, extents, pad_numbers, facing_gap, leaves, depth_behind, deepest_free)
