"""The client's file: what it needs, and what it sends."""

import ast
import io
import subprocess
import sys
from email import message_from_bytes
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spgf_torch.serving import client
from spgf_torch.serving.client import Client, ServeError

FILE = Path(client.__file__)


def test_it_is_python_3_8_and_needs_the_standard_library_alone(tmp_path: Path) -> None:
    tree = ast.parse(FILE.read_text(encoding="utf-8"), feature_version=(3, 8))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= set(sys.stdlib_module_names)
    (tmp_path / "client.py").write_bytes(FILE.read_bytes())
    done = subprocess.run([sys.executable, "-IS", "client.py", "--help"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "settings of the scene" in done.stdout


@pytest.mark.parametrize(
    "values",
    [
        np.arange(6.0).reshape(2, 3),
        np.arange(12, dtype=">f4").reshape(2, 2, 3),
        np.arange(6, dtype=np.uint16).reshape(3, 2).T,
        np.array([[True, False]]),
        [[1.5, None, 3], [4, 5, 6]],
        ((1, 2, 3),),
    ],
)
def test_arrays_and_lists_become_numpy_files(values: Any) -> None:
    read = np.load(io.BytesIO(client._npy("points", values)))
    expected = np.array(values, dtype=float)
    np.testing.assert_array_equal(read, expected)
    assert read.shape == expected.shape and read.dtype.kind in "fu"


def test_whole_numbers_of_a_depth_image_and_of_labels_stay_whole() -> None:
    assert np.load(io.BytesIO(client._npy("depth", [[500, 0], [501, 2]]))).dtype == np.int32
    assert np.load(io.BytesIO(client._npy("depth", [[0.5, 0]]))).dtype == np.float32
    assert np.load(io.BytesIO(client._npy("mask", [[0, 1]], whole=True))).dtype == np.int32


@pytest.mark.parametrize("values", [[[1, 2], [3]], "points", [["a"]], 5, [[1, 2], 3]])
def test_what_is_no_array_is_refused_before_it_is_sent(values: Any) -> None:
    with pytest.raises(ValueError, match="points: expected"):
        Client().grasps(points=values)


def test_a_form_is_what_mail_readers_read() -> None:
    body, kind = client._form([("top", "3"), ("table", "[0, 0, 1, 0]")], [("input", 'a"\r\nb.ply', b"\r\n--x\0")])
    message = message_from_bytes(f"Content-Type: {kind}\r\n\r\n".encode() + body)
    parts: Any = message.get_payload()
    named = [part.get_param("name", header="content-disposition") for part in parts]
    assert named == ["top", "table", "input"]
    assert [part.get_payload(decode=True) for part in parts] == [b"3", b"[0, 0, 1, 0]", b"\r\n--x\0"]
    assert parts[2].get_filename() == "a___b.ply"


def test_one_kind_of_input_is_asked_for() -> None:
    for given in ({}, {"points": [[0, 0, 0]], "file": "x"}):
        with pytest.raises(ValueError, match=r"expected one of points, depth and file, got (none|points and file)"):
            Client().grasps(**given)


def test_nobody_there_and_no_file_are_told() -> None:
    with pytest.raises(
        ServeError, match=r"127\.0\.0\.1:9: expected an answer of spgf serve, got Connection refused; is it there"
    ) as told:
        Client("http://127.0.0.1:9/", timeout=5).health()
    assert told.value.status is None and told.value.retry_after is None
    with pytest.raises(ServeError, match=r"missing\.ply: expected a file, got No such file") as told:
        Client().grasps(file="missing.ply")
    assert told.value.status == 400


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"points": [[0, 0, 0]], "top": {1}}, "top: expected numbers or words, got set"),
        ({"points": [[1, 2], [3, [4]]]}, "points: expected numbers in rows of one length, got "),
        ({"depth": [[1, 2]], "mask": [[0.5, 1]]}, "mask: expected whole numbers in rows of one length, got "),
        ({"depth": [[1, 2]], "T_input_camera": {1}}, "T_input_camera: expected numbers or words, got dict"),
        ({"points": [[0, 0, 0]], "normals": [[{1}, 0, 0]]}, "points: expected numbers or words, got dict"),
        ({"file": 3}, "input: expected the path of a file, got int"),
    ],
)
def test_what_cannot_be_sent_is_one_line(given: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=line) as told:
        Client("http://127.0.0.1:9").grasps(**given)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("words", "files", "settings"),
    [
        ("a.ply --viewpoint 1 -2 .3 --top 3", ["a.ply"], {"viewpoint": [1, -2, 0.3], "top": "3"}),
        ("--viewpoint 1,-2,.3 a.ply", ["a.ply"], {"viewpoint": [1, -2, 0.3]}),
        ("--viewpoint=1,2,3 --table find a.ply b.ply", ["a.ply", "b.ply"], {"viewpoint": [1, 2, 3], "table": "find"}),
        ("a.ply --viewpoint 1 2 3 --viewpoint 4 5 6", ["a.ply"], {"viewpoint": [[1, 2, 3], [4, 5, 6]]}),
        ("d.png --intrinsics 130 131 60 45", ["d.png"], {"intrinsics": [130, 131, 60, 45]}),
        ("d.png --K K.txt --crop-low [0,0,0]", ["d.png"], {"K": "K.txt", "crop_low": "[0,0,0]"}),
        ("a.ply --types NPG,WPG", ["a.ply"], {"types": "NPG,WPG"}),
    ],
)
def test_its_command_takes_rows_of_numbers_as_the_package_does(
    words: str, files: list[str], settings: dict[str, Any]
) -> None:
    assert client._asked_for(words.split()) == (files, settings)


@pytest.mark.parametrize(
    ("words", "status", "line"),
    [
        ("a.ply --viewpoint a b c", 2, "client: --viewpoint: expected 3 numbers after it, got a b c"),
        ("a.ply --viewpoint 1 2 --top 3", 2, "client: --viewpoint: expected 3 numbers after it, got 1 2"),
        ("a.ply --top", 2, "client: --top: expected a value after it, got none"),
        ("a.ply --top --table find", 2, "client: --top: expected a value after it, got --table"),
        ("a.ply --top 3 --top 4", 2, "client: --top: expected one value, got 3 and 4"),
        ("--top 3", 2, "client: expected a file with --top, got none"),
        ("a.ply --points x", 2, "client: --points: expected files as words"),
        ("gone.ply", 2, "client: gone.ply: expected a file, got No such file or directory"),
        ("a.ply --timeout soon", 2, "client: argument --timeout: invalid float value: 'soon'"),
        ("--url 127.0.0.1:8000", 2, "client: url: expected http://HOST:PORT, got '127.0.0.1:8000'"),
        ("--url http://127.0.0.1:9", 1, "client: http://127.0.0.1:9: expected an answer of spgf serve"),
    ],
)
def test_its_command_says_in_one_line_what_is_wrong(
    words: str, status: int, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["client.py", *words.split()])
    try:
        left: Any = client.main()
    except SystemExit as end:
        left = end.code
    told = capsys.readouterr()
    assert left == status and told.err.startswith(line) and told.err.count("\n") == 1 and not told.out
