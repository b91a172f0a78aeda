"""Progress of long work, on stderr."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from spgf_torch.terminal import Plain

# Seconds between lines where there is no terminal to draw a bar in.
EVERY = 20.0
# Columns of tables where there is no terminal.
WIDTH = 120

console = Plain(stderr=True, soft_wrap=True)

# What stands before every line of progress where several processes write to one terminal.
_label = ""


def take_turns(label: str) -> None:
    """This process shares its terminal with others: from now on lines that begin with `label`, no bars."""
    global _label
    _label = label


class Stages:
    """Stages of a run: a bar with an estimate in a terminal, lines now and then elsewhere.

    `seconds` holds the wall time of every stage so far; stages of the same name add up.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

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

        def advance(steps: int = 1) -> None:
            nonlocal done, told
            done += steps
            progress.advance(task, steps)
            now = time.perf_counter()
            if not bar and now - told > EVERY and done < total:
                told = now
                left = (now - start) / done * (total - done)
                console.print(
                    f"{_label}{name:12} {done:6d} of {total} {unit:10} {now - start:6.1f} s, about {left:.0f} s left"
                )

        with Progress(*columns, console=console, transient=True, disable=not bar) as progress:
            task = progress.add_task(name, total=total)
            yield advance
        taken = time.perf_counter() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + taken
        console.print(f"{_label}{name:12} {done:6d} {unit:10} done in {taken:6.1f} s{note()}")


def show(content: Any) -> None:
    """Print a table or a line, as it is, on stdout; where that is no terminal, tables get the width they need."""
    out = Plain(soft_wrap=isinstance(content, str))
    if not out.is_terminal:
        out.width = WIDTH
    out.print(content)
