"""Trials in MuJoCo: the sanity set, hands of any kind, the same bits again; forces by hand."""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from trial_objects import ball, bin_, box, can, cup, from_above, from_side

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.paths import root
from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.second_engine.physics import MUJOCO, SAPIEN, MujocoPhysics, makers
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.worker import Case, Trials

mujoco = pytest.importorskip("mujoco")
sys.path.append(str(Path(__file__).parents[1] / "simulation"))

from small_hands import FINGER, described, jaw, jaw_preshape, joint, link, robot  # noqa: E402

from spgf_torch.second_engine.model import ModelMaker, fingers_of  # noqa: E402
from spgf_torch.second_engine.trial import MujocoSimulator, MujocoTrial  # noqa: E402

EPISODE, CONFIG = settings(EpisodeConfig), settings(MujocoConfig)


@pytest.fixture(scope="module")
def hand() -> Hand:
    return load_hand(settings(HandConfig))


@pytest.fixture(scope="module")
def panda() -> Hand:
    return load_hand(typed(HandConfig, yaml.safe_load((root() / "conf/hand/panda.yaml").read_text())))


def outcome(hand: Hand, obj, T: np.ndarray, kind: str, **changes: float) -> str:
    episode = settings(EpisodeConfig, **changes)
    return MujocoPhysics(CONFIG)(obj, Trials(hand, episode), kind)(T)


# What `tests/simulation/test_episode.py` and `test_panda.py` ask of SAPIEN.
PINCHES = {
    "can, 0.5": (can(), from_side(0.06), "WPG", 0.5, ("success",)),
    "ball, 0.8": (ball(), from_above(0.035), "WPG", 0.8, ("success",)),
    "0.8 kg": (can(mass=0.8), from_side(0.06), "WPG", 0.6, ("success",)),
    "rim of a mug": (cup(), from_above(0.08, x=0.0385), "NPG", 0.6, ("success",)),
    "rim of a jar": (cup(0.035, 0.12, 0.004, 0.3), from_above(0.11, x=0.033), "NPG", 0.6, ("success",)),
    "rim of a thin bin": (bin_(), from_above(0.14, x=0.09925), "NPG", 0.6, ("success",)),
    "mug from outside": (cup(), from_side(0.05), "WPG", 0.6, ("success",)),
    "38 mm box": (box((0.038, 0.06, 0.1)), from_side(0.05), "WPG", 0.6, ("success",)),
    "65 mm box": (box((0.065, 0.06, 0.1)), from_side(0.05), "WPG", 0.6, ("success",)),
    "slippery can": (can(), from_side(0.06), "WPG", 0.05, ("dropped", "slipped")),
    "slippery ball": (ball(), from_above(0.035), "WPG", 0.05, ("dropped", "slipped")),
    "2 kg": (can(mass=2.0), from_side(0.06), "WPG", 0.6, ("dropped", "slipped")),
    "empty space": (can(), from_above(0.3), "WPG", 0.6, ("missed",)),
    "wider than open": (ball(), from_above(0.035), "NPG", 0.6, ("collision",)),
}
JAWS = {
    "can": (can(), from_side(0.06), "WPG", ("success",)),
    "75 mm box": (box((0.075, 0.06, 0.1)), from_side(0.05), "WPG", ("success",)),
    "rim of a mug": (cup(), from_above(0.08, x=0.0385), "NPG", ("success",)),
    "rim beside the middle": (cup(), from_above(0.08, x=0.0465), "NPG", ("success",)),
    "3.5 kg": (can(mass=3.5), from_side(0.06), "WPG", ("success",)),
    "6 kg": (can(mass=6.0), from_side(0.06), "WPG", ("slipped", "dropped")),
}


@pytest.mark.parametrize("case", PINCHES)
def test_the_sanity_set(hand: Hand, case: str) -> None:
    obj, T, kind, friction, expected = PINCHES[case]
    assert outcome(hand, obj, T, kind, friction=friction) in expected


@pytest.mark.parametrize("case", JAWS)
def test_a_parallel_jaw(panda: Hand, case: str) -> None:
    """Two pads of 50 N at friction 0.6 carry 60 N: 4.1 kg when shaken down (`test_panda.py`)."""
    obj, T, kind, expected = JAWS[case]
    assert outcome(panda, obj, T, kind) in expected


