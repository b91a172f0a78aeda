"""Limits of the server, by sockets, with nothing behind it that predicts."""

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from serving_machines import Alone, alone

from spgf_torch.simulation.worker_process import WorkerDiedError

LIMITS = {
    "largest_mb": 0.1,
    "head_seconds": 1.0,
    "body_seconds": 0.5,
    "wait_seconds": 0.5,
    "at_once": 2,
    "connections": 6,
    "seconds": 7.0,
    "quiet": False,
}
NPY = {"Content_Type": "application/x-npy"}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Alone]:
    with alone(tmp_path_factory.mktemp("requests"), **LIMITS) as running:
        yield running
        assert not list(running.folder.iterdir())


@pytest.fixture(autouse=True)
def nothing_special(server: Alone) -> None:
    server.process.does = lambda: None


def talk(server: Alone, *parts: bytes, pause: float = 0.0) -> bytes:
    """Send bytes as they are, with pauses, and read until the server closes."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as own:
        try:
            for part in parts:
                own.sendall(part)
                time.sleep(pause)
        except ConnectionError:
            pass
        return b"".join(iter(lambda: received(own), b""))


def received(own: socket.socket) -> bytes:
    try:
        return own.recv(65536)
    except ConnectionError:
        return b""


HEAD = b"POST /grasps HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/x-npy\r\n"


def status(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def test_a_body_is_taken_whole_and_answered(server: Alone) -> None:
    told = server.ask("POST", "/grasps", b"\x93NUMPY", **NPY)
    assert (told.status, told.body) == (200, b"{}")
    assert told.headers["x-content-type-options"] == "nosniff" and told.headers["connection"] == "close"


def test_a_body_too_large_is_413_also_where_it_does_not_say_how_large(server: Alone) -> None:
    told = server.ask("POST", "/grasps", b"x" * 100_001, **NPY)
    assert told.status == 413 and told.json["error"] == "body: expected at most 100000 bytes (largest_mb), got more"
    told = server.ask("POST", "/grasps", iter([b"x" * 60_000] * 2), **NPY)
    assert told.status == 413
    form = b'--m\r\nContent-Disposition: form-data; name="input"; filename="a.npy"\r\n\r\n' + b"x" * 100_000
    told = server.ask("POST", "/grasps", form + b"\r\n--m--\r\n", Content_Type="multipart/form-data; boundary=m")
    assert told.status == 413
    assert server.ask("POST", "/grasps", b"x" * 100_000, **NPY).status == 200


def test_a_body_that_does_not_come_is_408(server: Alone) -> None:
    answer = talk(server, HEAD + b"Content-Length: 1000\r\n\r\nx", pause=0.1)
    assert status(answer) == 408 and b"expected all of it within 0.5 s, got 1 bytes" in answer


def test_a_head_that_does_not_come_is_closed(server: Alone) -> None:
    start = time.monotonic()
    assert talk(server, HEAD[:30]) == b"" and talk(server) == b""
    assert time.monotonic() - start < 10


def test_a_head_too_long_and_no_http_are_refused(server: Alone) -> None:
    assert status(talk(server, HEAD + b"X: " + b"x" * 70_000)) in (400, 431)
    assert status(talk(server, b"\x16\x03\x01\r\n\r\n")) == 400


def test_more_connections_than_may_be_open_are_closed(server: Alone) -> None:
    idle = [socket.create_connection(("127.0.0.1", server.port), timeout=20) for _ in range(6)]
    time.sleep(0.2)
    assert talk(server, HEAD) == b""
    for each in idle:
        each.close()
    time.sleep(0.2)
    assert server.ask("GET", "/health").status == 200


def test_one_waits_its_turn_one_too_many_is_told_to_come_again(server: Alone) -> None:
    go, answers = threading.Event(), []
    server.process.does = lambda: go.wait(20) and None
    asking = [threading.Thread(target=lambda: answers.append(ask_for_grasps(server))) for _ in range(2)]
    for each in asking:
        each.start()
        time.sleep(0.2)
    full = ask_for_grasps(server)
    assert (
        full.status == 503
        and full.headers["retry-after"] == "2"
        and "2 requests at once (at_once)" in full.json["error"]
    )
    assert server.ask("GET", "/health").json["in_flight"] == 2
    time.sleep(0.5)
    go.set()
    for each in asking:
        each.join()
    assert sorted(each.status for each in answers) == [200, 503]
    assert "no turn came within 0.5 s" in next(each.json["error"] for each in answers if each.status == 503)
    assert server.ask("GET", "/health").json["in_flight"] == 0


def ask_for_grasps(server: Alone) -> Any:
    return server.ask("POST", "/grasps", b"\x93NUMPY", **NPY)


@pytest.mark.parametrize(
    ("code", "expected", "words"),
    [
        (1, 504, "expected an answer within 7 s (seconds), got none"),
        (-11, 500, "expected an answer, but its process died (signal SIGSEGV); it is started anew"),
    ],
)
def test_a_prediction_that_ends_its_process_is_told_and_the_model_loaded_anew(
    server: Alone, code: int, expected: int, words: str
) -> None:
    def dies() -> None:
        raise WorkerDiedError(code)

    loads, server.process.does = server.process.loads, dies
    told = ask_for_grasps(server)
    assert (told.status, told.json) == (expected, {"error": words})
    server.process.does = lambda: None
    while server.ask("GET", "/health").status == 503:
        time.sleep(0.01)
    assert server.process.loads == loads + 1 and ask_for_grasps(server).status == 200


def test_who_is_cut_off_while_waiting_is_not_predicted(server: Alone) -> None:
    go, asked = threading.Event(), []

    def work() -> None:
        asked.append(1)
        go.wait(20)

    server.process.does = work
    first = threading.Thread(target=lambda: ask_for_grasps(server))
    first.start()
    time.sleep(0.2)
    with socket.create_connection(("127.0.0.1", server.port)) as own:
        own.sendall(HEAD + b"Content-Length: 6\r\n\r\n\x93NUMPY")
        time.sleep(0.1)
    go.set()
    first.join()
    time.sleep(0.2)
    assert len(asked) == 1 and server.app.predictions.inside == 0


def test_a_defect_is_500_without_its_traceback(server: Alone, caplog: pytest.LogCaptureFixture) -> None:
    def defect() -> None:
        raise RuntimeError("Traceback: secret")

    server.process.does = defect
    told = ask_for_grasps(server)
    assert told.status == 500 and told.json == {"error": "the server has a defect, which its log tells"}
    end = time.monotonic() + 20
    while "secret" not in caplog.text and time.monotonic() < end:  # it is told once the answer has gone
        time.sleep(0.01)
    assert "secret" in caplog.text  # for whoever runs it


def test_pages_of_other_sites_cannot_ask(server: Alone) -> None:
    own = f"http://127.0.0.1:{server.port}"
    assert server.ask("GET", "/health", Host="rebound.example").status == 403
    assert server.ask("GET", "/health", Host="[").status == 403
    assert server.ask("GET", "/health", Origin="http://elsewhere.example").status == 403
    assert server.ask("GET", "/health", Origin=own).status == 200


def test_addresses_and_methods_that_there_are_not(server: Alone) -> None:
    for method, path, expected in (("GET", "/../etc/passwd", 404), ("GET", "/grasps", 405), ("PUT", "/docs", 405)):
        told = server.ask(method, path)
        assert told.status == expected
        assert told.json["error"] == f"expected an address and a method that /docs lists, got {method} {path}"


def test_each_request_is_a_line_and_is_counted(server: Alone, capfd: pytest.CaptureFixture[str]) -> None:
    server.ask("GET", "/no%0a%1b[31mthing")
    ask_for_grasps(server)
    said, end = "", time.monotonic() + 20
    while said.count("\n") < 2 and time.monotonic() < end:  # a line is told once its answer has gone
        said += capfd.readouterr().err
        time.sleep(0.01)
    lines = said.splitlines()
    assert len(lines) == 2 and "127.0.0.1 GET /no \\x1b[31mthing 404 in 0." in lines[0]
    assert "POST /grasps 200 in 0." in lines[1] and lines[1].endswith("s, 0 grasps")
    counted = server.ask("GET", "/metrics")
    assert counted.headers["content-type"].startswith("text/plain; version=")
    text = counted.body.decode()
    assert 'spgf_requests_total{path="other",status="404"}' in text and "spgf_in_flight 0.0" in text
    assert 'spgf_request_seconds_count{path="/grasps"}' in text and "spgf_ready 1.0" in text


def test_settings_that_there_are_not_are_named(server: Alone) -> None:
    for query, words in (
        ("tabel=find", "tabel: expected a setting of a scene, top or types; got an unknown one; did you mean table?"),
        ("mask=/etc/passwd", "mask: expected a file in the request, a part of multipart/form-data; got text"),
        ("table=find&table=find", "table: expected one value, got several"),
    ):
        told = server.ask("POST", f"/grasps?{query}", b"\x93NUMPY", **NPY)
        assert told.status == 400 and told.json["error"].startswith(words)
    told = server.ask("POST", "/grasps", b"?", Content_Type="text/html")
    assert told.status == 415 and told.json["error"].endswith("got text/html")
    told = server.ask("POST", "/grasps", b"?", Content_Type="multipart/form-data")
    assert told.status == 400 and told.json["error"].startswith("body: expected multipart/form-data, got ")
    told = server.ask("POST", "/grasps", b"")
    assert told.status == 400 and told.json["error"] == "body: expected a cloud, a depth image or a mesh; got none"


def test_the_address_is_told_where_it_cannot_be_had(tmp_path: Path) -> None:
    from spgf_torch.errors import InputError
    from spgf_torch.serving.server import bound, url

    own = bound("127.0.0.1", 0)
    port = own.getsockname()[1]
    assert url(own) == f"http://127.0.0.1:{port}"
    with own, pytest.raises(InputError, match=rf"port: expected a free one of 127\.0\.0\.1, got {port} \(Address"):
        bound("127.0.0.1", port)
    with pytest.raises(InputError, match=r"host: expected an address of this machine, got '300\.1\.1\.1'"):
        bound("300.1.1.1", 0)


def test_what_is_not_done_when_the_server_must_stop_is_told_in_a_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    go, answers = threading.Event(), list[Any]()
    with alone(tmp_path, stop_seconds=0.1, quiet=True) as server:
        server.process.does = lambda: go.wait(20) and None
        asking = threading.Thread(target=lambda: answers.append(ask_for_grasps(server)))
        asking.start()
        time.sleep(0.3)
        stopping = threading.Timer(2.5, go.set)  # uvicorn counts whole seconds: 1
        stopping.start()
    asking.join()
    assert answers[0].status == 503 and answers[0].json == {"error": "expected an answer, but the server is stopping"}
    assert "Traceback" not in caplog.text
