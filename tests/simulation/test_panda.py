"""A second hand, shipped as a URDF and a YAML file: its geometry by hand, its trials, and a model learned from them."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from composing import composed
from trial_objects import ball, bin_, box, can, cup, from_above, from_side

from spgf_torch import evaluate, simulate
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.kinematics import Kinematics
from spgf_torch.hands.records import grippers_of
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.articulation import HandBuilder, physx, sapien
from spgf_torch.simulation.config import EpisodeConfig, SimulateConfig
from spgf_torch.simulation.episode import Simulator, configure
from spgf_torch.simulation.precheck import PreCheck
from spgf_torch.train import run as train


def panda_settings() -> dict:
    return yaml.safe_load((root() / "conf/hand/panda.yaml").read_text())


@pytest.fixture(scope="module")
def panda() -> Hand:
    return load_hand(typed(HandConfig, panda_settings()))


def outcome(hand, obj, T, kind):
    if PreCheck(obj, hand.preshapes[kind]).collides(T):
        return "collision"
    return Simulator(obj, hand, settings(EpisodeConfig)).run(T, kind)


@pytest.mark.parametrize(("kind", "joint"), [("NPG", 0.02), ("WPG", 0.04)])
def test_tcp_lies_between_the_pads(panda, kind, joint):
    """Joint frames stand 58.4 mm above the palm's, the pads' middle 45 mm above those: the published 103.4 mm.

    Each finger takes half of the opening. The first finger slides to +y, the second to -y, so +x of the TCP is -y of
    the palm, and y = z x x is its +x.
    """
    preshape = panda.preshapes[kind]
    assert preshape.joints == pytest.approx({"panda_finger_joint1": joint, "panda_finger_joint2": joint})
    expected = [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0.1034], [0, 0, 0, 1]]
    np.testing.assert_allclose(preshape.T_base_tcp, expected, atol=1e-7)


def test_open_hand_leaves_the_space_between_the_pads_free(panda):
    """In the TCP frame the tips' faces lie at +-opening / 2, 17.5 mm wide and 17.6 mm high, half of it to each side.

    The palm's box ends at 66 mm, 37.4 mm below the TCP; above it nothing is nearer to the middle than the tips.
    """
    for preshape in panda.preshapes.values():
        half = preshape.opening / 2
        tips = sorted((s.bounds for s in preshape.shapes if s.bounds[1, 2] > 0), key=lambda bounds: bounds[0, 0])
        for tip, (low, high) in zip(tips, ((-half - 0.0142, -half), (half, half + 0.0142)), strict=True):
            np.testing.assert_allclose(tip, [[low, -0.00875, -0.0088], [high, 0.00875, 0.0088]], atol=1e-6)
        palm, *fingers = preshape.shapes
        np.testing.assert_allclose(palm.bounds[:, 2], [-0.1294, -0.0374], atol=1e-6)
        assert all(np.abs(shape.bounds[:, 0]).min() > half - 1e-6 for shape in fingers)


def test_pads_meet_at_zero(panda):
    """Both joints close as they fall to 0, where the tips' faces, 45 mm above their frames, meet at y = 0."""
    links = Kinematics(panda.robot).links(panda.preshapes["WPG"].closed)
    for kind, preshape in panda.preshapes.items():
        assert preshape.closed == pytest.approx({"panda_finger_joint1": 0, "panda_finger_joint2": 0}, abs=1e-9), kind
        assert preshape.closing.phases == ({"panda_finger_joint1": -1.0, "panda_finger_joint2": -1.0},)
        assert preshape.closing.follow == {}  # both are driven, whatever the URDF's <mimic> says
    for link in ("panda_leftfinger", "panda_rightfinger"):
        np.testing.assert_allclose(links[link][:3, 3], [0, 0, 0.0584], atol=1e-9)


def test_a_mimic_joint_is_driven_here_and_left_to_the_robot_on_export(panda):
    for gripper in grippers_of(panda).values():
        assert gripper.active == ("panda_finger_joint1",)
        assert gripper.closed == pytest.approx({"panda_finger_joint1": 0, "panda_finger_joint2": 0}, abs=1e-9)


