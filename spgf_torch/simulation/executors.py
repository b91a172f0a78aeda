"""Where chunks of candidates are tried: in this process, in others of this machine, on a Dask cluster.

All give the same: pairs of a task and how it ended, in whatever order they end. Tasks are taken from their iterable as
there is room, so that millions of them need no memory.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from queue import SimpleQueue
from typing import Any, Protocol

import joblib
import numpy as np

from spgf_torch.errors import IncompleteError, InputError
from spgf_torch.extras import needed
from spgf_torch.simulation.attempts import Case, Ended, try_chunk, try_in_cell
from spgf_torch.simulation.worker_process import Cell

AHEAD = 2  # tasks handed out for each process, so that none waits for the next
PATIENCE = 30  # s for a scheduler to answer and for a first worker to be there


@dataclass(frozen=True)
class Task:
    """Candidates of one case.

    Attributes:
        name: tells tasks apart.
        case: what is tried, and how.
        T_object_tcp: (M, 4, 4) float32.
    """

    name: Any
    case: Case
    T_object_tcp: np.ndarray


class Runner(Protocol):
    """Tries the candidates of tasks. Closing the iterator ends whatever is still running."""

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Ended]]: ...


class Here:
    """In this process, one task after the other: for a few trials, without the time that another process takes."""

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Ended]]:
        for task in tasks:
            yield task, try_chunk(task.case, task.T_object_tcp)


class Local:
    """Processes of this machine; one that dies takes nothing with it.

    Args:
        workers: how many, 0 = one a core.
        limit: seconds that a trial may take; None = as long as it likes.
    """

    def __init__(self, workers: int = 0, limit: float | None = None) -> None:
        self.workers, self.limit = workers or joblib.cpu_count(), limit

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Ended]]:
        cells = [Cell() for _ in range(self.workers)]
        idle: SimpleQueue[Cell] = SimpleQueue()
        for cell in cells:
            idle.put(cell)

        def attempt(task: Task) -> Ended:
            cell = idle.get()
            try:
                return try_in_cell(cell, task.case, task.T_object_tcp, self.limit)
            finally:
                idle.put(cell)

        threads = ThreadPoolExecutor(self.workers)
        try:
            yield from _by_threads(lambda task: threads.submit(attempt, task), iter(tasks), AHEAD * self.workers)
        finally:
            for cell in cells:
                cell.kill()
            threads.shutdown(cancel_futures=True)
            for cell in cells:
                cell.close()


def runner_of(workers: int = 0, limit: float | None = None, address: str | None = None) -> Runner:
    """Where trials run: on the Dask cluster of `address`, or in `workers` processes here, one of which is this one."""
    if address:
        return Dask(address, limit)
    return Here() if workers == 1 else Local(workers, limit)


def check_address(runner: str, address: str | None) -> None:
    """InputError unless there is a scheduler's address with `runner` dask, and only then."""
    if (runner == "dask") != bool(address):
        raise InputError(
            f"address: expected that of a Dask scheduler with runner=dask, and only then; got {address or 'none'}"
        )


class Dask:
    """The workers of a Dask cluster, as many threads as each has; a worker that dies is replaced by the others.

    On every worker the trials run in a process beside it, so that none of them can end it.

    Args:
        address: of the scheduler, for example tcp://10.0.0.1:8786.
        limit: seconds that a trial may take.

    Raises InputError where Dask is not installed or no scheduler with a worker answers.
    """

    def __init__(self, address: str, limit: float | None = None) -> None:
        needed("runner: dask", "distributed")
        from distributed import Client

        self.address, self.limit = address, limit
        try:
            self.client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"address: expected a Dask scheduler that answers, got {address} ({error})") from None
        try:
            self.client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            self.client.close()
            raise InputError(f"address: expected a Dask scheduler with workers, got none at {address}") from None

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Ended]]:
        from distributed import as_completed
        from distributed.client import FutureCancelledError
        from distributed.comm.core import CommClosedError

        waiting: dict[str, Task] = {}
        cases: dict[Case, Any] = {}
        tasks = iter(tasks)
        completed = as_completed(loop=self.client.loop)
        try:
            while True:
                for task in islice(tasks, max(0, AHEAD * self._threads() - len(waiting))):
                    future = self._submit(task, cases)
                    waiting[future.key] = task
                    completed.add(future)
                if not waiting:
                    return
                future = next(completed)
                task = waiting.pop(future.key)
                yield task, _ended(future, task)
        except (CommClosedError, FutureCancelledError, TimeoutError) as error:
            raise IncompleteError(f"address: the Dask scheduler at {self.address} went away ({error})") from None
        except ModuleNotFoundError as error:
            raise IncompleteError(f"address: expected Dask workers with spgf_torch, got: {error}") from None
        finally:
            with suppress(Exception):  # of a cluster that is gone nothing can be taken back
                self.client.close()

    def _threads(self) -> int:
        return max(1, sum(self.client.nthreads().values()))

    def _submit(self, task: Task, cases: dict[Case, Any]) -> Any:
        """The object travels once and not with every chunk; as a task, not as data: it can be had again."""
        if task.case not in cases:
            if len(cases) > AHEAD:
                del cases[next(iter(cases))]
            cases[task.case] = self.client.submit(_itself, task.case, pure=False)
        return self.client.submit(_on_worker, cases[task.case], task.T_object_tcp, self.limit, pure=False)


def _ended(future: Any, task: Task) -> Ended:
    """What came of a task; Dask gives up on one whose workers died again and again."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        rows = range(len(task.T_object_tcp))
        return Ended([None for _ in rows], dict.fromkeys(rows, "Dask gave up: its workers died"))


def _itself(case: Case) -> Case:
    return case


_own = threading.local()


def _on_worker(case: Case, T_object_tcp: np.ndarray, limit: float | None) -> Ended:
    """On a thread of a Dask worker: the process that it keeps for its trials does them."""
    if not hasattr(_own, "cell"):
        _own.cell = Cell()
    return try_in_cell(_own.cell, case, T_object_tcp, limit)


def _by_threads(
    submit: Callable[[Task], Future[Ended]], tasks: Iterator[Task], ahead: int
) -> Iterator[tuple[Task, Ended]]:
    waiting: dict[Future[Ended], Task] = {}
    while True:
        waiting.update((submit(task), task) for task in islice(tasks, ahead - len(waiting)))
        if not waiting:
            return
        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
        for future in done:
            yield waiting.pop(future), future.result()