def test_pads_press_with_the_closing_effort(panda: Hand) -> None:
    """50 N each, in the middle of a box, before anything pulls at it."""
    trial = MujocoTrial(MujocoSimulator(box((0.05, 0.06, 0.1)), panda, "WPG", EPISODE, CONFIG), from_side(0.05))
    trial.fingers.close()
    trial.fingers.settle(0.1)
    np.testing.assert_allclose(trial.data.actuator_force, [-50, -50], rtol=0.02)
    assert trial.touching() == {0, 1} and trial.held()


def test_loads_are_forces_in_the_hands_frame(panda: Hand) -> None:
    """A hand that looks down: the object falls along the approach, +z of the base, half g t2 = 4.4 mm in 30 ms."""
    trial = MujocoTrial(MujocoSimulator(can(), panda, "WPG", EPISODE, CONFIG), from_above(0.4))
    start = trial.pose()
    for _ in range(15):
        trial.step(trial.R_base_world @ [0.0, 0.0, -9.81])
    way = trial.pose()[:3, 3] - start[:3, 3]
    np.testing.assert_allclose(way, [0, 0, 9.81 / 2 * 0.03**2], atol=2e-4)


def test_damping_while_closing_is_that_of_physx(panda: Hand) -> None:
    """The speed of a body's centre of mass falls by exp(-c t), and its spin about a principal axis as well."""
    simulator = MujocoSimulator(can(), panda, "WPG", EPISODE, CONFIG)
    trial = MujocoTrial(simulator, from_above(0.4))
    trial.damping = 5.0
    spin = np.array([0.0, 0.0, 2.0])  # about the can's axis, in its frame
    trial.data.qvel[trial.speed : trial.speed + 6] = [0.3, 0, 0, *spin]
    for _ in range(50):
        trial.step()
    expected = np.exp(-5.0 * 0.1)
    np.testing.assert_allclose(trial.data.qvel[trial.speed : trial.speed + 3], [0.3 * expected, 0, 0], atol=2e-3)
    np.testing.assert_allclose(trial.data.qvel[trial.speed + 3 : trial.speed + 6], spin * expected, atol=1e-2)


def test_mass_and_inertia_are_the_objects(panda: Hand) -> None:
    """Not those of its convex pieces; of a cup, whose centre is not its frame's."""
    obj = cup()
    model = MujocoSimulator(obj, panda, "WPG", EPISODE, CONFIG).model
    body = model.body("object of the trial")
    assert body.mass[0] == pytest.approx(0.25)
    np.testing.assert_allclose(body.ipos, obj.com, atol=1e-12)
    np.testing.assert_allclose(np.sort(body.inertia), np.linalg.eigvalsh(obj.inertia), rtol=1e-9)


def states(hand: Hand, order: list[int]) -> list[tuple[int, str, str]]:
    """Trials on two objects in this order: what is left of each, to the last bit, sorted by trial."""
    simulators = [MujocoSimulator(obj, hand, "WPG", EPISODE, CONFIG) for obj in (cup(), can())]
    found = []
    for k in order:
        trial = MujocoTrial(simulators[k % 2], from_side(0.04 + 0.002 * k).astype(np.float64))
        found.append((k, trial.run(), trial.data.qpos.tobytes().hex()))
    return sorted(found)


def test_trials_repeat_bit_for_bit_in_any_order(hand: Hand) -> None:
    again = states(pickle.loads(pickle.dumps(hand)), [3, 0, 2, 1])
    assert states(hand, [0, 1, 2, 3]) == again and "success" in {outcome for _, outcome, _ in again}


def test_one_jaw_holds_a_block(tmp_path: Path) -> None:
    """The palm's own wall is the other jaw, and its contact counts as that of `wall`."""
    urdf = robot(
        link("wall", FINGER[0], "-0.005 0 0.03"),
        joint("wall_joint", "wall", kind="fixed", at="-0.02 0 0"),
        link("right", FINGER[0], "0.005 0 0.03"),
        joint("right_joint", "right", axis="1 0 0", limit="-0.02 0.05"),
    )
    preshape = {"open": {"right_joint": 0.03}, "close": {"right_joint": -1}, "oppose": [["wall"], ["right"]]}
    preshape["tcp"] = {"xyz": [0.0, 0, 0.04], "closing": [1, 0, 0]}
    one = described(tmp_path, urdf, fingers={"wall": ["wall"], "right": ["right"]}, preshapes={"only": preshape})
    assert outcome(one, box((0.03, 0.04, 0.06)), from_above(0.04), "only") == "success"