@pytest.mark.parametrize("kind", ["NPG", "WPG"])
def test_sapien_places_every_shape_where_the_kinematics_do(panda, kind):
    """Each corner of each box, the slanted ones too, within a hundredth of a millimetre."""
    preshape = panda.preshapes[kind]
    configure(settings(EpisodeConfig))
    builder = HandBuilder(panda.robot, preshape, physx.PhysxMaterial(0.6, 0.6, 0))
    articulation = builder.build(sapien.Scene([physx.PhysxCpuSystem()]))
    articulation.set_qpos([preshape.joints[joint.name] for joint in articulation.active_joints])
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    corners = []
    for link in articulation.links:
        for shape in link.collision_shapes:
            T = (link.entity.pose * shape.local_pose).to_transformation_matrix()
            corners.append((signs * shape.half_size) @ T[:3, :3].T + T[:3, 3])
    assert len(corners) == len(preshape.shapes) == 7
    for shape in preshape.shapes:
        expected = shape.vertices @ preshape.T_base_tcp[:3, :3].T + preshape.T_base_tcp[:3, 3]
        gaps = [np.linalg.norm(expected[:, None] - box[None], axis=-1).min(axis=1).max() for box in corners]
        assert min(gaps) < 1e-5


GRASPS = {
    "can": (can(), from_side(0.06), "WPG", "success"),
    "ball": (ball(), from_above(0.035), "WPG", "success"),
    "75 mm box": (box((0.075, 0.06, 0.1)), from_side(0.05), "WPG", "success"),
    "85 mm box": (box((0.085, 0.06, 0.1)), from_side(0.05), "WPG", "collision"),
    "35 mm box": (box((0.035, 0.06, 0.1)), from_side(0.05), "NPG", "success"),
    "45 mm box": (box((0.045, 0.06, 0.1)), from_side(0.05), "NPG", "collision"),
    "rim of a mug": (cup(), from_above(0.08, x=0.0385), "NPG", "success"),
    "rim beside the middle": (cup(), from_above(0.08, x=0.0465), "NPG", "success"),
    "rim of a thin bin": (bin_(), from_above(0.14, x=0.09925), "NPG", "success"),
    "empty space": (can(), from_above(0.3), "WPG", "missed"),
    "3.5 kg": (can(mass=3.5), from_side(0.06), "WPG", "success"),
    "6 kg": (can(mass=6.0), from_side(0.06), "WPG", "slipped"),
}


@pytest.mark.parametrize("case", GRASPS)
def test_grasps(panda, case):
    """Two pads of 50 N at friction 0.6 carry 60 N: 4.1 kg when shaken down (14.81 m/s2), 4.7 kg when lifted (12.81).

    So 3.5 kg must not slip, and 6 kg do by 56 mm in the 0.2 s of lifting: (12.81 - 60 / 6) / 2 * 0.2**2.
    """
    obj, T, kind, expected = GRASPS[case]
    assert outcome(panda, obj, T, kind) == expected


def test_an_opening_that_the_hand_cannot_have():
    told = panda_settings()
    told["preshapes"]["WPG"]["opening"] = 0.1
    with pytest.raises(InputError, match=re.escape("hand.preshapes.WPG.opening: expected 0.000 to 0.080 m, got 0.1")):
        load_hand(typed(HandConfig, told))


def changed(folder: Path, pattern: str, replacement: str) -> HandConfig:
    """Settings of a hand whose URDF has `pattern` replaced everywhere."""
    path = folder / "hand.urdf"
    path.write_text(re.sub(pattern, replacement, (root() / "data/hands/panda.urdf").read_text()))
    return typed(HandConfig, {**panda_settings(), "urdf": str(path)})


def test_visual_shapes_are_left_out(tmp_path):
    """A robot's own URDF has meshes with colours to look at, which SAPIEN would want a renderer for."""
    look = '<visual><geometry><mesh filename="package://robot/hand.dae"/></geometry><material name="white">'
    look += '<color rgba="1 1 1 1"/></material></visual>'
    seen = load_hand(changed(tmp_path, "</inertial>", "</inertial>" + look))
    assert outcome(seen, can(), from_side(0.06), "WPG") == "success"


