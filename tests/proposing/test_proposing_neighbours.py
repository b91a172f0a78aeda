"""Grasps among neighbours, end to end with the shipped judge of the Panda: two blocks beside each other on a table."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import spgf_torch
from spgf_torch import InputError, Scene
from spgf_torch.predictor import Predictor, block
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.config import ProposingConfig, proposing_named
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.proposing.judge_proposer import seen_weight
from spgf_torch.settings import plain, settings

TABLE = [0.0, 0.0, 1.0, 0.0]


@pytest.fixture(scope="module")
def model() -> Predictor:
    return spgf_torch.load("panda", proposing="clutter")


def blocks(*middles: tuple[float, float, float], **changes: object) -> Scene:
    """Cubes of 4 cm about these places (m), each a target of its own where `segments` is true."""
    cube = block(0.002)
    points = torch.cat([cube.positions + torch.tensor(middle) for middle in middles]).numpy()
    normals = cube.normals.repeat(len(middles), 1).numpy()
    segments = np.repeat(np.arange(1, len(middles) + 1), len(cube)) if changes.pop("segments", False) else None
    return Scene.from_points(points, normals=normals, segments=segments, table=TABLE, **changes)


def places(grasps: list) -> np.ndarray:
    return np.stack([grasp.T_input_tcp[:3, 3] for grasp in grasps])


def test_no_body_has_more_than_its_quota(model: Predictor) -> None:
    found = model.predict(blocks((-0.08, 0, 0.02), (0.08, 0, 0.02)), top=10)
    left = (places(found)[:, 0] < 0).sum()
    assert left == len(found) - left == model.config.neighbours.quota


def test_what_stands_on_the_way_is_seen(model: Predictor) -> None:
    """A block 10 cm above the one to grasp, another target: met on the way, not at the grasp."""
    scene = blocks((0, 0, 0.02), (0, 0, 0.19), segments=True)
    clearance, others = model.judged.search.clearance, scene.texlets.positions[scene.labels == 2]
    for planner, all_free in ((model, True), (Predictor.load("panda"), False)):
        below = [grasp for grasp in planner.predict(scene, top=10) if grasp.target == 1]
        types = torch.tensor([clearance.grasp_types.index(grasp.type) for grasp in below])
        T = torch.from_numpy(np.stack([grasp.T_input_tcp for grasp in below])).float()
        assert bool(clearance.free_of_obstacles(others, T, types).all()) == all_free


def test_hands_in_unseen_space_come_later(model: Predictor) -> None:
    """Of two hands 1 m apart unseen places fill that of the first: its probability counts by 0.9, or not at all."""
    search, config = model.judged.search, model.config
    T = torch.eye(4).repeat(2, 1, 1)
    T[1, 0, 3] = 1.0
    hands, volume = Hypotheses(T, torch.zeros(2, dtype=torch.int64)), search.clearance.volumes["NPG"]
    axes = [torch.arange(float(low), float(high), 0.008) for low, high in zip(volume.low, volume.high, strict=True)]
    around = Surroundings(hidden=torch.cartesian_prod(*axes))
    assert seen_weight(hands, search, config, around).tolist() == pytest.approx([0.9, 1.0])
    none = replace(config, neighbours=replace(config.neighbours, unseen_weight=0.0))
    assert seen_weight(hands, search, none, around).tolist() == [0.0, 1.0]
    assert seen_weight(hands, search, settings(ProposingConfig), around) == 1.0


def test_failed_places_are_left_to_where_there_is_nothing_else(model: Predictor) -> None:
    scene, radius = blocks((-0.08, 0, 0.02), (0.08, 0, 0.02)), model.config.neighbours.avoid_radius
    before = places(model.predict(scene, top=10))
    after = places(model.predict(scene, top=10, avoid=before[:1]))
    assert len(after) and (np.linalg.norm(after - before[0], axis=1) >= radius).all()
    everywhere = np.concatenate([before, *(before + radius * step for step in np.vstack([np.eye(3), -np.eye(3)]) / 2)])
    grid = np.stack(np.meshgrid(*[np.arange(-0.15, 0.16, 0.02)] * 3), -1).reshape(-1, 3)
    assert len(model.predict(scene, top=10, avoid=np.concatenate([everywhere, grid]))) > 0


def test_what_is_avoided_must_be_places(model: Predictor) -> None:
    scene = blocks((0, 0, 0.02))
    with pytest.raises(InputError, match=r"^avoid: expected places \(A, 3\) in m, got "):
        model.predict(scene, avoid=[1.0, 2.0])
    with pytest.raises(InputError, match=r"^avoid: expected finite places in m, got NaN or infinity$"):
        model.predict(scene, avoid=[[0, 0, np.nan]])
    with pytest.raises(InputError, match=r"^avoid: expected with a scene, got texlets$"):
        model.predict(block(0.005), avoid=[[0, 0, 0]])
    with pytest.raises(InputError, match=r"^avoid: expected a model loaded with proposing=clutter"):
        Predictor.load("panda").predict(scene, avoid=[[0, 0, 0]])
    with pytest.raises(InputError, match=r"^proposing: expected one of clutter, particles; got 'many'"):
        spgf_torch.load("panda", proposing="many")


def test_what_neighbours_add_is_named_only_where_it_is_given() -> None:
    """So that the settings of everything made before are what they were."""
    one, many = settings(ProposingConfig), proposing_named("clutter")
    assert proposing_named("particles") == one and "neighbours" not in plain(one)
    assert plain(many)["neighbours"]["way"] == many.neighbours.way > 0
    cube = {"NPG": torch.tensor([])}
    assert Clearance.of(cube, one).way == 0 and Clearance.of(cube, many).way == many.neighbours.way