def test_a_mimic_joint_follows_with_ratio_and_offset(tmp_path: Path) -> None:
    """right = 0.5 left + 5 mm, also where the object stops the fingers (`test_articulation.py`)."""
    urdf = robot(
        link("left", FINGER[0], "-0.005 0 0.03"),
        link("right", FINGER[0], "0.005 0 0.03"),
        joint("left_joint", "left", axis="-1 0 0"),
        joint("right_joint", "right", axis="1 0 0", mimic="left_joint 0.5 0.005"),
    )
    preshape = {"open": {"left_joint": 0.04}, "close": {"left_joint": -1}, "oppose": [["left"], ["right"]]}
    coupled = described(tmp_path, urdf, preshapes={"only": preshape})
    T = np.linalg.inv(coupled.preshapes["only"].T_base_tcp)
    simulator = MujocoSimulator(box((0.022, 0.04, 0.06)), coupled, "only", EPISODE, CONFIG)
    trial = MujocoTrial(simulator, from_above(0.06 + T[2, 3]).astype(np.float64))
    assert trial.run() == "success"
    left, right = (trial.fingers.values()[name] for name in ("left_joint", "right_joint"))
    assert right == pytest.approx(0.5 * left + 0.005, abs=3e-4)


def test_held_joints_stand_where_the_preshape_has_them(tmp_path: Path) -> None:
    """An elbow 30 mm up that is held at 10 deg: the link stands turned about y, and nothing of the joint is left."""
    parts = []
    for name, side, sign in (("left", -1, "-1"), ("right", 1, "1")):
        parts += [
            link(f"{name}_arm", "0.01 0.03 0.03", f"{0.005 * side} 0 0.015"),
            link(name, "0.01 0.03 0.05", f"{0.005 * side} 0 0.025"),
            joint(f"{name}_joint", f"{name}_arm", axis=f"{sign} 0 0"),
            joint(f"{name}_elbow", name, "revolute", f"{name}_arm", "0 0 0.03", axis="0 1 0", limit="-1 1"),
        ]
    preshapes = {"only": {**jaw_preshape(), "hold": {"left_elbow": 10.0, "right_elbow": -10.0}}}
    held = described(tmp_path, robot(*parts), preshapes=preshapes)
    model = ModelMaker(held.robot, held.preshapes["only"], EPISODE, CONFIG).model(can())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert [model.joint(k).name for k in range(2)] == ["left_joint", "right_joint"] and model.njnt == 3
    turn = np.radians(10.0)
    x_axis = data.body("left").xmat.reshape(3, 3)[:, 0]
    np.testing.assert_allclose(x_axis, [np.cos(turn), 0, -np.sin(turn)], atol=1e-9)


def test_links_collide_with_those_of_other_fingers_alone(tmp_path: Path) -> None:
    """Not with the palm, which a finger reaches into, nor with one that overlaps it in the open hand."""
    urdf = jaw(
        link("third", "0.01 0.03 0.08", "-0.008 0.01 0.02"),  # 20 mm into the palm, 7 mm into the left finger
        joint("third_joint", "third", axis="-1 0 0"),
    )
    preshape = jaw_preshape(oppose=[["left", "third"], ["right"]])
    preshape["open"] = {**preshape["open"], "third_joint": 0.03}
    preshape["close"] = {**preshape["close"], "third_joint": -0.5}
    fingers = {"left": ["left"], "third": ["third"], "right": ["right"]}
    three = described(tmp_path, urdf, fingers=fingers, preshapes={"only": preshape})
    found = fingers_of(three.robot, three.preshapes["only"])
    assert found == {"palm": "", "left": "left_joint", "right": "right_joint", "third": "third_joint"}
    model = ModelMaker(three.robot, three.preshapes["only"], EPISODE, CONFIG).model(can())
    pairs = {(signature >> 16, signature & 0xFFFF) for signature in model.exclude_signature.tolist()}
    names = {frozenset((model.body(a).name, model.body(b).name)) for a, b in pairs}
    palm = {frozenset(("palm", other)) for other in ("left", "right", "third")}
    assert names == palm | {frozenset(("left", "third"))}


def test_each_engine_has_trials_of_its_own(panda: Hand) -> None:
    """Workers keep a trial by its key: the two engines', and those of other contacts, are not taken for each other."""
    assert list(makers("both", CONFIG)) == [SAPIEN, MUJOCO] and list(makers("mujoco", CONFIG)) == [MUJOCO]
    every = (*makers("both", CONFIG).values(), MujocoPhysics(replace(CONFIG, impratio=1.0)))
    cases = {Case.of(can(), Trials(panda, EPISODE), "WPG", make) for make in every}
    assert len(cases) == 3
    assert Case.of(can(), Trials(panda, EPISODE), "WPG", MujocoPhysics(replace(CONFIG))) in cases
