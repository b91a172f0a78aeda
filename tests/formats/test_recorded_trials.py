"""Tables of recorded trials: every form of a pose is the same pose, and what is wrong is named by row and column."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from scipy.spatial.transform import Rotation

from spgf_torch.errors import InputError
from spgf_torch.formats.recorded_trials import RecordedTable, read_recorded
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.records import grippers_of
from spgf_torch.settings import settings

# A quarter turn about x, then 30 deg about z: no axis, no sign and no order of w can be taken for another.
TURN = Rotation.from_euler("xz", [90, 30], degrees=True)
QUATERNION = dict(zip(("qx", "qy", "qz", "qw"), TURN.as_quat().tolist(), strict=True))
PLACE = {"x": 0.01, "y": -0.02, "z": 0.13}
ROW = {"object": "mug", "type": "WPG", **PLACE, **QUATERNION, "success": 1}


@cache
def hand() -> Hand:
    return load_hand(settings(HandConfig))


def written(path: Path, rows: list[dict[str, Any]]) -> Path:
    names = list(dict.fromkeys(name for row in rows for name in row))
    lines = [",".join(names), *(",".join(str(row.get(name, "")) for name in names) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read(folder: Path, *rows: dict[str, Any]) -> RecordedTable:
    return read_recorded(written(folder / "mine.csv", list(rows)), hand())


def expected() -> torch.Tensor:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = TURN.as_matrix(), list(PLACE.values())
    return torch.from_numpy(T)


def test_a_pose_in_each_of_its_forms(tmp_path: Path) -> None:
    T = expected()
    matrix = {f"t{r}{c}": float(T[r, c]) for r in range(3) for c in range(4)}
    base = T.numpy() @ np.linalg.inv(grippers_of(hand())["WPG"].T_base_tcp)
    turned = Rotation.from_matrix(base[:3, :3]).as_quat().tolist()
    of_base = {**dict(zip("xyz", base[:3, 3].tolist(), strict=True)), "frame": "base"}
    of_base |= dict(zip(("qx", "qy", "qz", "qw"), turned, strict=True))
    forms = [ROW, {key: ROW[key] for key in ("object", "type", "success")} | matrix, {**ROW, **of_base}]
    for row in forms:
        ((_, trials),) = read(tmp_path, row).views
        assert torch.allclose(trials.T_object_tcp[0].double(), T, atol=1e-6), row
        assert trials.grasp_types[int(trials.grasp_type[0])] == "WPG" and trials.success.tolist() == [True]


def test_columns_in_any_order_and_case_and_words_for_outcomes(tmp_path: Path) -> None:
    rows = [{name.upper(): value for name, value in reversed(ROW.items())} | {"note": k} for k in range(4)]
    for row, outcome in zip(rows, ("True", "false", "0", " 1 "), strict=True):
        row["SUCCESS"] = outcome
    table = read(tmp_path, *rows)
    assert table.views[0][1].success.tolist() == [True, False, False, True] and table.ignored == ("note",)
    (tmp_path / "marked.csv").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "mine.csv").read_bytes())  # as Excel writes it
    assert len(read_recorded(tmp_path / "marked.csv", hand()).views[0][1]) == 4


def test_parquet_with_numbers_booleans_and_nulls(tmp_path: Path) -> None:
    rows = [{**ROW, "success": success, "cloud": None} for success in (True, False)]
    pq.write_table(pa.Table.from_pylist(rows), tmp_path / "mine.parquet")
    ((recording, trials),) = read_recorded(tmp_path / "mine.parquet", hand()).views
    assert trials.success.tolist() == [True, False] and recording.cloud is None


def test_trials_are_gathered_by_object_and_cloud(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / f"{name}.pcd").touch()
    seen = [("pan", "b"), ("mug", "a"), ("pan", "a"), ("pan", "b")]
    rows = [
        {**ROW, "object": name, "cloud": f"{file}.pcd", "view_x": 1, "view_y": 2, "view_z": 3, "class": "container"}
        for name, file in seen
    ]
    found = [(its.object_name, its.cloud, trials.rows) for its, trials in read(tmp_path, *rows).views]
    assert found == [
        ("mug", tmp_path / "a.pcd", (2,)), ("pan", tmp_path / "b.pcd", (1, 4)), ("pan", tmp_path / "a.pcd", (3,)),
    ]  # fmt: skip
    its = read(tmp_path, *rows).views[0][0]
    assert its.viewpoint == (1.0, 2.0, 3.0) and its.category == "containers"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"qx": "abc"}, "row 2: qx: expected a finite number, got 'abc'"),
        ({"y": ""}, "row 2: y: expected a finite number, got nothing"),
        ({"z": "inf"}, "row 2: z: expected a finite number, got 'inf'"),
        ({"qw": 2}, "row 2: qw: expected a quaternion of length 1, got 2."),
        ({"success": "maybe"}, "row 2: success: expected 1 or 0, got 'maybe'"),
        ({"success": ""}, "row 2: success: expected 1 or 0, got nothing"),
        ({"success": 0.5}, "row 2: success: expected 1 or 0, got '0.5'"),
        ({"type": "pinch"}, "row 2: type: expected one of NPG, WPG, got 'pinch'"),
        ({"type": ""}, "row 2: type: expected one of NPG, WPG, got nothing"),
        ({"object": "../mug"}, "row 2: object: expected letters, digits, _ and -, got '../mug'"),
        ({"object": ""}, "row 2: object: expected the name of an object, got nothing"),
        ({"frame": "wrist"}, "row 2: frame: expected tcp or base, got 'wrist'"),
        ({"class": "mug"}, "row 2: class: expected one of container, box, curved, got 'mug'"),
        ({"view_x": 1}, "row 2: view_y: expected a finite number, got nothing"),
        ({"cloud": "mine.csv"}, "row 2: cloud: expected none, as in row 1, got 'mine.csv'"),
        ({"x": 130}, "row 2: x: expected metres, 10 at most, got '130'"),
    ],
)
def test_a_bad_value_is_named_by_row_and_column(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, ROW, {**ROW, **change})
    assert str(error.value).startswith(f"{tmp_path / 'mine.csv'}: {words}") and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            "a,b\n1,2\n",
            "expected a table of recorded trials with the columns object, success, x, y, z, qw, qx, qy, qz "
            "(or t00 to t23); got none of them",
        ),
        ("object,success,type,x,y,z,qw,qx,qy,qz\n", "expected a table of recorded trials, got no row"),
        ("object,x,X,success\n", "expected each column once, got x twice"),
        ("object,success\nmug\n", "row 1: expected 2 values, got 1"),
        ('object,success\n"mug,1\n', "expected a table of recorded trials, got"),
    ],
)
def test_what_is_no_table_is_told(content: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text(content)
    with pytest.raises(InputError) as error:
        read_recorded(tmp_path / "mine.csv", hand())
    assert str(error.value).startswith(f"{tmp_path / 'mine.csv'}: {words}") and "\n" not in str(error.value)


def test_two_poses_a_row_and_one_that_is_no_rotation(tmp_path: Path) -> None:
    matrix = {f"t{r}{c}": float(r == c) for r in range(3) for c in range(4)}
    with pytest.raises(InputError, match=r"mine\.csv: expected one pose a row, got a quaternion and a matrix$"):
        read(tmp_path, {**ROW, **matrix})
    bare = {key: ROW[key] for key in ("object", "type", "success")}
    with pytest.raises(InputError, match=r"mine\.csv: row 1: t00: expected a rotation, got "):
        read(tmp_path, {**bare, **matrix, "t00": 0.5})
