"""`spgf serve` in a process of its own with a shipped judge: answers, clients at once, hostile bodies, crashes."""

import io
import json
import os
import pickle
import shlex
import shutil
import signal
import socket
import struct
import subprocess
import time
import zipfile
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import ROOT, call
from PIL import Image
from serving_machines import Running, Told, serving

import spgf_torch
from spgf_torch.drawing.grasp_beside import model_words
from spgf_torch.sensing.cameras import Camera, cast, look_at
from spgf_torch.serving.client import Client, ServeError
from spgf_torch.serving.predicting import identity

LIMITS = ("largest_mb=4", "body_seconds=20", "wait_seconds=120", "seconds=60", "kept=1", "max_points=200000")
TABLE = [0.0, 0.0, 1.0, 0.0]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with serving(tmp_path_factory.mktemp("serving"), *LIMITS) as running:
        yield running


@pytest.fixture(scope="module")
def client(server: Running) -> Client:
    return Client(server.url)


@pytest.fixture(scope="module")
def seen() -> tuple[np.ndarray, Camera]:
    """Depth (H, W), m, of a box 40 x 60 x 80 mm on a table, from 0.5 m away, 40 deg up."""
    box = trimesh.creation.box((0.04, 0.06, 0.08)).apply_translation((0, 0, 0.04))
    table = trimesh.creation.box((0.3, 0.25, 0.001)).apply_translation((0, 0, -0.0005))
    K = np.array([[130.0, 0, 60], [0, 130, 45], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0.38, 0.1, 0.36]), np.array([0, 0, 0.03])), 120, 90)
    return cast(trimesh.util.concatenate([box, table]), camera)[0], camera


@pytest.fixture(scope="module")
def cloud(seen: tuple[np.ndarray, Camera]) -> np.ndarray:
    """(N, 3) float32, the same as points on and above the table's plane z = 0."""
    depth, camera = seen
    T = camera.T_object_camera
    return ((camera.rays() * depth[..., None])[depth > 0] @ T[:3, :3].T + T[:3, 3]).astype(np.float32)


EYE = (0.38, 0.1, 0.36)


def npy(array: np.ndarray) -> bytes:
    np.save(stream := io.BytesIO(), array)
    return stream.getvalue()


def asked(server: Running, body: Any, query: str = "", kind: str = "application/x-npy") -> Told:
    return server.ask("POST", f"/grasps{query}", body, Content_Type=kind)


def test_grasps_are_those_of_the_library(
    server: Running, client: Client, cloud: np.ndarray, seen: tuple[np.ndarray, Camera]
) -> None:
    """Of a raw body, of a form, of JSON and of a file; and of a depth image with its camera."""
    model = spgf_torch.load("panda")  # by its name, the server by its folder
    assert identity(model) == client.health()["model"] and len(identity(model)["digest"]) == 4
    scene = spgf_torch.Scene.from_points(cloud, EYE, sensing=model.sensing, table=TABLE)
    expected = model.predict(scene, 2).to_dict()
    raw = asked(server, npy(cloud), f"?viewpoint={','.join(map(str, EYE))}&table=0,0,1,0&top=2").json
    answers = [raw, client.grasps(points=cloud, viewpoint=EYE, table=TABLE, top=2)]
    answers += [client.grasps(points=cloud.tolist(), viewpoint=EYE, table=TABLE, top=2)]
    values = {"points": cloud.tolist(), "viewpoint": EYE, "table": TABLE, "top": 2}
    answers += [asked(server, json.dumps(values), kind="application/json").json]
    assert len(expected["grasps"]) == 4
    for answer in answers:
        assert answer["grasps"] == expected["grasps"] and answer["base_link"] == "panda_hand"
        assert answer["texlets"] == len(scene.texlets) and answer["judge"]["folder"] == "panda"
    depth, camera = seen
    of_depth = spgf_torch.Scene.from_depth(depth, camera.K, camera.T_object_camera, sensing=model.sensing, table="find")
    answer = client.grasps(depth=depth, K=camera.K, T_input_camera=camera.T_object_camera, table="find", types="WPG")
    wanted = [grasp.to_dict() for grasp in model.predict(of_depth, 10).of_type("WPG")]
    assert answer["grasps"] == wanted and wanted
    assert set(answer["model"]["types"]) == {"NPG", "WPG"} and answer["model"]["hand"] == "panda"


