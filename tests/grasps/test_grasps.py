"""Grasps as one value: sequence, selection, other frames, dictionary, files; of a grasp worked out by hand."""

import copy
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from asymmetric import EXACT, GRIPPERS, T_INPUT_TCP, WAITING, asymmetric

from spgf_torch.errors import InputError
from spgf_torch.formats.grasps_json import read_grasps
from spgf_torch.formats.isaac import read_isaac
from spgf_torch.grasps.grasps import Grasps
from spgf_torch.grasps.saving import NAMES
from spgf_torch.hands.records import Grasp

# A quarter turn about z, then 1, 2, 3 m: (x, y, z) -> (1 - y, 2 + x, 3 + z).
T_ROBOT_INPUT = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1.0]])
JUDGE = {"folder": "somewhere", "unseen_space": True, "known": "all", "sure": 0.8}


def three(judge: dict | None = None) -> Grasps:
    """Of two types, best first."""
    of_each = asymmetric("WPG", 0.875), asymmetric("NPG", 0.5), asymmetric("WPG", 0.25)
    return Grasps(of_each, GRIPPERS, ("rim 0", "edge 1"), judge)


def test_a_sequence_that_cannot_be_changed() -> None:
    grasps = three()
    assert len(grasps) == 3 and bool(grasps) and not grasps[3:]
    assert [grasp.probability for grasp in grasps] == [0.875, 0.5, 0.25]
    assert grasps[-1] is grasps.grasps[2] and grasps[0] in grasps and grasps.index(grasps[1]) == 1
    assert isinstance(grasps[1:], Grasps) and grasps[1:].names == grasps.names and grasps[1:][0] is grasps[1]
    assert grasps == list(grasps) and list(grasps) == grasps and grasps[:0] == [] and grasps[:2] != grasps
    assert grasps == three() and grasps != three()[::-1]  # by value, though poses are arrays
    assert grasps != "three" and grasps.best is grasps[0] and grasps[:0].best is None
    with pytest.raises(IndexError):
        grasps[3]
    with pytest.raises(AttributeError):
        grasps.grasps = ()  # type: ignore[misc]
    with pytest.raises(TypeError):
        grasps[0] = grasps[1]  # type: ignore[index]


def test_some_of_them() -> None:
    grasps = three()
    assert [grasp.probability for grasp in grasps.of_type("WPG")] == [0.875, 0.25]
    assert [grasp.type for grasp in grasps.above(0.5)] == ["WPG", "NPG"] and grasps.above(0.9) == []
    with pytest.raises(InputError, match="grasp type: expected one of NPG, WPG; got 'PG'"):
        grasps.of_type("PG")
    with pytest.raises(InputError, match="probability: expected a finite number from 0 to 1, got 80"):
        grasps.above(80)


def test_the_same_grasp_in_another_frame() -> None:
    """The TCP at (0.1, 0.2, 0.3) is at (0.8, 2.1, 3.3); closing along +y becomes -x, and
    the approach (0.5, 0, c) becomes (0, 0.5, c)."""
    moved = three().transform(T_ROBOT_INPUT)
    assert len(moved) == 3 and [grasp.probability for grasp in moved] == [0.875, 0.5, 0.25]
    grasp = moved[0]
    np.testing.assert_allclose(grasp.T_input_tcp[:3, 3], [0.8, 2.1, 3.3], atol=EXACT)
    np.testing.assert_allclose(grasp.T_input_tcp[:3, [0, 2]].T, [[-1, 0, 0], [0, 0.5, 0.8660254]], atol=EXACT)
    np.testing.assert_allclose(grasp.pregrasp[:3, 3], [0.8, 2.07, 3.2480385], atol=EXACT)
    np.testing.assert_allclose(grasp.T_input_base[:3, 3], [0.8, 1.9826795, 3.1367949], atol=EXACT)
    back = moved.transform(np.linalg.inv(T_ROBOT_INPUT).tolist())
    np.testing.assert_allclose(back[0].T_input_tcp, T_INPUT_TCP, atol=EXACT)


@pytest.mark.parametrize(
    ("T", "words"),
    [
        (np.eye(3), r"T: expected a rigid pose \(4, 4\), got shape \(3, 3\)"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "T: expected a rotation"),
        (np.diag([1, 1, -1, 1]), "T: expected a rotation, got a mirrored one"),
        (np.full((4, 4), np.nan), "T: expected a finite number, got nan"),
        ("robot", r"T: expected a rigid pose \(4, 4\), got 'robot'"),
    ],
)
def test_only_rigid_frames(T: object, words: str) -> None:
    for it in (three(), three()[0]):
        with pytest.raises(InputError, match=words):
            it.transform(T)  # type: ignore[arg-type]


def test_one_grasp_says_what_a_robot_needs() -> None:
    wide, narrow = three()[:2]
    assert (wide.width, narrow.width) == (0.08, 0.04) and wide.gripper == "claw_WPG"
    np.testing.assert_allclose(wide.pregrasp[:3, 3], WAITING, atol=EXACT)


