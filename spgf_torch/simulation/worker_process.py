"""A separate process for work that may crash or hang: a crash or hang is confined to it.

Not a pool of joblib's: a worker of it that dies loses all tasks of the others, and does not say which task it was.
Imports only the standard library, so that a new process starts quickly.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from threading import Lock
from typing import Any

# Exit status of faulthandler when the time is up; nothing else in a worker exits with it.
OVERDUE = 1
START = "import sys; sys.path[:] = {path!r}; from spgf_torch.simulation.worker_process import serve; serve({handle})"


class WorkerDiedError(Exception):
    """The process ended before it answered.

    Attributes:
        overdue: because a time limit (`limited`) was up.
    """

    def __init__(self, code: int) -> None:
        name = f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"
        super().__init__("did not end in time" if code == OVERDUE else f"its process died ({name})")
        self.overdue = code == OVERDUE


class WorkerClosedError(Exception):
    """The process was ended by `kill`."""


@dataclass(frozen=True)
class _Raised:
    """The answer to a call whose function raised."""

    lines: str


class WorkerProcess:
    """Calls functions in a separate process, one at a time; it starts at the first call, and again after a crash.

    `call` and `close` belong to one thread, `kill` may come from any.
    """

    def __init__(self) -> None:
        self._lock, self._closed = Lock(), False
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """Return `function(*args)`, both pickled to the other process.

        Raises WorkerDiedError where that process ended, WorkerClosedError where `kill` ended it, RuntimeError with the
        traceback of the other side where the function raised.
        """
        connection = self._start()
        try:
            connection.send((function, args))
            answer = connection.recv()
        except (EOFError, ConnectionError):
            code = self._end()
            if self._closed:
                raise WorkerClosedError from None
            raise WorkerDiedError(code) from None
        if isinstance(answer, _Raised):
            raise RuntimeError(answer.lines)
        return answer

    def kill(self) -> None:
        """End the process for good, even during a call."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def close(self) -> None:
        """End the process, and release its resources."""
        self.kill()
        if self._process is not None:
            self._end()

    def _start(self) -> Connection:
        with self._lock:
            if self._closed:
                raise WorkerClosedError
            if self._process is None or self._connection is None:
                self._connection, theirs = Pipe()
                with theirs, _interrupts_blocked():
                    self._process = subprocess.Popen(
                        [sys.executable, "-c", START.format(path=sys.path, handle=theirs.fileno())],
                        stdin=subprocess.DEVNULL,
                        stdout=2,  # stdout is the command's
                        env={"OMP_NUM_THREADS": "1", **os.environ},  # one process a core
                        pass_fds=[theirs.fileno()],
                    )
            return self._connection

    def _end(self) -> int:
        """Wait for a process that closed its end; return its exit code."""
        with self._lock:
            assert self._process is not None and self._connection is not None
            code = self._process.wait()
            self._connection.close()
            self._process = self._connection = None
        return code


def serve(handle: int) -> None:
    """Answer calls until the caller is gone; runs in the other process."""
    connection = Connection(handle)
    while True:
        answer: Any
        try:
            function, args = connection.recv()
            answer = function(*args)
        except EOFError:
            break
        except Exception:
            answer = _Raised(traceback.format_exc())
        try:
            connection.send(answer)
        except ConnectionError:
            break
    os._exit(0)  # a simulator that is torn down may crash


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """End this process if the body takes longer, even inside a library that never returns to Python."""
    if seconds is None:
        yield
        return
    faulthandler.dump_traceback_later(seconds, exit=True, file=_nowhere())
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


_open: list[Any] = []


def _nowhere() -> Any:
    """Return a file that discards tracebacks, open as long as the process lives."""
    if not _open:
        _open.append(Path(os.devnull).open("w"))  # noqa: SIM115
    return _open[0]


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C, which the terminal sends to all, for a process that starts in the body: its caller ends it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
