"""Files that are torn, foreign, wrong or hostile: one line of InputError, and nothing happens."""

import io
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from asymmetric import GRIPPERS, asymmetric

from spgf_torch.errors import InputError
from spgf_torch.formats.graspnet import joints_path, read_graspnet, read_row_joints, write_graspnet
from spgf_torch.formats.grasps_json import read_grasps, write_grasps
from spgf_torch.formats.isaac import read_isaac, write_isaac

READERS: dict[str, Callable[[Path], Any]] = {
    "grasps.json": read_grasps,
    "grasps.yaml": read_isaac,
    "grasps.npy": read_graspnet,
    "grasps.joints.json": read_row_joints,
}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    grasps = [asymmetric(), asymmetric("NPG", 0.25)]
    write_grasps(folder / "grasps.json", grasps, GRIPPERS)
    write_isaac(folder / "grasps.yaml", grasps, GRIPPERS)
    write_graspnet(folder / "grasps.npy", grasps, GRIPPERS)
    assert joints_path(folder / "grasps.npy").name == "grasps.joints.json"
    return folder


def refused(name: str, path: Path, *words: str) -> None:
    with pytest.raises(InputError) as told:
        READERS[name](path)
    message = str(told.value)
    assert "\n" not in message and len(message) < 500 and str(path) in message, message
    assert all(word in message for word in ("expected", "got", *words)), message


