"""A Dask cluster on this machine: a scheduler and two workers in processes of their own, one killed on the way."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from generations import Calls, tables
from toys import TRIALS, Toy, toss

from spgf_torch.errors import InputError
from spgf_torch.simulation.executors import DaskExecutor, InlineExecutor

pytest.importorskip("distributed")

HERE = Path(__file__).parent
Cluster = tuple[str, list[subprocess.Popen]]


def started(folder: Path, role: str, *arguments: str) -> subprocess.Popen:
    """A scheduler or worker; what they import stands beside the tests."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE.parents[1]), str(HERE)])}
    with (folder / f"{role}.log").open("a") as log:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{role}", "--no-dashboard", *arguments],
            cwd=folder,
            env={**environment, "OMP_NUM_THREADS": "1"},
            stdout=log,
            stderr=log,
        )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """The scheduler's address and the two workers."""
    where = tmp_path / "scheduler.json"
    running = [started(tmp_path, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(where))]
    try:
        while not where.exists() or not where.read_text():
            assert running[0].poll() is None, (tmp_path / "scheduler.log").read_text()
            time.sleep(0.05)
        to = ["--scheduler-file", str(where), "--nthreads", "1", "--no-nanny", "--local-directory", str(tmp_path)]
        running += [started(tmp_path, "worker", *to) for _ in range(2)]
        yield json.loads(where.read_text())["address"], running[1:]
    finally:
        for process in running:
            process.kill()
            process.wait()


def test_a_worker_killed_on_the_way(cluster: Cluster, tmp_path: Path) -> None:
    """The other one does its work, a trial that crashes ends no worker, and the table is as ever."""
    address, workers = cluster
    log = tmp_path / "log"
    calls = Calls([Toy(name, log=str(log), seconds=0.005) for name in ("a", "b")], TRIALS, toss, 60)
    done = 0

    def progress(count: int) -> None:
        nonlocal done
        done += count
        if done > 60 and workers[0].poll() is None:
            workers[0].send_signal(signal.SIGKILL)
            workers[0].wait()

    run_state, ran = calls.make(tmp_path / "dask", DaskExecutor(address), chunk=5, progress=progress)
    assert ran == 240 and not run_state.incidents and workers[0].returncode == -9
    calls.make(tmp_path / "here", InlineExecutor())
    assert tables(tmp_path / "dask") == tables(tmp_path / "here")


def test_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spgf_torch.simulation.executors.PATIENCE", 0.2)
    with pytest.raises(InputError, match=r"address: expected a Dask scheduler that answers, got tcp://127\.0\.0\.1:9"):
        DaskExecutor("tcp://127.0.0.1:9")


def test_one_worker_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """And none is not; then nothing stays connected."""
    there, closed = 1, False

    def wait_for_workers(count: int, timeout: float) -> None:
        if count > there:
            raise TimeoutError

    def close() -> None:
        nonlocal closed
        closed = True

    client = SimpleNamespace(wait_for_workers=wait_for_workers, close=close)
    monkeypatch.setattr("distributed.Client", lambda address, **settings: client)
    assert DaskExecutor("tcp://here:1").client is client and not closed
    there = 0
    with pytest.raises(InputError, match=r"expected a Dask scheduler with workers, got none at tcp://here:1"):
        DaskExecutor("tcp://here:1")
    assert closed