def test_a_mesh_file_is_part_of_the_hand(tmp_path):
    """The palm as a mesh file: the same trial, and another digest once the file is another."""
    digests = []
    for name, height in (("low", 0.08), ("high", 0.092)):
        (tmp_path / name).mkdir()
        trimesh.creation.box((0.063, 0.208, height)).export(tmp_path / name / "palm.stl")
        box_, mesh = '<box size="0.063 0.208 0.092"/>', '<mesh filename="palm.stl"/>'
        hand = load_hand(changed(tmp_path / name, box_, mesh))
        digests.append(hand.digest)
        assert outcome(hand, can(), from_side(0.06), "WPG") == "success"
        assert np.ptp(hand.preshapes["NPG"].shapes[0].bounds[:, 2]) == pytest.approx(height, abs=1e-6)
    assert digests[0] != digests[1]


def test_no_code_knows_this_hand():
    code = [path.read_text() for path in (root() / "spgf_torch").rglob("*.py")]
    assert code and not any("panda_" in text or "franka" in text.lower() for text in code)


NAMES = ("mug_coffee", "tumbler", "box_tea", "soap_bar", "egg", "banana")
TINY = [
    "K=4",
    "folds=2",
    "bootstrap=100",
    "sensing.width=160",
    "sensing.height=120",
    "sensing.focal=144",
    "affordance.features_per_object=60",
    "prototypes.restarts=2",
    "prototypes.subsample=1000",
    "inner_grasps=50",
    "cache=off",
]


def settled(command: str, kind: type, *overrides: str):
    """The settings that the command would have with these overrides."""
    return typed(kind, composed(command, *overrides))


def test_simulate_train_evaluate(tmp_path: Path):
    """Trials, a model and executed grasps of the second hand; neither hand takes the other's trials or model."""
    objects, table, model, meshes = (tmp_path / name for name in ("objects", "trials", "model", "meshes"))
    for folder in (objects, model, meshes):
        folder.mkdir()
    for name in NAMES:
        shutil.copy(root() / f"data/objects/{name}.yaml", objects)
    sizes = [f"objects={objects}", "candidates=30", "workers=1"]
    simulate.run(settled("simulate", SimulateConfig, "hand=panda", f"out={table}", *sizes), tmp_path)

    learn = [f"objects={objects}", f"trials={table}", "hand=panda", *TINY]
    train(settled("train", TrainConfig, *learn), model)
    assert "panda" in (model / "README.md").read_text()
    with pytest.raises(InputError, match=r"banana\.parquet: expected trials made with hand_digest"):
        train(settled("train", TrainConfig, *learn, "hand=sdh2"), tmp_path)
    others = tmp_path / "others"  # a folder that was named: no other trials are made in the place of these
    shutil.copytree(root() / "data/trials", others)
    with pytest.raises(InputError, match="expected trials made with hand_digest"):
        train(settled("train", TrainConfig, *learn, f"trials={others}"), tmp_path)

    block = trimesh.creation.box((0.05, 0.06, 0.08)).subdivide().subdivide()
    block.export(meshes / "block.ply")
    (meshes / "manifest.csv").write_text("name,file,class\nblock,block.ply,box\n")
    held = [
        f"objects={meshes}",
        f"model={model}",
        "candidates=sampled",
        "samples=60",
        "random_trials=3",
        "N=3",
        "workers=1",
    ]
    evaluate.run(settled("evaluate", EvaluateConfig, *held, "hand=panda"), tmp_path)
    (row,) = json.loads((tmp_path / "results.json").read_text())["per_object"]
    assert row["object"] == "block" and 0 <= row["CG"] <= 1
    told = r"expected a model learned with this hand \(sdh2\), got one of panda; give the model.s own: hand=panda$"
    with pytest.raises(InputError, match=told):
        evaluate.run(settled("evaluate", EvaluateConfig, *held), tmp_path)