@pytest.mark.parametrize("name", READERS)
def test_missing_folder_empty_and_foreign(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    refused(name, path, "no such file")
    refused(name, tmp_path, "folder")
    for content in (
        b"",
        b"\x89PNG\r\n\x1a\n\x00\xff",
        b"hello",
        b"[1, 2]",
        b"null",
        b"{}",
        b"[" * 700,
        b"\x80\x04.",
    ):
        path.write_bytes(content)
        refused(name, path)


@pytest.mark.parametrize("name", READERS)
def test_cut_off_anywhere(name: str, written: Path, tmp_path: Path) -> None:
    """The one cut that nobody can see is that between two grasps of the YAML, which has no end and no count."""
    whole = (written / name).read_bytes()
    seam = whole.find(b"  grasp_1:") if name.endswith("yaml") else -1
    path = tmp_path / name
    for length in {len(whole) // 2, *range(0, len(whole) - 2, max(1, len(whole) // 60))} - {seam, seam - 1}:
        path.write_bytes(whole[:length])
        refused(name, path)


CHANGES: list[tuple[str, Any]] = [
    ("probability", 1.5),
    ("probability", float("nan")),
    ("probability", True),
    ("probability", "0.5"),
    ("support", -1),
    ("support", 2.5),
    ("type", "../NPG"),
    ("type", ["NPG"]),
    ("T_input_tcp", np.zeros((4, 4)).tolist()),
    ("T_input_tcp", np.diag([1, 1, -1, 1]).tolist()),
    ("T_input_tcp", np.full((4, 4), np.nan).tolist()),
    ("T_input_tcp", np.eye(3).tolist()),
    ("T_input_base", (2 * np.eye(4)).tolist()),
    ("T_input_pregrasp", [[1, 0, 0, 10**400], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    ("T_input_pregrasp", np.vstack([np.eye(3, 4), [[0, 0, 1, 1]]]).tolist()),
    ("joints", [1, 2]),
    ("joints", {"../../etc": 0.0}),
    ("closed", {"left": None}),
    ("voted_by", [3]),
    ("voted_by", [{"prototype": 1}]),
]


@pytest.mark.parametrize(("key", "value"), CHANGES)
def test_wrong_values_in_grasps_json(key: str, value: Any, written: Path, tmp_path: Path) -> None:
    known = json.loads((written / "grasps.json").read_text())
    known["grasps"][1][key] = value
    path = tmp_path / "grasps.json"
    path.write_text(json.dumps(known))
    refused("grasps.json", path, f"grasps[1].{key}")


@pytest.mark.parametrize(("key", "value"), [("schema", 2), ("frame", "camera"), ("grasps", {})])
def test_another_schema_or_frame(key: str, value: Any, written: Path, tmp_path: Path) -> None:
    path = tmp_path / "grasps.json"
    path.write_text(json.dumps({**json.loads((written / "grasps.json").read_text()), key: value}))
    refused("grasps.json", path, key)


ISAAC: list[tuple[str, Any]] = [
    ("confidence", 2),
    ("confidence", float("nan")),
    ("position", [0, 0]),
    ("position", [0, 0, float("inf")]),
    ("orientation", {"w": 1.0, "xyz": [1, 0, 0]}),
    ("orientation", {"w": 0.0, "xyz": [0, 0, 0]}),
    ("orientation", [1, 0, 0, 0]),
    ("cspace_position", {"left": 0.0}),
    ("cspace_position", {3: 0.0}),
]


@pytest.mark.parametrize(("key", "value"), ISAAC)
def test_wrong_values_in_isaac(key: str, value: Any, written: Path, tmp_path: Path) -> None:
    known = yaml.safe_load((written / "grasps.yaml").read_text())
    known["grasps"]["grasp_1"][key] = value
    path = tmp_path / "grasps.yaml"
    path.write_text(yaml.safe_dump(known))
    refused("grasps.yaml", path, "grasp_1")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("format: isaac_grasp", "format: graspgen"),
        ("format_version: 1.0", "format_version: 2.0"),
        ("format_version: 1.0", "format_version: true"),
        ("grasp_1:", "../../grasp:"),
        ("gripper_frame_link: palm", "gripper_frame_link: ../palm"),
        ("gripper_frame_link: palm", "gripper_frame_link: <script>"),
        ("confidence: 0.25", "confidence: !!timestamp x"),
        ("confidence: 0.25", "confidence: &a [*a]"),
    ],
)
def test_hostile_or_foreign_yaml(old: str, new: str, written: Path, tmp_path: Path) -> None:
    text = (written / "grasps.yaml").read_text()
    assert old in text
    path = tmp_path / "grasps.yaml"
    path.write_text(text.replace(old, new))
    refused("grasps.yaml", path)


def test_yaml_tags_make_no_objects(written: Path, tmp_path: Path) -> None:
    ran = tmp_path / "ran"
    text = (written / "grasps.yaml").read_text()
    tag = f"!!python/object/apply:os.system ['touch {ran}']"
    path = tmp_path / "grasps.yaml"
    path.write_text(text.replace("confidence: 0.25", f"confidence: {tag}"))
    refused("grasps.yaml", path, "python/object")
    assert not ran.exists()


def rows() -> np.ndarray:
    row = np.zeros((2, 17))
    row[:, 4:13] = np.eye(3).ravel()
    return row


def changed(column: int, value: float) -> np.ndarray:
    array = rows()
    array[1, column] = value
    return array


@pytest.mark.parametrize(
    "array",
    [
        rows()[:, :16],
        rows()[0],
        rows().astype(int),
        rows().astype(complex),
        changed(0, np.nan),
        changed(14, np.inf),
        changed(1, -0.1),
        changed(4, -1),
        changed(4, 0.5),
        changed(4, 1e200),
    ],
)
def test_wrong_arrays(array: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "grasps.npy"
    np.save(path, array)
    refused("grasps.npy", path)


def test_pickles_and_archives_stay_closed(tmp_path: Path) -> None:
    path = tmp_path / "grasps.npy"
    path.write_bytes(pickle.dumps(rows()))
    refused("grasps.npy", path)
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    refused("grasps.npy", path, "Python objects")
    archive = io.BytesIO()
    np.savez(archive, rows())
    path.write_bytes(archive.getvalue())
    refused("grasps.npy", path, "numpy")


def test_a_header_that_promises_more_than_there_is(tmp_path: Path) -> None:
    path = tmp_path / "grasps.npy"
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f8", "fortran_order": False, "shape": (2_000_000_000, 17)}
        )
        file.write(rows().tobytes())
    refused("grasps.npy", path)
