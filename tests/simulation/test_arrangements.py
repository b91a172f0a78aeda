"""Objects packed or piled on a table: where they are, that they rest, and that a scene is the same to the bit."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from clutter_scenes import FAST, arrangement, poses, small_things, standing
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from scipy.spatial.transform import Rotation
from trial_objects import ball, box, can, cup

from spgf_torch.errors import InputError
from spgf_torch.paths import root
from spgf_torch.settings import typed
from spgf_torch.simulation.arrangements import Placed, arranged, fitting, inside, scaled, settled, stands
from spgf_torch.simulation.clutter_config import PILE, ArrangementConfig
from spgf_torch.simulation.episode import Simulator
from spgf_torch.simulation.tabletop import Tabletop


def named(name: str) -> ArrangementConfig:
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        return typed(ArrangementConfig, OmegaConf.to_container(compose(f"arrangement/{name}").arrangement))


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_a_scene_is_the_same_in_any_order(hand, kind):
    """Of scenes, of objects, and whatever physics ran in between."""
    config, objects = named(kind), small_things()
    first = {seed: poses(arranged(objects, 4, seed, config)) for seed in (0, 1, 2)}
    Simulator(box((0.038, 0.06, 0.1)), hand, FAST)  # sets PhysX's gravity to nothing, and its iterations
    for seed in (2, 0, 1):
        assert poses(arranged(objects[::-1], 4, seed, config)) == first[seed]
    assert len({str(scene) for scene in first.values()}) == 3


def test_packed_objects_stand_apart_in_the_middle():
    config = named("packed")
    for seed in range(5):
        placed = arranged(small_things(), 3, seed, config)
        assert sorted(each.obj.name for each in placed) == ["brick", "can", "cup"]  # each once; the ball rolls
        for each in placed:
            assert np.allclose(each.T_world_object[2], [0, 0, 1, 0], atol=1e-4)
            assert np.abs(each.centre[:2]).max() <= 0.1 + 1e-4
        for a, b in itertools.combinations(placed, 2):
            distance = np.linalg.norm(a.points[:, None] - b.points[None], axis=2).min()
            assert distance >= 0.005 - 1e-4
    turned = [each.T_world_object[0, 0] for seed in range(5) for each in arranged(small_things(), 3, seed, config)]
    assert min(turned) < -0.5 and max(turned) > 0.5


def test_no_room_is_fewer_objects():
    """Three boxes of 11 cm have no room with their centres in a square of 5 cm: two are at most 7.1 cm apart."""
    boxes = [replace(box((0.11, 0.11, 0.05)), name=name) for name in "abc"]
    assert len(arranged(boxes, 3, 0, arrangement(middle=0.05))) == 1


def test_piled_objects_lie_within_the_box_at_rest():
    config = named("pile")
    for seed in range(3):
        placed = arranged(small_things(), 4, seed, config)
        again = settled(placed, config)
        assert 3 <= len(placed) <= 4 and len(again) == len(placed)
        for before, after in zip(placed, again, strict=True):
            assert np.abs(before.centre[:2]).max() <= config.lost and before.points[:, 2].min() > -0.001
            assert np.linalg.norm(after.centre - before.centre) < 0.003


def test_objects_are_dropped_on_what_lies_there():
    """Flat boxes as wide as the box come to lie on each other: three of 2 cm are 6 cm high."""
    plates = [replace(box((0.14, 0.14, 0.02)), name=name) for name in "abc"]
    placed = arranged(plates, 3, 4, arrangement(kind=PILE, workspace=0.2, drop_spread=0.0))
    assert len(placed) == 3
    assert sorted(round(each.centre[2], 2) for each in placed)[0] == 0.01
    assert max(each.points[:, 2].max() for each in placed) >= 0.055


def test_what_rolls_off_is_left_out():
    """A ball comes to rest where it is let go; one beyond 20 cm is out, and so is one beside the table."""
    config = arrangement()
    near, far, beside = (standing(ball(), *xy) for xy in [(0.05, -0.19), (0.03, 0.21), (1.3, 0.0)])
    assert [each.obj for each in settled([far, near, beside], config)] == [near.obj]
    assert inside(near, config) and not inside(far, config)
    assert settled([], config) == ()


def test_an_object_falls_under_gravity_and_stays():
    """0.1 m take 0.143 s; after a quarter of a second it lies there, on its lowest point."""
    above = Placed(box((0.05, 0.03, 0.08)), trimesh.transformations.translation_matrix([0.02, -0.03, 0.1]))
    (lies,) = settled([above], arrangement())
    assert np.allclose(lies.T_world_object[:3, 3], [0.02, -0.03, 0.0], atol=5e-4)
    tabletop = Tabletop([above], FAST)
    tabletop.step(0.1)
    fallen = 0.1 - tabletop.poses()[0][2, 3]
    assert fallen == pytest.approx(0.5 * 9.81 * 0.1**2, rel=0.06)  # steps of 5 ms: one more half-step's way
    asleep = Tabletop([above], FAST, asleep=True)
    asleep.step(0.1)
    assert asleep.poses()[0][2, 3] == np.float32(0.1)


def test_two_of_one_object_do_not_share_a_shape():
    """Two bricks let go into each other's place above push apart; one brick's top bears the other."""
    brick = box((0.05, 0.03, 0.08))
    low, high = settled(
        [standing(brick), Placed(brick, trimesh.transformations.translation_matrix([0, 0, 0.081]))], arrangement()
    )
    assert (low.centre[2], high.centre[2]) == pytest.approx((0.04, 0.12), abs=5e-4)


def test_what_stands():
    """A foot of 24 mm about the centre of mass; a ball's foot of 1 mm height is about 8 mm wide to each side."""
    assert stands(can(), 0.012) and stands(box((0.026, 0.05, 0.1)), 0.012) and stands(cup(), 0.012)
    assert not stands(box((0.022, 0.05, 0.1)), 0.012) and not stands(ball(), 0.012)
    lying = can(0.02)
    turn = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    parts = tuple(part @ turn.T for part in lying.parts)
    assert not stands(replace(lying, parts=parts, com=turn @ lying.com), 0.012)
    one_sided = replace(can(), com=np.array([0.03, 0.0, 0.06]))
    assert not stands(one_sided, 0.012)


