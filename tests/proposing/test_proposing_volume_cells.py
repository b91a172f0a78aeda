"""The search for free places: equal to looking at every pose by itself; no point of a hand lies in an empty cell."""

import pytest
import torch
from proposing_models import VOLUMES

from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.geometry import se3
from spgf_torch.ops.push_loops import CELL, ROOM
from spgf_torch.predictor import block
from spgf_torch.proposing import volume_cells
from spgf_torch.proposing.clearance import Clearance, Plane, Surroundings
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.hypotheses import Search, frames, local, moved, places, profile
from spgf_torch.proposing.volume_cells import with_cells
from spgf_torch.settings import settings

CONFIG = settings(HypothesesConfig, seeds=4, hypotheses=100_000)
SEARCH = Search.of(Clearance(VOLUMES, 0.005, 0.01, 0.004), CONFIG)
SWEPT = Search.of(Clearance(VOLUMES, 0.005, 0.01, 0.004, way=0.05, unseen_on_way=True), CONFIG)
BLOCK = block(0.005, 0.03)
WALL = torch.cartesian_prod(torch.tensor([0.03]), torch.linspace(-0.1, 0.1, 30), torch.linspace(-0.1, 0.1, 30))
X = (0.0, 0.03, 0.06, 0.09)  # m
TABLE = Plane.of((0.0, 0.0, 1.0), -0.015)


def slow(search: Search, code: int, T: torch.Tensor, around: Surroundings) -> list[torch.Tensor]:
    """Frame by frame and place by place: the deepest free pose of those possible, and the one `back` behind it."""
    hand, found = search.hands[code], {}
    depths = torch.arange(CONFIG.deepest, CONFIG.shallowest - 1e-6, -CONFIG.depth_step)
    shift, possible = places(*profile(local(T, BLOCK.positions), depths, hand.region), hand, CONFIG)
    frame, k, place = possible.nonzero(as_tuple=True)
    poses = moved(T[frame], depths[k], shift[frame, k, place])
    free = search.free(poses, torch.full((len(poses),), code), BLOCK.positions, around)
    where = {key: i for i, key in enumerate(zip(frame.tolist(), place.tolist(), k.tolist(), strict=True)) if free[i]}
    for f in range(len(T)):
        for p in range(possible.shape[2]):
            free_at = [depth for depth in range(len(depths)) if (f, p, depth) in where]
            for depth in {*free_at[:1], *(d + CONFIG.back for d in free_at[:1])}.intersection(free_at):
                found[f, depth, p] = poses[where[f, p, depth]]
    return [found[key] for key in sorted(found)]


@pytest.mark.parametrize(
    ("search", "around"),
    [
        (SEARCH, Surroundings()),
        (SEARCH, Surroundings(table=TABLE, retreat=0.05)),
        (SEARCH, Surroundings(obstacles=WALL)),
        (SEARCH, Surroundings(obstacles=WALL, table=TABLE, up=(torch.tensor([0.0, 0, 1]), 0.3))),
        (SWEPT, Surroundings(obstacles=WALL)),
        (SWEPT, Surroundings(hidden=WALL)),
    ],
    ids=["nothing", "table", "wall", "all", "way", "hidden"],
)
def test_equals_looking_at_every_pose(search: Search, around: Surroundings) -> None:
    T = frames(BLOCK.positions, BLOCK.normals, CONFIG)
    found = search.hypotheses(BLOCK, around)
    assert len(found) > 20
    for code in range(len(VOLUMES)):
        expected = slow(search, code, T, around)
        assert len(expected) > 5
        torch.testing.assert_close(found.T[found.grasp_type == code], torch.stack(expected), rtol=0, atol=0)


def test_no_point_of_a_hand_is_in_an_empty_cell() -> None:
    """Points of turned pieces, off by as much as they may be."""
    generator = torch.Generator().manual_seed(0)
    turn = se3.random_poses(1, generator, extent=0.0)[0, :3, :3]
    volume = VOLUMES["WPG"]
    turned = tuple(torch.cat([piece[:, :3] @ turn.T, piece[:, 3:]], dim=1) for piece in volume.planes)
    reach = torch.maximum(volume.low.abs(), volume.high.abs()).norm()
    bounds, planes, end, cells = with_cells(type(volume)(turned, -reach.expand(3), reach.expand(3)))
    points = (2 * torch.rand(200_000, 3, generator=generator) - 1) * reach
    within = torch.stack([(points @ piece[:, :3].T <= piece[:, 3]).all(1) for piece in turned]).any(0)
    assert end.tolist() == torch.tensor([len(piece) for piece in turned]).cumsum(0).tolist()
    assert end[-1] == len(planes)
    assert within.sum() > 100
    for off in (-ROOM, ROOM):
        at = ((points[within] + off - bounds[0] + ROOM) / CELL + 1).long()
        bits = cells[at.unbind(1)]
        for number, piece in enumerate(turned):
            inside = (points[within] @ piece[:, :3].T <= piece[:, 3]).all(1)
            assert ((bits[inside] >> number) & 1).all()
    assert (cells != 0).float().mean() < 0.5


def test_a_height_above_a_table_is_that_of_the_whole_hand() -> None:
    generator = torch.Generator().manual_seed(1)
    T = se3.random_poses(200, generator, extent=0.1)
    for code, kind in enumerate(VOLUMES):
        least = SEARCH.clearance.least_height(TABLE, T, kind, retreat=0.05)
        expected = SEARCH.clearance.free_of_plane(TABLE, T, torch.full((len(T),), code), retreat=0.05)
        assert 0 < expected.sum() < len(T)
        assert torch.equal(T[:, :3, 3] @ TABLE.normal >= least, expected)


def test_more_pieces_than_bits_share_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of many small boxes in a row lie beyond the last bit: their cells hold it."""
    monkeypatch.setattr(volume_cells, "PIECES", 2)
    sides = torch.cat([torch.eye(3), -torch.eye(3)])
    row = [torch.cat([sides, torch.tensor([x + 0.004, 0.004, 0.004, 0.004 - x, 0.004, 0.004])[:, None]], 1) for x in X]
    low, high = torch.tensor([-0.004, -0.004, -0.004]), torch.tensor([X[-1] + 0.004, 0.004, 0.004])
    cells = with_cells(HandVolume(tuple(row), low, high)).cells
    at = [int((x - float(low[0]) + ROOM) / CELL) + 1 for x in X]
    middle = (cells.shape[1] - 1) // 2
    assert [int(cells[i, middle, middle]) for i in at] == [1, 2, 4, 4]
