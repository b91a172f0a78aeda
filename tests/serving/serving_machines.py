"""Servers that tests ask: the command in a process of its own, and the application on a thread without a model."""

import asyncio
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn
from commands import ROOT
from composing import composed

from spgf_torch.serving.app import App
from spgf_torch.serving.config import ServeConfig
from spgf_torch.serving.metrics import Metrics
from spgf_torch.serving.predicting import Answer
from spgf_torch.serving.predictions import Predictions
from spgf_torch.serving.server import bound, settings_of
from spgf_torch.settings import typed


@dataclass
class Told:
    """An answer: its status, headers, bytes."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


def ask(port: int, method: str, path: str, body: Any = None, **headers: str) -> Told:
    """Ask a server of this machine; `_` in a header's name is `-`."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return Told(answer.status, dict(answer.headers.items()), answer.read())
    finally:
        connection.close()


@dataclass
class Running:
    """The command, serving."""

    process: subprocess.Popen
    url: str
    temporary: Path

    @property
    def port(self) -> int:
        return int(self.url.rpartition(":")[2])

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Told:
        return ask(self.port, method, path, body, **headers)

    def left(self) -> list[Path]:
        """What lies in the folders of requests."""
        return [path for folder in self.temporary.glob("spgf_serve_*") for path in folder.iterdir()]

    def until_ready(self) -> Any:
        """Its health, once it is ready."""
        for _ in range(600):
            if (health := self.ask("GET", "/health")).status == 200:
                return health.json
            time.sleep(0.1)
        raise AssertionError(health.body)


@contextmanager
def serving(folder: Path, *overrides: str) -> Iterator[Running]:
    """`spgf serve` on a free port, with a folder for its temporary files; stopped by SIGTERM, as is checked."""
    temporary = folder / "temporary"
    temporary.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)}
    command = [sys.executable, "-m", "spgf_torch", "serve", "port=0", f"model={ROOT / 'data/models/panda'}", *overrides]
    log = (folder / "log").open("w+")
    process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=log, text=True)
    assert process.stdout is not None
    try:
        said = process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+", said)
        assert found, (said, (folder / "log").read_text())
        yield Running(process, found[0], temporary)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 143, (folder / "log").read_text()
        assert (folder / "log").read_text().splitlines()[-1] == "serve: ended by SIGTERM"
        assert not list(temporary.iterdir()) and not list(folder.glob("outputs/serve/*"))
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        log.close()


def settings(**changes: Any) -> ServeConfig:
    """The settings in conf/, with changes."""
    return typed(ServeConfig, {**composed("serve"), "model": "none", **changes})


class Pretended:
    """In the place of the process: answers `{}`, or does what a test wants of a prediction."""

    def __init__(self) -> None:
        self.does: Callable[[], Any] = lambda: None
        self.loads = 0

    def call(self, function: Any, *args: Any) -> Any:
        if function.__name__ == "load":
            self.loads += 1
            return {"name": "nobody"}
        return self.does() or Answer(b"{}", 0, "0")

    def kill(self) -> None:
        pass

    close = kill


@dataclass
class Alone:
    """The application on a thread."""

    app: App
    process: Pretended
    port: int
    folder: Path

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Told:
        return ask(self.port, method, path, body, **headers)


@contextmanager
def alone(folder: Path, **changes: Any) -> Iterator[Alone]:
    """The application without a model, on a free port."""
    config, metrics, process = settings(**changes), Metrics(), Pretended()
    predictions = Predictions(config, metrics, process)  # type: ignore[arg-type]
    predictions.start()
    app, own = App(config, predictions, metrics, {"voxel": "m; a reason"}, folder), bound("127.0.0.1", 0)
    port = own.getsockname()[1]
    server = uvicorn.Server(settings_of(config, app))
    thread = threading.Thread(target=lambda: asyncio.run(server.serve([own])))
    thread.start()
    try:
        while not server.started:
            time.sleep(0.01)
        yield Alone(app, process, port, folder)
    finally:
        server.should_exit = True
        thread.join()
        predictions.close()