def test_half_the_size_is_an_eighth_of_the_mass():
    whole = box((0.04, 0.06, 0.1), mass=0.8)
    half = scaled(whole, 0.5)
    assert half.mass == pytest.approx(0.1) and np.allclose(half.com, [0, 0, 0.025])
    assert np.allclose(half.mesh.extents, [0.02, 0.03, 0.05]) and np.allclose(half.parts[0], whole.parts[0] / 2)
    assert half.inertia[0, 0] == pytest.approx(0.1 / 12 * (0.03**2 + 0.05**2))
    sizes = [each.obj.mesh.extents[2] for each in arranged([whole], 1, 3, named("packed_field"))]
    assert 0.07 <= sizes[0] <= 0.09
    assert whole.mesh.extents[2] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("objects", "changes", "words"),
    [
        ([ball()], {}, "objects: expected some that stand upright and fit a workspace of 0.3 m, got none"),
        ([box((0.31, 0.05, 0.1))], {}, "objects: expected some that stand upright"),
        ([box((0.25, 0.18, 0.05))], {"kind": "pile"}, "objects: expected some that fit a workspace of 0.3 m, got none"),
        ([can()], {"scale": [1.0]}, "arrangement.scale: expected two numbers above 0, the smaller first; got [1.0]"),
        ([can()], {"scale": [0.9, 0.7]}, "arrangement.scale: expected two numbers above 0, the smaller first"),
    ],
)
def test_what_cannot_be_arranged_is_told_in_one_line(objects, changes, words):
    with pytest.raises(InputError) as error:
        arranged(objects, 5, 0, arrangement(**changes))
    assert str(error.value).startswith(words) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("obj", "changes", "fits"),
    [
        (box((0.34, 0.05, 0.1)), {"scale": [0.7, 0.85]}, True),  # 0.289 m at most
        (box((0.34, 0.05, 0.1)), {"scale": [0.7, 0.9]}, False),  # 0.306 m
        (box((0.25, 0.18, 0.05)), {"scale": [0.7, 0.9], "kind": "pile"}, True),  # 0.312 m across, of which 0.281
        (box((0.25, 0.18, 0.05)), {"scale": [0.7, 1.0], "kind": "pile"}, False),
        (box((0.03, 0.05, 0.1)), {"scale": [0.9, 1.0]}, True),  # its centre is 13.5 mm within its foot, at least
        (box((0.03, 0.05, 0.1)), {"scale": [0.7, 1.0]}, False),  # 10.5 mm
        (box((0.022, 0.05, 0.1)), {"scale": [1.0, 1.2]}, False),  # 11 mm
    ],
)
def test_what_fits_does_so_at_every_size_that_may_be_drawn(obj, changes, fits):
    config = arrangement(**changes)
    if fits:
        assert fitting([obj], config) == [obj]
    else:
        with pytest.raises(InputError, match=r"^objects: expected some that"):
            fitting([obj], config)


def test_the_shipped_arrangements():
    packed, pile, field = named("packed"), named("pile"), named("packed_field")
    assert replace(pile, kind="packed") == packed and pile.kind == "pile"
    assert (field.scale, field.middle, field.gap, field.tries) == ([0.7, 0.9], 0.14, 0.0, 12)
    assert packed.scale == [1, 1] and packed.workspace == 0.3
