"""How work is shared among threads, so that a busy machine slows it down no more than its share.

torch splits single operations of microseconds among its threads, and each operation waits for the last of them: where
another process holds a core, all wait for it, thousands of times. Here whole parts of some milliseconds go to threads
in which torch uses one thread each. How many: as many as torch may use, which OMP_NUM_THREADS or
`torch.set_num_threads` change; 1 leaves the work in the calling thread. Results do not depend on it.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

T = TypeVar("T")
R = TypeVar("R")


def in_parts(work: Callable[[T], R], parts: Iterable[T], most: int | None = None) -> Iterator[R]:
    """`work` of each part, in order, on `most` threads at most.

    Parts are taken as they are needed: few are in memory at once.
    """
    threads = min(torch.get_num_threads(), most or sys.maxsize)
    if threads == 1:
        yield from map(work, parts)
        return
    waiting: deque[Future[R]] = deque()
    with one_thread(), ThreadPoolExecutor(threads, initializer=lambda: torch.set_num_threads(1)) as pool:
        for part in parts:
            waiting.append(pool.submit(work, part))
            if len(waiting) > threads + 1:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


@contextmanager
def one_thread() -> Iterator[None]:
    """torch uses one thread for each operation of the calling thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