def test_files_and_a_mask(client: Client, cloud: np.ndarray, tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.03, 0.05, 0.07))
    mesh.export(tmp_path / "box.stl")
    assert client.grasps(file=tmp_path / "box.stl", mesh="whole", top=1)["grasps"]
    np.save(tmp_path / "cloud.npy", cloud)
    np.save(tmp_path / "mask.npy", (cloud[:, 2] > 0.002).astype(np.uint8))
    options = {"viewpoint": EYE, "table": "find", "top": 1}
    files = client.grasps(file=str(tmp_path / "cloud.npy"), mask=tmp_path / "mask.npy", **options)
    arrays = client.grasps(points=cloud, mask=cloud[:, 2] > 0.002, **options)
    assert files["grasps"] == arrays["grasps"] != []
    assert all("/tmp" not in note and "spgf_serve" not in note for note in files["notes"])


def test_eight_clients_at_once_get_what_one_gets(server: Running, client: Client, cloud: np.ndarray) -> None:
    """Eight requests on four clouds, by eight threads."""
    clouds = [cloud + np.float32([0.01 * i, 0, 0]) for i in range(4)]

    def grasps(i: int) -> Any:
        return client.grasps(points=clouds[i % 4], viewpoint=EYE, table="find", top=2)["grasps"]

    alone = [grasps(i) for i in range(4)]
    assert all(alone) and len({json.dumps(each) for each in alone}) == 4
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(grasps, range(8)))
    assert all(each == alone[i % 4] for i, each in enumerate(together))


def test_the_page_of_a_result_as_long_as_it_is_kept(server: Running, client: Client, cloud: np.ndarray) -> None:
    first, last = (client.grasps(points=cloud, viewpoint=EYE, table="find", top=1) for _ in range(2))
    gone = server.ask("GET", first["page"])
    assert gone.status == 404
    assert gone.json["error"] == "expected one of the latest 1 results (kept), got none of this name"
    page = server.ask("GET", last["page"])
    assert page.status == 200 and page.headers["content-type"].startswith("text/html") and b"WPG" in page.body
    assert b"<title>Grasps for points.npy</title>" in page.body and b"<dt>date</dt>" in page.body
    assert f"<dt>model</dt><dd>{model_words(ROOT / 'data/models/panda')}</dd>".encode() in page.body
    assert b"spgf_serve" not in page.body and server.ask("GET", "/health").json["last"] == last["id"]
    assert client.page(last) == f"{server.url}{last['page']}"


def ply(count: int, points: np.ndarray) -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    return head.encode() + points.astype("<f4").tobytes()


