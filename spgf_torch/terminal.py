"""What a command says, and who listens: closed pipes, full disks and poor alphabets end no work; signals do, in order.

Everything is written through `patient` streams: once nobody reads, or there is no room, what is said is dropped and
the work goes on. `Plain` is a console that prints names as they are: brackets are no markup, `:smile:` no picture, and
what would steer a terminal is written as `\\x1b`.
"""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

from rich.console import Console
from rich.text import Text

# Signals that end a command, beside that of Ctrl-C.
ENDING = (signal.SIGTERM, signal.SIGHUP)

# What writing to a pipe or a terminal gives that nobody reads any more.
UNREAD = (errno.EPIPE, errno.EBADF, errno.EIO)


class Ended(KeyboardInterrupt):
    """A signal asked the process to end; `number` is the signal's."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


class UnheardError(Exception):
    """Standard output took no more, in the system's words."""


class Plain(Console):
    """A console without markup, emoji and highlighting, whose reader may leave."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """`text` as it is, without what would steer a terminal."""
        return super().render_str(printable(text), **options)

    def on_broken_pipe(self) -> None:
        """Where the stream is not `patient` (a job in another process): say no more, and work on."""
        self.quiet = True


def printable(text: str) -> str:
    """`text` with control characters other than line breaks as `\\x1b`."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


class _Writer(io.FileIO):
    """A file descriptor that takes everything; `lost` is the error that ended it, None as long as all arrived."""

    lost: OSError | None = None

    def write(self, content: Any) -> int:
        """All of `content`; nothing once an error has come."""
        if self.lost is None:
            try:
                return super().write(content) or 0
            except BlockingIOError:  # a reader that is slow
                raise
            except OSError as error:
                self.lost = error
        return memoryview(content).nbytes


@contextmanager
def patient() -> Iterator[None]:
    """`sys.stdout` and `sys.stderr` that outlive their readers, and escape what their alphabet lacks.

    Raises `UnheardError` at the end where stdout took no more for another reason than that nobody reads it.
    Streams that somebody has put in the place of Python's own stay.
    """
    before = sys.stdout, sys.stderr
    out = _own(sys.stdout, 1, sys.__stdout__)
    sys.stdout = out or sys.stdout
    sys.stderr = _own(sys.stderr, 2, sys.__stderr__) or sys.stderr
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        sys.stdout, sys.stderr = before
    lost = getattr(getattr(getattr(out, "buffer", None), "raw", None), "lost", None)
    if lost is not None and lost.errno not in UNREAD:
        raise UnheardError(lost.strerror)


def _own(stream: TextIO | None, number: int, python_s: TextIO | None) -> TextIO | None:
    """A patient stream in the place of Python's own; None where there is another already."""
    if stream is None:  # closed by the caller: `>&-`
        return Path(os.devnull).open("w")
    if stream is not python_s:
        return None
    with suppress(OSError, ValueError):
        stream.flush()
    writer = _Writer(number, "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(writer), encoding=stream.encoding, errors="backslashreplace", line_buffering=True
    )


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP raise `Ended` in the main thread, as Ctrl-C raises KeyboardInterrupt; nohup's are ignored."""
    before: dict[int, Any] = {}
    with suppress(ValueError):  # not the main thread: signals belong to another
        for number in ENDING:
            if signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, _end)
    try:
        yield
    finally:
        for caught, handler in before.items():
            signal.signal(caught, handler)


def _end(number: int, frame: FrameType | None) -> None:
    raise Ended(number)
