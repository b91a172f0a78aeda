"""How work is shared among threads, so that a busy machine slows it down no more than its share.

torch splits single operations of microseconds among its threads, and each operation waits for the last of them: where
another process holds a core, all wait for it, thousands of times. Here whole parts of some milliseconds go to threads
in which torch uses one thread each. How many: as many as torch may use, which OMP_NUM_THREADS or
`torch.set_num_threads` change; 1 leaves the work in the calling thread. Results do not depend on it. A forked process
goes on with one thread (`spgf_torch/__init__.py`); for more, start processes with `spawn`.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from itertools import chain, islice
from threading import Barrier, Lock
from typing import TypeVar

import torch

T = TypeVar("T")
R = TypeVar("R")


def in_parts(work: Callable[[T], R], parts: Iterable[T], most: int | None = None) -> Iterator[R]:
    """`work` of each part, in order, on `most` threads at most.

    Parts are taken as they are needed: few are in memory at once.
    """
    threads, parts = min(torch.get_num_threads(), most or sys.maxsize), iter(parts)
    first = list(islice(parts, 2))
    if threads == 1 or len(first) < 2:
        yield from map(work, chain(first, parts))
        return
    waiting: deque[Future[R]] = deque()
    with one_thread():
        try:
            for part in chain(first, parts):
                waiting.append(_pool(threads).submit(work, part))
                if len(waiting) > threads + 1:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    """Kept from call to call: on a busy machine it takes milliseconds until a thread runs.

    All its threads have begun when it is returned: each sets torch's number of threads, which the next new thread of
    the program would take over, and who asked for the pool sets it right again.
    """
    pool, begun = (
        ThreadPoolExecutor(threads, "spgf_torch", initializer=lambda: torch.set_num_threads(1)),
        Barrier(threads),
    )
    list(pool.map(lambda _: begun.wait(), range(threads)))
    return pool


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked process has no threads but one


class _Callers:
    """Threads of the program that are within `one_thread`, and how many threads torch had before the first."""

    inside, before, lock = 0, 1, Lock()


@contextmanager
def one_thread() -> Iterator[None]:
    """torch uses one thread for each operation of the calling thread.

    The number is torch's for each thread of a program and for those that begin later: a thread that begins while
    another one is in here finds one thread, and leaves with as many as that one had before.
    """
    own = torch.get_num_threads()
    with _Callers.lock:
        if not _Callers.inside:
            _Callers.before = own
        _Callers.inside += 1
    torch.set_num_threads(1)
    try:
        yield
    finally:
        with _Callers.lock:
            _Callers.inside -= 1
            torch.set_num_threads(_Callers.before if own == 1 else own)
