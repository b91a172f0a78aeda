"""A process of its own for work that may crash or not end: what happens in it happens to nobody else.

Not a pool of joblib's: one of its workers that dies takes all tasks of the others with it, and does not say which task
it was. Imports only the standard library, so that a new process is there at once.
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

# What faulthandler leaves with when the time is up; nothing else in a cell does.
OVERDUE = 1
START = "import sys; sys.path[:] = {path!r}; from spgf_torch.simulation.worker_process import serve; serve({handle})"


class CellDiedError(Exception):
    """The process ended before it answered.

    Attributes:
        overdue: because a time limit (`limited`) was up.
    """

    def __init__(self, code: int) -> None:
        name = f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"
        super().__init__("did not end in time" if code == OVERDUE else f"its process died ({name})")
        self.overdue = code == OVERDUE


class CellClosedError(Exception):
    """Nothing more is wanted of this cell."""


@dataclass(frozen=True)
class _Raised:
    """Stands for an answer where the function raised."""

    lines: str


class Cell:
    """Calls functions in a process of its own, one at a time; started when it is first needed, and again after a death.

    `call` and `close` belong to one thread, `kill` may come from any.
    """

    def __init__(self) -> None:
        self._lock, self._closed = Lock(), False
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """`function(*args)`, both found by pickle in the other process.

        Raises CellDiedError where that process ended, CellClosedError where `kill` ended it, RuntimeError with the
        traceback of the other side where the function raised.
        """
        connection = self._start()
        try:
            connection.send((function, args))
            answer = connection.recv()
        except (EOFError, ConnectionError):
            code = self._end()
            if self._closed:
                raise CellClosedError from None
            raise CellDiedError(code) from None
        if isinstance(answer, _Raised):
            raise RuntimeError(answer.lines)
        return answer

    def kill(self) -> None:
        """End the process for good, whatever it is doing."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def close(self) -> None:
        """`kill`, and let go of what belongs to the process."""
        self.kill()
        if self._process is not None:
            self._end()

    def _start(self) -> Connection:
        with self._lock:
            if self._closed:
                raise CellClosedError
            if self._process is None or self._connection is None:
                self._connection, theirs = Pipe()
                with theirs, _interrupts_blocked():
                    self._process = subprocess.Popen(
                        [sys.executable, "-c", START.format(path=sys.path, handle=theirs.fileno())],
                        stdin=subprocess.DEVNULL,
                        stdout=2,  # stdout is the command's
                        env={"OMP_NUM_THREADS": "1", **os.environ},  # a cell a core
                        pass_fds=[theirs.fileno()],
                    )
            return self._connection

    def _end(self) -> int:
        """Of a process that closed its end: the exit code."""
        with self._lock:
            assert self._process is not None and self._connection is not None
            code = self._process.wait()
            self._connection.close()
            self._process = self._connection = None
        return code


def serve(handle: int) -> None:
    """The other side: answer calls until the caller is gone, by its own will or not."""
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
    os._exit(0)  # nothing to tidy up, and a simulator that is torn down may crash


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """End this process if the body takes longer, even inside a library that never comes back to Python."""
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
    """A file for tracebacks that nobody wants; open as long as the process lives."""
    if not _open:
        _open.append(Path(os.devnull).open("w"))  # noqa: SIM115
    return _open[0]


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """A process that starts here never hears of Ctrl-C, which the terminal sends to all: its caller will end it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
