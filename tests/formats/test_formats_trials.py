"""The grasp of `small_trials`, worked out by hand, through every format: for strangers, and through our readers."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
import torch
import trimesh
import webdataset
import yaml
from scipy.spatial.transform import Rotation
from small_trials import (
    CLOSED,
    EXACT,
    OPEN,
    T_OBJECT_GRIPPER,
    T_OBJECT_TCP,
    XYZ,
    C,
    S,
    W,
    nothing,
    refusal,
    small_trials,
)

from spgf_torch.errors import InputError
from spgf_torch.formats.acronym import MOTIONS, read_acronym, write_acronym
from spgf_torch.formats.card import rates
from spgf_torch.formats.common import read_joints, read_split, write_common
from spgf_torch.formats.graspgen import OFFSET, gripper_yaml, read_graspgen, read_gripper, write_graspgen
from spgf_torch.formats.graspnet import read_graspnet, write_graspnet_trials
from spgf_torch.formats.isaac import read_isaac, write_isaac_trials
from spgf_torch.formats.shards import read_shards, write_shards
from spgf_torch.formats.trial_sets import TrialSet
from spgf_torch.formats.write_datasets import check_jaws

T_GRIPPER_TCP = np.array([[1, 0, 0, 0], [0, 1, 0, -0.02], [0, 0, 1, 0.2], [0, 0, 0, 1]])  # minus (0, 0.02, -0.2)


@pytest.fixture
def trials(tmp_path: Path) -> TrialSet:
    return small_trials(tmp_path / "claw")


def test_acronym_as_h5py_has_it(trials: TrialSet, tmp_path: Path) -> None:
    write_acronym(tmp_path / "acronym", trials, nothing)
    with h5py.File(tmp_path / "acronym/claw_NPG/boxes_box-a_1.0.h5") as file:
        np.testing.assert_allclose(file["grasps/transforms"][0], T_OBJECT_GRIPPER, atol=EXACT)
        assert file["grasps/transforms"].dtype == np.float64 and file["grasps/transforms"].shape == (2, 4, 4)
        for engine in ("flex", "sapien"):
            labels = file[f"grasps/qualities/{engine}/object_in_gripper"]
            assert labels.dtype == np.int64 and labels[()].tolist() == [1, 0]  # held, collision
            assert "SAPIEN 3.0.3" in file[f"grasps/qualities/{engine}"].attrs["provenance"]
            for name in MOTIONS:
                motion = file[f"grasps/qualities/{engine}/{name}"]
                assert np.isnan(motion[()]).all() and motion.shape == (2,) and "unknown" in motion.attrs["provenance"]
        assert file["object/file"][()].decode() == "meshes/boxes/box-a.obj"
        assert file["gripper/type"][()].decode() == "claw_NPG"
        assert file["gripper/configuration"][()].tolist() == [0.02, 0.02, 0.1]
        scalars = {name: file[f"object/{name}"] for name in ("scale", "mass", "density", "friction", "volume")}
        assert all(value.shape == () and value.dtype == np.float64 for value in scalars.values())
        # 0.06 * 0.04 * 0.1 m3 = 0.24 l, of which 0.12 kg is 500 kg/m3
        expected = {"scale": 1, "mass": 0.12, "density": 500, "friction": 0.6, "volume": 0.00024}
        assert {name: value[()] for name, value in scalars.items()} == pytest.approx(expected)
        np.testing.assert_allclose(file["object/com"], [0.01, 0.0123456789, 0.05])
        np.testing.assert_allclose(file["object/inertia"], np.diag([1, 2, 3]))


def test_acronym_names_split_as_its_loaders_do(trials: TrialSet, tmp_path: Path) -> None:
    write_acronym(tmp_path / "acronym", trials, nothing)
    names = {path.stem for path in (tmp_path / "acronym/claw_WPG").glob("*.h5")}
    assert {tuple(name.split("_")) for name in names} == {("boxes", "box-a", "1.0"), ("containers", "cup-b", "1.0")}
    assert read_split(tmp_path / "acronym/splits/fold0/valid.txt") == ["boxes_box-a_1.0.h5"]
    assert read_split(tmp_path / "acronym/splits/fold0/train.txt") == ["containers_cup-b_1.0.h5"]


def test_acronym_is_read_back(trials: TrialSet, tmp_path: Path) -> None:
    write_acronym(tmp_path / "acronym", trials, nothing)
    path = tmp_path / "acronym/claw_WPG/containers_cup-b_1.0.h5"
    known = read_acronym(path)
    assert known.object_in_gripper.tolist() == [0, 1] and known.gripper == "claw_WPG" and known.mass == 0.12
    T_object_tcp = trials.tables[1].T_object_tcp[2:].numpy()
    np.testing.assert_allclose(known.transforms @ T_GRIPPER_TCP, T_object_tcp, atol=1e-6)
    joints = read_joints(tmp_path / "acronym/claw_WPG/joints.json")
    assert joints.gripper == "claw_WPG" and joints.joints == OPEN and joints.closed == CLOSED
    np.testing.assert_allclose(joints.T_gripper_tcp, T_GRIPPER_TCP, atol=1e-9)
    np.testing.assert_allclose(
        joints.T_gripper_base, [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-9
    )
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError) as error:
        read_acronym(path)
    assert "cup-b" in refusal(error.value) and "ACRONYM" in refusal(error.value)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("object/mass", None, "object/mass"),
        ("object/mass", h5py.ExternalLink("other.h5", "/object/mass"), "object/mass"),
        ("grasps/transforms", np.ones((2, 4, 4)), "0 0 0 1 in the last row"),
        ("grasps/transforms", np.tile(np.diag([1.0, 1, -1, 1]), (2, 1, 1)), "rotation"),
        ("grasps/transforms", np.ones((2, 3, 4)), "N poses"),
        ("grasps/qualities/flex/object_in_gripper", np.array([1, 2]), "0 and 1"),
        ("grasps/qualities/flex/object_in_gripper", np.array([1]), "N poses"),
    ],
)
def test_acronym_refuses(name: str, value: Any, words: str, trials: TrialSet, tmp_path: Path) -> None:
    write_acronym(tmp_path / "acronym", trials, nothing)
    path = tmp_path / "acronym/claw_NPG/boxes_box-a_1.0.h5"
    with h5py.File(path, "a") as file:
        del file[name]
        if value is not None:
            file[name] = value
    with pytest.raises(InputError, match=words) as error:
        read_acronym(path)
    assert "box-a" in refusal(error.value)


def test_acronym_makes_no_room_for_what_is_not_there(trials: TrialSet, tmp_path: Path) -> None:
    write_acronym(tmp_path / "acronym", trials, nothing)
    path = tmp_path / "acronym/claw_NPG/boxes_box-a_1.0.h5"
    with h5py.File(path, "a") as file:
        del file["grasps/transforms"]
        file.create_dataset("grasps/transforms", (10**12, 4, 4), np.float64, chunks=(1, 4, 4))
        shutil.copy(path, tmp_path / "other.h5")
    with pytest.raises(InputError, match="128000000000000 bytes"):
        read_acronym(path)
    with h5py.File(path, "a") as file:
        del file["object/mass"]
        file["object/mass"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/object/mass")
    with pytest.raises(InputError, match="another file"):
        read_acronym(path)


def test_graspgen(trials: TrialSet, tmp_path: Path) -> None:
    write_graspgen(tmp_path / "graspgen", trials, nothing)
    path = tmp_path / "graspgen/grasp_data/claw_NPG/box_a.json"
    known = json.loads(path.read_text())
    np.testing.assert_allclose(known["grasps"]["transforms"][0], T_OBJECT_GRIPPER, atol=EXACT)
    assert known["grasps"]["object_in_gripper"] == [True, False]  # as a mask: 1 and 0 would be rows
    assert all(isinstance(label, bool) for label in known["grasps"]["object_in_gripper"])
    assert known["object"] == {"file": "meshes/boxes/box-a.obj", "scale": 1.0}
    assert read_split(tmp_path / "graspgen/splits/claw_NPG/fold1/valid.txt") == ["meshes/containers/cup-b.obj"]
    read = read_graspgen(path)
    np.testing.assert_allclose(read.transforms @ T_GRIPPER_TCP, trials.tables[0].T_object_tcp[:2], atol=1e-6)
    assert read.object_in_gripper.dtype == bool and read.object_in_gripper.tolist() == [True, False]


def test_graspgen_multiplies_by_an_offset_that_changes_nothing(trials: TrialSet, tmp_path: Path) -> None:
    write_graspgen(tmp_path / "graspgen", trials, nothing)
    path = tmp_path / "graspgen/grippers/claw_WPG.yaml"
    known = yaml.safe_load(path.read_text())
    assert known["width"] == 0.08 and known["depth"] == 0.2 and known[OFFSET] == [[0, 0, 0], [0, 0, 0, 1]]  # xyzw
    np.testing.assert_array_equal(read_gripper(path).T_offset, np.eye(4))
    path.write_text(f"width: 0.1\ndepth: 0.2\n{OFFSET}: [[1, 2, 3], [1, 0, 0, 0]]\n")
    np.testing.assert_allclose(
        read_gripper(path).T_offset, [[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]], atol=1e-15
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda k: k["grasps"].update(object_in_gripper=[1, 0]), ["object_in_gripper", "true and false", "got 1"]),
        (lambda k: k["grasps"].update(object_in_gripper=[True]), ["label for each of 2", "got 1"]),
        (lambda k: k["grasps"]["transforms"][1][0].__setitem__(0, 5.0), ["transforms[1]", "rotation"]),
        (lambda k: k.pop("object"), ["key object"]),
    ],
)
def test_graspgen_refuses(change, words: list[str], trials: TrialSet, tmp_path: Path) -> None:
    write_graspgen(tmp_path / "graspgen", trials, nothing)
    path = tmp_path / "graspgen/grasp_data/claw_NPG/box_a.json"
    known = json.loads(path.read_text())
    change(known)
    path.write_text(json.dumps(known))
    with pytest.raises(InputError) as error:
        read_graspgen(path)
    assert all(word in refusal(error.value) for word in [*words, "box_a.json"])


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_shards_as_webdataset_has_them(trials: TrialSet, tmp_path: Path) -> None:
    """It leaves files open that it has read to their end, hence the warnings."""
    write_shards(tmp_path / "webdataset", trials, nothing)
    shard = tmp_path / "webdataset/shard_000.tar"
    found = {sample["__key__"]: sample for sample in webdataset.WebDataset(str(shard), shardshuffle=False).decode()}
    assert set(found) == {"box_a_NPG", "box_a_WPG", "cup_b_NPG", "cup_b_WPG"}
    np.testing.assert_allclose(
        found["cup_b_NPG"]["grasps.json"]["grasps"]["transforms"][0], T_OBJECT_GRIPPER, atol=EXACT
    )
    assert json.loads((tmp_path / "webdataset/uuid_index.json").read_text()) == dict.fromkeys(found, 0)
    paths = json.loads((tmp_path / "map_uuid_to_path.json").read_text())
    assert paths["cup_b_WPG"] == "meshes/containers/cup-b.obj"
    assert read_split(tmp_path / "webdataset/splits/claw_WPG/fold1/train.txt") == ["box_a_WPG"]


def test_shards_are_read_back(trials: TrialSet, tmp_path: Path) -> None:
    write_shards(tmp_path / "webdataset", trials, nothing)
    found = read_shards(tmp_path / "webdataset")
    np.testing.assert_allclose(found["box_a_NPG"].transforms[0], T_OBJECT_GRIPPER, atol=EXACT)
    assert found["box_a_WPG"].object_in_gripper.tolist() == [False, True]
    shard = tmp_path / "webdataset/shard_000.tar"
    whole = shard.read_bytes()
    for length in (len(whole) // 2, 700, 0, 2048):
        shard.write_bytes(whole[:length])
        with pytest.raises(InputError) as error:
            read_shards(tmp_path / "webdataset")
        assert "shard_000.tar" in refusal(error.value)
    shard.write_bytes(whole)
    (tmp_path / "webdataset/uuid_index.json").write_text('{"box_a_NPG": 0, "gone_NPG": 0}')
    with pytest.raises(InputError, match="gone_NPG in shard 0"):
        read_shards(tmp_path / "webdataset")


def test_isaac(trials: TrialSet, tmp_path: Path) -> None:
    write_isaac_trials(tmp_path / "isaac", trials, nothing)
    path = tmp_path / "isaac/claw_NPG/box_a.yaml"
    known = yaml.safe_load(path.read_text())
    assert known["format"] == "isaac_grasp" and known["format_version"] == 1.0
    assert (known["object_frame_link"], known["gripper_frame_link"]) == ("box_a", "claw_NPG")
    first, second = known["grasps"]["grasp_0"], known["grasps"]["grasp_1"]
    assert (first["confidence"], second["confidence"]) == (1.0, 0.0)
    assert first["orientation"]["w"] == pytest.approx(W, abs=EXACT)
    assert first["orientation"]["xyz"] == pytest.approx(XYZ, abs=EXACT)
    assert first["position"] == pytest.approx(T_OBJECT_GRIPPER[:3, 3], abs=EXACT)
    for grasp in (first, second):
        assert grasp["cspace_position"] == {"left": 0, "right": 0}
        assert grasp["pregrasp_cspace_position"] == {"left": 0.02, "right": 0.02}
    read = read_isaac(path)
    np.testing.assert_allclose(read.grasps[0].T_object_gripper, T_OBJECT_GRIPPER, atol=EXACT)
    wide = read_isaac(tmp_path / "isaac/claw_WPG/cup_b.yaml").grasps
    assert [grasp.name for grasp in wide] == ["grasp_2", "grasp_3"] and [g.confidence for g in wide] == [0.0, 1.0]
    T = np.stack([grasp.T_object_gripper for grasp in wide])
    np.testing.assert_allclose(T @ T_GRIPPER_TCP, trials.tables[1].T_object_tcp[2:], atol=1e-6)


def test_graspnet(trials: TrialSet, tmp_path: Path) -> None:
    """x is the approach (s, 0, c), y the closing (0, 1, 0), z = x cross y = (-c, 0, s), as columns; t is the TCP.

    docs/design/exports.md's t + (tip_z - depth) z, where the base stands on the approach axis: tip_z = 0.2 + 0.015,
    so 0.2 z more than the base. This base stands 0.02 beside it along tcp's y = (-c, 0, s), hence 0.02 (c, 0, -s) more:
    (-0.0173205 + 0.1 + 0.0173205, 0.2, 0.1367949 + 0.1732051 - 0.01) = (0.1, 0.2, 0.3).
    """
    write_graspnet_trials(tmp_path / "graspnet", trials, nothing)
    path = tmp_path / "graspnet/claw_NPG/cup_b.npy"
    rows = np.load(path, allow_pickle=False)
    assert rows.shape == (2, 17) and rows.dtype == np.float64
    expected = [1, 0.04, 0.02, 0.015, S, 0, -C, 0, 1, 0, C, 0, S, 0.1, 0.2, 0.3, 1]
    np.testing.assert_allclose(rows[0], expected, atol=EXACT)
    assert rows[:, 0].tolist() == [1, 0]  # higher is better
    read = read_graspnet(path)
    np.testing.assert_allclose(read[0].T_input_tcp, T_OBJECT_TCP, atol=EXACT)
    assert read_joints(path.parent / "joints.json").joints["left"] == 0.02


def test_meshes_and_clouds_are_in_the_frame_of_the_grasps(trials: TrialSet, tmp_path: Path) -> None:
    write_common(tmp_path, trials, nothing)
    mesh = trimesh.load_mesh(tmp_path / "meshes/boxes/box-a.obj")
    np.testing.assert_allclose(mesh.bounds, trials.objects[0].mesh.bounds, atol=1e-9)
    assert mesh.is_watertight and mesh.volume == pytest.approx(0.00024)
    cloud = np.load(tmp_path / "clouds/cup_b.npy", allow_pickle=False)
    assert cloud.shape == (300, 6) and cloud.dtype == np.float32
    assert torch.equal(torch.from_numpy(cloud[:, :3]), trials.texlets[1].positions)


def test_the_hands_root_is_the_gripper(trials: TrialSet, tmp_path: Path) -> None:
    """T_gripper_base: the base has its own axes, closing along its y, so that it is turned by -90 deg about z."""
    write_common(tmp_path, trials, nothing)
    robot = ElementTree.parse(tmp_path / "hand/claw_NPG.urdf").getroot()
    joint = next(joint for joint in robot.iter("joint") if joint.find("child").get("link") == "palm")
    assert joint.get("type") == "fixed" and joint.find("parent").get("link") == "claw_NPG"
    xyz, rpy = ([float(word) for word in joint.find("origin").get(key).split()] for key in ("xyz", "rpy"))
    np.testing.assert_allclose(xyz, 0, atol=1e-12)
    turned = Rotation.from_euler("xyz", rpy).apply([0, 1, 0])
    np.testing.assert_allclose(turned, [1, 0, 0], atol=1e-9)  # its y is the closing direction
    [mesh] = list(robot.iter("mesh"))
    piece = trimesh.load_mesh(tmp_path / "hand" / mesh.get("filename"))
    np.testing.assert_allclose(piece.extents, 0.1)  # of the palm's mesh file, beside the URDF wherever that was


def test_a_hand_of_any_kind_is_exported_where_a_format_can_say_it(tmp_path: Path) -> None:
    """Three types of a hand that is no jaw: isaac has its joints; formats of jaws refuse it in a line."""
    trials = small_trials(tmp_path / "given", ("hook", "pinch", "sphere"), jaws=False)
    write_isaac_trials(tmp_path / "isaac", trials, nothing)
    read = read_isaac(tmp_path / "isaac/claw_sphere/box_a.yaml")
    assert [grasp.name for grasp in read.grasps] == ["grasp_4", "grasp_5"]
    assert [grasp.confidence for grasp in read.grasps] == [0.0, 1.0]
    assert read.grasps[0].pregrasp_cspace == {"left": 0.04, "right": 0.04}
    for name in ("acronym", "graspgen", "graspnet"):
        with pytest.raises(InputError, match=rf"isaac for a hand with the grasp type hook.*got {name}"):
            check_jaws(trials.grippers.values(), ["isaac", name])
    check_jaws(trials.grippers.values(), ["isaac", "webdataset"])
    check_jaws(small_trials(tmp_path / "jaws").grippers.values(), ["acronym", "graspgen", "graspnet"])


def test_graspgen_follows_the_symmetry_of_the_preshape(trials: TrialSet) -> None:
    claw = trials.grippers["NPG"]
    assert yaml.safe_load(gripper_yaml(claw))["symmetric_antipodal"] is True
    assert yaml.safe_load(gripper_yaml(replace(claw, symmetry=1)))["symmetric_antipodal"] is False


def test_the_card_has_a_column_a_type(tmp_path: Path) -> None:
    """Of hook one of two held on each object, of sphere and pinch too: a row all, 2 of 4 of each."""
    trials = small_trials(tmp_path, ("hook", "pinch", "sphere"), jaws=False)
    told = rates(trials)
    assert list(told["all"]) == ["hook", "pinch", "sphere"]
    assert told["all"]["sphere"] == {"trials": 4, "success": 2, "rate": 0.5}


def test_names_that_acronym_could_not_tell_apart(trials: TrialSet, tmp_path: Path) -> None:
    twins = [trials.objects[0], replace(trials.objects[0], name="box-a")]
    with pytest.raises(InputError, match="box_a and box-a"):
        write_common(tmp_path, replace(trials, objects=twins), nothing)
