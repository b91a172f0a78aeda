"""Hypotheses from geometry: what the hand's shapes give, the search by a slow loop, and what must hold of any."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from omegaconf import OmegaConf
from proposing_models import VOLUMES, two_fingers

from spgf_torch.affordance.sensed_collision import hand_volume
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.geometry import se3
from spgf_torch.hands.config import HandConfig
from spgf_torch.paths import find
from spgf_torch.predictor import block
from spgf_torch.proposing.clearance import Clearance, Plane, Surroundings
from spgf_torch.proposing.closing_region import closing_region
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.hand_geometry import HandGeometry
from spgf_torch.proposing.hypotheses import Search, frames, local, places, profile
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings, typed

CONFIG = settings(HypothesesConfig, seeds=8, hypotheses=100_000)
SEARCH = Search.of(Clearance(VOLUMES, 0.005, 0.01, 0.004), CONFIG)
BLOCK = block(0.005, 0.03)
NOWHERE = Surroundings()


@pytest.mark.parametrize(
    ("name", "half", "height", "length"),
    [("panda", (20, 40), 8.75, 17.6), ("sdh2", (22.5, 47.5), 12, 55)],  # mm: openings, pads of the URDF
)
def test_the_hands_that_we_ship(name: str, half: tuple[float, float], height: float, length: float) -> None:
    hand = typed(HandConfig, OmegaConf.to_container(OmegaConf.load(find(f"conf/hand/{name}.yaml"))))
    for volume, expected in zip(open_hand(hand).values(), half, strict=True):
        region = closing_region(volume)
        got = [1000 * value for value in (region.half, region.height, region.length)]
        assert got == pytest.approx([expected, height, length], abs=1e-3)
        geometry = HandGeometry.of(volume, CONFIG)
        for points in (geometry.fingers, geometry.palm):
            inside = [(points @ p[:, :3].T <= p[:, 3] + 1e-6).all(1) for p in volume.planes]
            assert len(points) > 50 and torch.stack(inside).any(0).all()
        assert geometry.fingers[:, 2].min() > -0.05 >= geometry.palm[:, 2].max()
        assert region.holds(*geometry.sweep[geometry.sweep[:, 0].abs() < region.half - 1e-6].T).all()


def test_a_hand_by_hand() -> None:
    """Fingers 20 mm wide from z = -40 to 10 mm, 50 mm apart."""
    region = closing_region(two_fingers(0.05))
    assert [region.half, region.height, region.low, region.high] == pytest.approx([0.025, 0.01, -0.04, 0.01], abs=1e-6)


def test_frames_are_those_of_the_surface() -> None:
    """On a block every closing axis is normal to a face or along one, each frame right-handed and at a texlet."""
    T = frames(BLOCK.positions, BLOCK.normals, settings(HypothesesConfig, seeds=8, normal_radius=0.006))
    assert len(T) % 22 == 0 and len(T) >= 4 * 22
    torch.testing.assert_close(T[:, :3, :3].mT @ T[:, :3, :3], torch.eye(3).expand(len(T), 3, 3), atol=1e-5, rtol=0)
    assert (torch.linalg.det(T[:, :3, :3]) > 0.99).all()
    assert torch.cdist(T[:, :3, 3], BLOCK.positions).amin(1).max() < 1e-4


def test_no_frames_without_normals_that_agree() -> None:
    thin = Texlets(torch.zeros(2, 3), torch.tensor([[0.0, 0, 1], [0, 0, -1]]))
    assert len(frames(thin.positions, thin.normals, CONFIG)) == 0
    assert len(SEARCH.hypotheses(thin, NOWHERE)) == 0
    nothing = Texlets(torch.zeros(0, 3), torch.zeros(0, 3))
    assert len(SEARCH.hypotheses(nothing, NOWHERE)) == 0


@pytest.mark.parametrize("middle", [0.0, 0.006])
def test_the_profile_equals_a_slow_loop(middle: float) -> None:
    generator = torch.Generator().manual_seed(0)
    T, points = se3.random_poses(20, generator, extent=0.02), 0.04 * torch.randn(60, 3, generator=generator)
    depths, region = torch.tensor([0.02, 0.0, -0.01]), replace(SEARCH.hands[1].region, middle=middle)
    low, high, count = profile(local(T, points), depths, region)
    for f, pose in enumerate(T):
        at = (points - pose[:3, 3]) @ pose[:3, :3]
        for d, depth in enumerate(depths.tolist()):
            x = [
                float(p[0])
                for p in at
                if abs(p[1]) < region.height
                and abs(p[0] - middle) < 1.5 * region.half
                and region.low < p[2] - depth < region.high
            ]
            assert count[f, d] == len(x)
            if x:
                assert (low[f, d], high[f, d]) == pytest.approx((min(x), max(x)), abs=1e-6)
    assert (count < 2).any() and (count > 3).any()


def test_the_three_places_by_hand() -> None:
    """A thing from -5 to 15 mm between pads 50 mm apart: in the middle, its face 6 mm from the pad at +x, and at -x."""
    hand = SEARCH.hands[1]
    one = torch.ones(1, 1)
    shift, fits = places(-0.005 * one, 0.015 * one, (5 * one).long(), hand, CONFIG)
    assert shift.flatten().tolist() == pytest.approx([0.005, 0.015 - 0.019, -0.005 + 0.019]) and fits.all()
    assert places(-0.02 * one, 0.02 * one, (5 * one).long(), hand, CONFIG)[1].flatten().tolist() == [True, False, False]
    assert not places(-0.03 * one, 0.03 * one, (5 * one).long(), hand, CONFIG)[1].any()
    assert not places(-0.01 * one, 0.01 * one, (2 * one).long(), hand, CONFIG)[1].any()
    nothing = torch.inf * one
    assert not places(nothing, -nothing, (0 * one).long(), hand, CONFIG)[1].any()


def test_the_places_of_a_jaw_that_is_open_to_one_side() -> None:
    """A fixed face 12 mm at -x and the jaw 30 mm at +x: a thing from -5 to 15 mm goes to 9, or 6 from a face."""
    region = replace(SEARCH.hands[1].region, half=0.021, middle=0.009)
    one, hand = torch.ones(1, 1), replace(SEARCH.hands[1], region=region)
    shift, fits = places(-0.005 * one, 0.015 * one, (5 * one).long(), hand, CONFIG)
    assert shift.flatten().tolist() == pytest.approx([-0.004, -0.009, 0.001]) and fits.all()


def test_three_fingers_are_tried_in_the_middle_alone() -> None:
    """A thumb at -x against two fingers beside the axis, 40 mm from face to face, about a block of 30 mm."""
    sides = [((-0.03, -0.02), (-0.008, 0.008)), ((0.02, 0.03), (0.02, 0.034)), ((0.02, 0.03), (-0.034, -0.02))]
    boxes = [trimesh.creation.box(bounds=[(x[0], y[0], -0.04), (x[1], y[1], 0.01)]) for x, y in sides]
    hand = hand_volume(boxes, ["thumb", "first", "second"], ({"thumb"}, {"first", "second"}), 1)
    search = Search.of(Clearance({"cylinder": hand}, 0.005, 0.01, 0.004), CONFIG)
    one = torch.ones(1, 1)
    assert places(-0.005 * one, 0.015 * one, one.long() * 5, search.hands[0], CONFIG)[0].flatten().tolist() == (
        pytest.approx([0.005])
    )
    found = search.hypotheses(BLOCK, Surroundings(table=Plane.of((0.0, 0.0, 1.0), -0.015)))
    assert len(found) > 10 and (found.grasp_type == 0).all()
    assert search.closes(found.T, found.grasp_type, BLOCK.positions).all()
    assert search.free(found.T, found.grasp_type, BLOCK.positions, NOWHERE).all()


@pytest.mark.parametrize("table", [False, True])
def test_hypotheses_are_free_and_close_on_something(table: bool) -> None:
    around = Surroundings(table=Plane.of((0.0, 0.0, 1.0), -0.015)) if table else NOWHERE
    found = SEARCH.hypotheses(BLOCK, around)
    assert len(found) > 50 and found.grasp_type.bincount()[1] > 50
    assert SEARCH.closes(found.T, found.grasp_type, BLOCK.positions).all()
    assert SEARCH.clearance.free_of_points(BLOCK.positions, found.T, found.grasp_type).all()
    if around.table is not None:
        assert SEARCH.clearance.free_of_plane(around.table, found.T, found.grasp_type).all()
        assert len(found) < len(SEARCH.hypotheses(BLOCK, NOWHERE))


def test_obstacles_and_hands_from_below_are_left_out() -> None:
    everything = SEARCH.hypotheses(BLOCK, NOWHERE)
    up = torch.tensor([0.0, 0, 1])
    steep = SEARCH.hypotheses(BLOCK, Surroundings(up=(up, 0.1)))
    assert 0 < len(steep) < len(everything) and (steep.T[:, 2, 2] <= 0.1).all()
    wall = torch.cartesian_prod(torch.tensor([0.03]), torch.linspace(-0.1, 0.1, 40), torch.linspace(-0.1, 0.1, 40))
    beside = SEARCH.hypotheses(BLOCK, Surroundings(obstacles=wall))
    assert 0 < len(beside) < len(everything)
    assert SEARCH.clearance.free_of_obstacles(wall, beside.T, beside.grasp_type).all()
    from_below = SEARCH.hypotheses(BLOCK, Surroundings(up=(up, -1.1)))  # none is possible: better those than none
    assert len(from_below) == len(everything)


def test_fewer_are_picked_the_same_way_each_time() -> None:
    few = replace(SEARCH, config=settings(HypothesesConfig, seeds=8, hypotheses=40))
    first, again = few.hypotheses(BLOCK, NOWHERE), few.hypotheses(BLOCK, NOWHERE)
    assert len(first) == 40 and torch.equal(first.T, again.T)


def test_hypotheses_move_with_their_input() -> None:
    """A cup-like arc, whose frames are unambiguous: moved input gives moved hypotheses, as a set."""
    generator = torch.Generator().manual_seed(3)
    angle = torch.linspace(0, 4.0, 30)
    ring = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], dim=1)
    heights = torch.linspace(0, 0.02, 5)
    positions = torch.cat([0.012 * ring + torch.tensor([0.0, 0, float(h)]) for h in heights])
    positions = positions + 2e-4 * torch.rand(positions.shape, generator=generator)
    normals = torch.nn.functional.normalize(ring.repeat(5, 1) + 0.05 * torch.rand(150, 3, generator=generator), dim=1)
    T = se3.random_poses(1, generator, extent=0.1)[0]
    moved = Texlets(positions @ T[:3, :3].T + T[:3, 3], normals @ T[:3, :3].T)
    here, there = SEARCH.hypotheses(Texlets(positions, normals), NOWHERE), SEARCH.hypotheses(moved, NOWHERE)
    expected = T @ here.T
    apart = torch.cdist(expected.flatten(1), there.T.flatten(1)).amin(1)
    assert len(here) > 50 and abs(len(here) - len(there)) < 0.05 * len(here)
    assert (apart < 1e-3).float().mean() > 0.95  # rounding decides which depth is free of a point at its edge


def test_local_is_the_inverse_pose() -> None:
    T = se3.random_poses(3, torch.Generator().manual_seed(1), extent=0.1)
    points = torch.rand(5, 3)
    expected = torch.stack([(points - pose[:3, 3]) @ pose[:3, :3] for pose in T])
    np.testing.assert_allclose(local(T, points).mT, expected, atol=1e-6)
    assert math.isclose(float(T[0, 3, 3]), 1.0)
