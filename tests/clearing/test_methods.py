"""Who plans: on real images of three blocks, with the Panda."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from clearing_cases import PLACED, config

from spgf_torch.clearing.contact_graspnet import Found
from spgf_torch.clearing.methods import Antipodal, Network, Ours, Random, Unlearned, random_hands
from spgf_torch.clearing.rounds import Bench
from spgf_torch.hands.hand import load_hand

NOWHERE = np.zeros((0, 3))


@pytest.fixture(scope="module")
def settings():
    return config(hand="panda", views=4, **{"sensing.width": 320, "sensing.height": 240, "sensing.focal": 288})


@pytest.fixture(scope="module")
def tools(settings):
    return Unlearned.of(load_hand(settings.hand), settings)


@pytest.fixture(scope="module")
def sensed(settings):
    return Bench(settings, None, None).sense(PLACED, (0, 0))


def holds_something(chosen):
    """Whether some of a block's surface lies between the pads of the Panda: 80 mm apart, 2 cm across."""
    back = np.linalg.inv(chosen.T_world_tcp)
    found = False
    for each in PLACED:
        T = back @ each.T_world_object
        at = each.obj.mesh.sample(2000, seed=0) @ T[:3, :3].T + T[:3, 3]
        found |= bool((np.abs(at) < [0.04, 0.015, 0.02]).all(axis=1).any())
    return found


@pytest.mark.parametrize("method", [Random, Antipodal])
def test_a_grasp_is_on_something_and_away_from_where_others_failed(method, tools, sensed):
    first = method(tools).choose(sensed, NOWHERE)
    again = method(tools).choose(sensed, NOWHERE)
    np.testing.assert_array_equal(first.T_world_tcp, again.T_world_tcp)
    assert holds_something(first) and math.isnan(first.probability) and first.T_world_tcp[2, 2] < 0.1
    second = method(tools).choose(sensed, first.T_world_tcp[None, :3, 3])
    assert holds_something(second)
    assert np.linalg.norm(second.T_world_tcp[:3, 3] - first.T_world_tcp[:3, 3]) >= tools.config.neighbours.avoid_radius


@pytest.mark.parametrize(("least", "chosen"), [(0.0, 0.4), (0.4, 0.4), (0.5, 0.6), (0.7, None)])
def test_ours_tries_no_grasp_that_is_less_likely_to_hold(least, chosen):
    """Two grasps in the order of their scores, which is not that of their probabilities."""
    grasps = [SimpleNamespace(type="WPG", T_input_tcp=np.eye(4), probability=p) for p in (0.4, 0.6)]
    predictor = SimpleNamespace(predict=lambda scene, top, avoid: grasps)
    found = Ours(predictor, least).choose(SimpleNamespace(scene=None), NOWHERE)
    assert (found and found.probability) == chosen


def test_random_hands_close_along_normals_and_come_from_above(sensed):
    hands = random_hands(sensed.scene, [0.0, 0.04], np.random.default_rng(0))
    T, R = hands.T.double(), hands.T[:, :3, :3].double()
    torch.testing.assert_close(R @ R.mT, torch.eye(3).double().expand_as(R), atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.det(R), torch.ones(len(R)).double(), atol=1e-6, rtol=0)
    assert (T[:, 2, 2] <= 0).all() and set(hands.grasp_type.tolist()) == {0, 1}
    nearest = torch.cdist(T[:, :3, 3], sensed.scene.texlets.positions.double()).argmin(1)
    narrow = hands.grasp_type == 0  # these stand on a texlet, give or take 5 mm
    cosine = (T[:, :3, 0] * sensed.scene.texlets.normals[nearest]).sum(1)[narrow]
    assert math.degrees(math.acos(cosine.median())) < 20
    away = torch.cdist(T[:, :3, 3], sensed.scene.texlets.positions.double()).amin(1)
    assert away[narrow].median() < 0.01 < away[~narrow].max()


class Answers:
    """In the place of the network's process: hands on the tall block from above, the surest through its middle."""

    def __init__(self):
        self.raw = None

    def grasps(self, raw, seed):
        self.raw = raw
        T = torch.eye(4).repeat(3, 1, 1)
        T[:, :3, :3] = torch.tensor([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # closing along y
        T[:, :3, 3] = torch.tensor([[-0.08, 0.02, 0.03], [-0.08, 0.02, 0.11], [0.0, -0.09, 0.03]])
        return Found(T, torch.tensor([0.9, 0.5, 0.25]), 1.5)


def test_of_the_network_s_grasps_the_surest_free_one_is_taken(tools, sensed):
    """The first cuts the block; where the second failed the third, on the cube, is taken."""
    served = Answers()
    chosen = Network(tools, served).choose(sensed, NOWHERE)
    assert chosen.grasp_type == "WPG" and chosen.probability == 0.5 and chosen.seconds == 1.5
    np.testing.assert_allclose(chosen.T_world_tcp[:3, 3], [-0.08, 0.02, 0.11], atol=1e-6)
    assert served.raw.on_object.any() and not served.raw.on_object.all()  # the table is among the points
    assert served.raw.points[served.raw.on_object, 2].min() > 0.007
    assert Network(tools, served).choose(sensed, np.array([[-0.08, 0.02, 0.11]])).probability == 0.25
