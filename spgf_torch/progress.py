"""Progress of long work, on stderr."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from threading import Event, Thread
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from spgf_torch.terminal import Plain

# Seconds between lines where there is no terminal to draw a bar in.
EVERY = 20.0
# Seconds of work before which nothing is said of all stages; of a stage whose results were kept, at most.
SOON, KEPT = 5.0, 0.5
# Columns of tables where there is no terminal.
WIDTH = 120

console = Plain(stderr=True, soft_wrap=True)

# What stands before every line of progress where several processes write to one terminal.
_label = ""


def take_turns(label: str) -> None:
    """This process shares its terminal with others: from now on lines that begin with `label`, no bars."""
    global _label
    _label = label


class ProgressReporter:
    """ProgressReporter of a run: a bar with an estimate in a terminal, lines now and then elsewhere.

    `seconds` holds the wall time of every stage so far; stages of the same name add up.

    Args:
        plan: name and share of the work of the stages to come, in order, where an estimate for all of them is wanted.
            One that is not begun when a later one is, was not needed.
    """

    def __init__(self, plan: Sequence[tuple[str, float]] = ()) -> None:
        self.seconds: dict[str, float] = {}
        self.plan = list(plan)
        self._worked, self._spent = 0.0, 0.0  # of the plan: shares of work done, and the seconds that they took

    def _share(self, name: str) -> float | None:
        """Of the next stage of this name, up to which the plan is now over; None of one that is not planned."""
        at = next((at for at, (planned, _) in enumerate(self.plan) if planned == name), None)
        if at is None:
            return None
        share = self.plan[at][1]
        del self.plan[: at + 1]
        return share

    def _left(self, share: float | None, part: float, taken: float) -> str:
        """Words about all stages, when `part` of one of `share` has taken so many seconds; none before they mean any.

        A stage that took no time, since its work is kept, tells nothing about the others.
        """
        if share is None or not self.plan or self._spent + taken < SOON:
            return ""
        left = (1 - part) * share + sum(share for _, share in self.plan)
        return f", about {(self._spent + taken) / (self._worked + part * share) * left:.0f} s of all stages left"

    @contextmanager
    def stage(
        self, name: str, total: int, unit: str = "", note: Callable[[], str] = str
    ) -> Iterator[Callable[[int], None]]:
        """Run a stage of `total` steps; call the yielded function with the number of steps just done.

        `note` gives the end of the stage's last line.
        """
        start = time.perf_counter()
        columns = (
            TextColumn("{task.description:12}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        done, told, bar = 0, start, console.is_terminal and not _label
        share = self._share(name)

        def tell() -> None:
            nonlocal told
            now = time.perf_counter()
            if bar or now - told <= EVERY or done >= total:
                return
            told, taken = now, now - start
            left = f", about {taken / done * (total - done):.0f} s left" if done else ""
            overall = self._left(share, done / total, taken) if done else ""
            console.print(f"{_label}{name:12} {done:6d} of {total} {unit:10} {taken:6.1f} s{left}{overall}")

        def advance(steps: int = 1) -> None:
            nonlocal done
            done += steps
            progress.advance(task, steps)
            tell()

        own = Progress(*columns, console=console, transient=True, disable=not bar)
        with own as progress, nullcontext() if bar else _now_and_then(tell):
            task = progress.add_task(name, total=total)
            yield advance
        taken = time.perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + taken
        overall = self._left(share, 1.0, taken)
        if share is not None and taken > KEPT:
            self._worked, self._spent = self._worked + share, self._spent + taken
        console.print(f"{_label}{name:12} {done:6d} {unit:10} done in {taken:6.1f} s{note()}{overall}")


@contextmanager
def _now_and_then(tell: Callable[[], None]) -> Iterator[None]:
    """`tell` is called every few seconds besides: the first step of a stage may take a minute."""
    ended = Event()

    def wait() -> None:
        while not ended.wait(EVERY):
            tell()

    thread = Thread(target=wait, name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


class ReportedProgress(ProgressReporter):
    """The same in a program, which prints nothing: a function hears of each step instead, if there is one.

    Args:
        heard: called with the name of the stage, how many of its steps are done, and of how many.
    """

    def __init__(self, heard: Callable[[str, int, int], Any] | None = None) -> None:
        super().__init__()
        self.heard = heard

    @contextmanager
    def stage(
        self, name: str, total: int, unit: str = "", note: Callable[[], str] = str
    ) -> Iterator[Callable[[int], None]]:
        """As `ProgressReporter.stage`."""
        start, done = time.perf_counter(), 0

        def advance(steps: int = 1) -> None:
            nonlocal done
            done += steps
            if self.heard is not None:
                self.heard(name, done, total)

        yield advance
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def show(content: Any) -> None:
    """Print a table or a line, as it is, on stdout; where that is no terminal, tables get the width they need."""
    out = Plain(soft_wrap=isinstance(content, str))
    if not out.is_terminal:
        out.width = WIDTH
    out.print(content)