def test_a_grasp_and_its_dictionary() -> None:
    grasp = asymmetric()
    values = json.loads(json.dumps(grasp.to_dict()))
    again = Grasp.from_dict(values)
    assert np.array_equal(again.T_input_base, grasp.T_input_base) and again.to_dict() == grasp.to_dict()
    assert (again.width, again.gripper, again.joints) == (0.08, "claw_WPG", grasp.joints)
    for key, wrong, words in (
        ("width", -1, r"it\.width: expected a finite number from 0"),
        ("T_input_tcp", np.eye(3).tolist(), r"it\.T_input_tcp: expected 4 rows of a pose"),
        ("probability", 2, r"it\.probability: expected a finite number from 0 to 1, got 2"),
    ):
        with pytest.raises(InputError, match=words):
            Grasp.from_dict({**values, key: wrong}, "it")
    older = Grasp.from_dict({key: value for key, value in values.items() if key not in ("width", "gripper")})
    assert np.isnan(older.width) and not {"width", "gripper"} & older.to_dict().keys()


def test_the_dictionary_is_the_file(tmp_path: Path) -> None:
    """Whether anything is sure is said of the grasps at hand: the best holds with 0.875, without it with 0.5."""
    grasps = three(JUDGE)
    (path,) = grasps.save(tmp_path / "new/folder", "json")
    assert path == tmp_path / "new/folder/grasps.json" and json.loads(path.read_text()) == grasps.to_dict()
    assert grasps.to_dict()["judge"] == {**JUDGE, "nothing_sure": False}
    assert grasps[1:].to_dict()["judge"]["nothing_sure"] and "judge" not in three().to_dict()
    assert [grasp.to_dict() for grasp in read_grasps(path)] == grasps.to_dict()["grasps"]


def test_copies_and_other_processes_get_the_grasps() -> None:
    grasps = three(JUDGE)
    for again in (pickle.loads(pickle.dumps(grasps)), copy.deepcopy(grasps)):
        assert again.to_dict() == grasps.to_dict() and again.names == grasps.names and again.source is None


def test_every_format_by_its_name(tmp_path: Path) -> None:
    grasps = three()
    written = grasps.save(tmp_path)
    files = ["grasps.json", "isaac_grasp.yaml", "moveit_grasps.json", "graspnet.npy", "graspnet.joints.json"]
    files.append("grasps.glb")
    assert [path.name for path in written] == files and {path.name for path in tmp_path.iterdir()} == set(files)
    assert [grasp.confidence for grasp in read_isaac(written[1]).grasps] == [0.875, 0.5, 0.25]
    assert len(json.loads(written[2].read_text())["grasps"]) == 3 and len(np.load(written[3])) == 3
    assert [path.name for path in grasps.save(tmp_path / "two", ["moveit", "json", "moveit"])] == [files[2], files[0]]


def test_what_was_saved_stays_unless_it_is_to_be_replaced(tmp_path: Path) -> None:
    grasps = three()
    grasps[:1].save(tmp_path, ["moveit", "json"])
    before = (tmp_path / "grasps.json").read_bytes()
    with pytest.raises(
        InputError, match=r"folder: expected one without grasps\.json, got .*; replace=True replaces it"
    ):
        grasps.save(tmp_path, ["glb", "json"])
    assert (tmp_path / "grasps.json").read_bytes() == before and not (tmp_path / "grasps.glb").exists()
    grasps.save(tmp_path, "glb")
    with pytest.raises(InputError, match="replace: expected True or False, got 'no'"):
        grasps.save(tmp_path, replace="no")
    written = [path.name for path in grasps.save(tmp_path, replace=True)]
    assert written == [name for each, names in NAMES.items() if each != "page" for name in names]
    assert len(json.loads((tmp_path / "grasps.json").read_text())["grasps"]) == 3


def test_who_saves_learns_what_graspnet_cannot_say(tmp_path: Path) -> None:
    """Three fingers are no jaw."""
    fingers = Grasps(three().grasps, {**GRIPPERS, "NPG": replace(GRIPPERS["NPG"], jaw=False)})
    with pytest.warns(UserWarning, match=r"graspnet\.npy: 1 grasps left out"):
        (path, _) = fingers.save(tmp_path, "graspnet")
    assert len(np.load(path)) == 2
    fingers.save(tmp_path, "json")


def test_what_cannot_be_saved_is_told_and_nothing_is_written(tmp_path: Path) -> None:
    for formats, words in (
        ("issac", "got 'issac'; did you mean isaac"),
        (["json", "yaml"], "formats: expected some of json, isaac, moveit, graspnet.*; got 'yaml'"),
        ([], "got none"),
        (3, "formats: expected some of json, .*; got 3"),
        ("page", "got some without their scene"),
    ):
        with pytest.raises(InputError, match=words):
            three().save(tmp_path / "out", formats)
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="folder: expected a path, got 3"):
        three().save(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="folder: expected a folder, or none yet"):
        three().save(tmp_path / "file")