def bomb() -> bytes:
    """A .npz file of a megabyte that would unpack to a gigabyte."""
    head = npy(np.zeros((1, 3), np.float32))[:128].replace(b"(1, 3), }      ", b"(99999999, 3), }")[:128]
    with zipfile.ZipFile(stream := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", head + bytes(12 * 2_000_000))
    return stream.getvalue()


def large_png(side: int) -> bytes:
    """`side` x `side` pixels of 16 bits by what its head says."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )


def hostile() -> list[tuple[str, bytes, str, str]]:
    """Name, body, query, and a part of the answer."""
    points = np.random.default_rng(0).normal(size=(100, 3))
    pixels = "?intrinsics=100,100,50,50"
    return [
        ("cut", ply(200, points), "", "body: expected"),
        ("nan", npy(np.full((100, 3), np.nan)), "", "body: expected"),
        (
            "shape",
            npy(points[:, :2]),
            "",
            "body: points: expected shape (N, 3), (N, 6) or (H, W, 3), got (100, 2)",
        ),
        ("objects", npy(np.array([{}, None])), "", "body: expected arrays of numbers, got pickled Python objects"),
        ("pickle", pickle.dumps([1]), "", "body: expected"),
        ("zip", bomb(), "", "body: "),
        ("png", large_png(1000), pixels, "body: expected at most 200000 pixels (max_points), got 1000 x 1000"),
        ("larger png", large_png(100_000), pixels, "could be decompression bomb"),
        ("nested", b'{"points":' + b"[" * 100_000 + b"]" * 100_000 + b"}", "", "expected a JSON object"),
        ("words", b'{"points": [["a", "b", "c"]]}', "", "points: expected numbers in rows of one length"),
        ("huge", b'{"points": [[1e999, 0, 0], [0, 0, 0], [1, 2, 3]]}', "", "points: expected"),
        ("key", b'{"points": [[1, 2, 3]], "mask": "/etc/passwd"}', "", "mask: expected"),
        ("file", b'{"points": [[1, 2, 3]], "poses": "/etc/passwd"}', "", "poses: expected a file in the request"),
        (
            "twice",
            b'{"points": [[1, 2, 3]], "viewpoint": [0, 0, 0]}',
            "?viewpoint=9,9,9",
            "viewpoints: expected one value, got one in the address and one in the body",
        ),
        (
            "both",
            b'{"points": [[1, 2, 3]], "viewpoint": [0, 0, 0], "viewpoints": [[9, 9, 9]]}',
            "",
            "viewpoints: expected one value, got several",
        ),
        ("environment", npy(points), "?table=${oc.env:PATH}", "table: expected a plain value"),
        ("many", npy(np.ones((200_001, 3), np.float16)), "", "body: expected at most 200000 points (max_points)"),
        ("more", npy(points), "?max_points=300000", "max_points: expected a whole number up to 200000, got 300000"),
        ("top", npy(points + 5), "?top=0", "top: expected a whole number from 1"),
        ("types", npy(points), "?types=XYZ", "types: expected some of NPG, WPG; got 'XYZ'"),
        ("voxel", npy(points), "?voxel=7", "voxel: expected a number from 0.0005 to 0.05, got 7"),
    ]


@pytest.mark.parametrize(("body", "query", "words"), [pytest.param(*rest, id=name) for name, *rest in hostile()])
def test_what_cannot_be_used_is_one_line(server: Running, body: bytes, query: str, words: str) -> None:
    told = server.ask("POST", f"/grasps{query}", body)
    line = told.json["error"]
    assert told.status in (400, 415) and words in line, line
    assert list(told.json) == ["error"] and len(line) <= 1000 and line.isprintable()
    assert "Traceback" not in line and "spgf_serve" not in line and "/etc" not in line.replace("/etc/passwd", "")


def test_of_a_files_name_the_suffix_alone_counts(server: Running, cloud: np.ndarray, tmp_path: Path) -> None:
    mark = b"--m\r\nContent-Disposition: form-data; name=%b\r\n\r\n%b\r\n"
    name = b'"input"; filename="../../../../tmp/escaped.npy"'
    sent = mark % (b'"table"', b"find") + mark % (b'"top"', b"1") + mark % (name, npy(cloud)) + b"--m--\r\n"
    told = asked(server, sent, "?viewpoint=0.38,0.1,0.36", "multipart/form-data; boundary=m")
    assert told.status == 200 and told.json["grasps"] and not Path("/tmp/escaped.npy").exists()
    nothing = mark % (name, npy(np.full((9, 3), np.nan))) + b"--m--\r\n"
    told = asked(server, nothing, "", "multipart/form-data; boundary=m")
    assert told.status == 400 and told.json["error"].startswith("escaped.npy: expected points, got none")
    told = asked(
        server, mark % (b'"model"; filename="a.npy"', npy(cloud)) + b"--m--\r\n", "", "multipart/form-data; boundary=m"
    )
    assert told.status == 400 and told.json["error"].startswith("model: expected a file as one of input, intrinsics")


def test_a_cut_connection_leaves_nothing_behind(server: Running) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as own:
        own.sendall(b"POST /grasps HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n" + bytes(5000))
        until(lambda: server.ask("GET", "/health").json["in_flight"] == 1)
        assert server.left()
    until(lambda: server.ask("GET", "/health").json["in_flight"] == 0)
    assert not server.left()


def until(holds: Any) -> None:
    for _ in range(300):
        if holds():
            return
        time.sleep(0.05)
    raise AssertionError


def test_the_client_tells_what_is_wrong(server: Running, client: Client, tmp_path: Path) -> None:
    with pytest.raises(ServeError, match=r"^voxel: expected a number from 0\.0005 to 0\.05, got 7\.0$") as told:
        client.grasps(points=[[0, 0, 1], [0, 1, 0]], voxel=7)
    assert told.value.status == 400 and client.health()["model"]["name"] == "panda"
    np.save(tmp_path / "few.npy", np.ones((2, 3)))
    file = ROOT / "spgf_torch/serving/client.py"
    done = subprocess.run(
        ["python3", "-S", str(file), "few.npy", "--url", server.url, "--voxel", "7"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (2, "client: voxel: expected a number from 0.0005 to 0.05, got 7.0\n")


@pytest.mark.skipif(shutil.which("curl") is None, reason="no curl here")
def test_the_commands_of_the_how_to_are_answered(
    server: Running, cloud: np.ndarray, seen: tuple[np.ndarray, Camera], tmp_path: Path
) -> None:
    depth, camera = seen
    (tmp_path / "mug.ply").write_bytes(ply(len(cloud), cloud))
    np.save(tmp_path / "mug.npy", cloud)
    Image.fromarray((1000 * depth).round().astype(np.uint16)).save(tmp_path / "depth.png")
    Image.fromarray((depth < np.median(depth[depth > 0])).astype(np.uint8)).save(tmp_path / "mask.png")
    np.savetxt(tmp_path / "K.txt", camera.K)
    trimesh.creation.box((0.03, 0.05, 0.07)).export(tmp_path / "box.stl")
    values = {"points": cloud.tolist(), "viewpoint": EYE, "table": "find"}
    (tmp_path / "points.json").write_text(json.dumps(values))
    page = (ROOT / "docs/howto/serve.md").read_text(encoding="utf-8")
    lines = [line for line in page.splitlines() if line.startswith("curl ")]
    assert len(lines) == 6
    for line in lines:
        words = shlex.split(line.replace("http://127.0.0.1:8000", server.url))
        done = subprocess.run([*words, "--silent"], cwd=tmp_path, capture_output=True, text=True, timeout=100)
        assert json.loads(done.stdout).get("grasps"), (line, done.stdout)


def test_a_port_in_use_is_told(server: Running, tmp_path: Path) -> None:
    done = call("serve", f"port={server.port}", f"model={ROOT / 'data/models/panda'}", cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.startswith(
        f"serve: port: expected a free one of 127.0.0.1, got {server.port}"
    )
    assert len(done.stderr.splitlines()) == 1 and not list(tmp_path.rglob("*.yaml"))


def test_a_prediction_that_crashes_is_told_and_the_server_goes_on(
    server: Running, client: Client, cloud: np.ndarray
) -> None:
    """The predicting process is killed between two requests: the next is told, and after a while all is well."""
    threads = Path(f"/proc/{server.process.pid}/task").glob("*/children")
    children = sorted({word for each in threads for word in each.read_text().split()})
    assert len(children) == 1
    os.kill(int(children[0]), signal.SIGKILL)
    with pytest.raises(ServeError, match=r"its process died \(signal SIGKILL\); it is started anew") as told:
        client.grasps(points=cloud, viewpoint=EYE, table="find", top=1)
    assert told.value.status == 500
    with pytest.raises(ServeError, match="the model is being loaded") as told:
        client.grasps(points=cloud, viewpoint=EYE, table="find", top=1)
    assert told.value.status == 503 and told.value.retry_after == 2
    server.until_ready()
    assert client.grasps(points=cloud, viewpoint=EYE, table="find", top=1)["grasps"]
