"""Executors of trials: inline, in processes of this machine, or on a Dask cluster.

All yield pairs of a task and its result, in the order in which tasks end. They take few tasks at a time from the
iterable, so that millions of tasks need no memory.
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
from spgf_torch.simulation.worker import Case, ChunkResult, try_chunk, try_in_process
from spgf_torch.simulation.worker_process import WorkerProcess

AHEAD = 2  # tasks submitted for each process, so that none is idle
PATIENCE = 30  # s for a scheduler to answer and for a first worker to be there


@dataclass(frozen=True)
class Task:
    """Candidates of one case.

    Attributes:
        name: of the task, unique.
        case: what is tried, and how.
        T_object_tcp: (M, 4, 4) float32.
    """

    name: Any
    case: Case
    T_object_tcp: np.ndarray


class Executor(Protocol):
    """Runs the trials of tasks. Closing the iterator ends those that are still running."""

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, ChunkResult]]: ...


class InlineExecutor:
    """Run tasks inline, one after the other: for a few trials, without the time to start a process."""

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, ChunkResult]]:
        for task in tasks:
            yield task, try_chunk(task.case, task.T_object_tcp)


class ProcessExecutor:
    """Run tasks in processes of this machine. The death of one loses no result of the others.

    Args:
        workers: how many, 0 = one a core.
        limit: seconds that a trial may take; None: no limit.
    """

    def __init__(self, workers: int = 0, limit: float | None = None) -> None:
        self.workers, self.limit = workers or joblib.cpu_count(), limit

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, ChunkResult]]:
        processes = [WorkerProcess() for _ in range(self.workers)]
        idle: SimpleQueue[WorkerProcess] = SimpleQueue()
        for process in processes:
            idle.put(process)

        def run_task(task: Task) -> ChunkResult:
            process = idle.get()
            try:
                return try_in_process(process, task.case, task.T_object_tcp, self.limit)
            finally:
                idle.put(process)

        threads = ThreadPoolExecutor(self.workers)
        try:
            yield from _by_threads(lambda task: threads.submit(run_task, task), iter(tasks), AHEAD * self.workers)
        finally:
            for process in processes:
                process.kill()
            threads.shutdown(cancel_futures=True)
            for process in processes:
                process.close()


def executor_of(workers: int = 0, limit: float | None = None, address: str | None = None) -> Executor:
    """Return the executor on the Dask cluster of `address`, or of `workers` local processes; 1 = inline."""
    if address:
        return DaskExecutor(address, limit)
    return InlineExecutor() if workers == 1 else ProcessExecutor(workers, limit)


def check_address(runner: str, address: str | None) -> None:
    """Raise InputError unless `runner` is dask exactly where there is a scheduler's address."""
    if (runner == "dask") != bool(address):
        raise InputError(
            f"address: expected that of a Dask scheduler with runner=dask, and only then; got {address or 'none'}"
        )


class DaskExecutor:
    """Run tasks on the workers of a Dask cluster, one a thread; others take over from a worker that dies.

    Each thread runs its trials in a process of its own, so that a crash does not end the worker.

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

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, ChunkResult]]:
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
            with suppress(Exception):  # the cluster may be gone
                self.client.close()

    def _threads(self) -> int:
        return max(1, sum(self.client.nthreads().values()))

    def _submit(self, task: Task, cases: dict[Case, Any]) -> Any:
        """Send the object once and not with every chunk; as a task, not as data, so that Dask can make it again."""
        if task.case not in cases:
            if len(cases) > AHEAD:
                del cases[next(iter(cases))]
            cases[task.case] = self.client.submit(_itself, task.case, pure=False)
        return self.client.submit(_on_worker, cases[task.case], task.T_object_tcp, self.limit, pure=False)


def _ended(future: Any, task: Task) -> ChunkResult:
    """Return the result of a task; one that Dask gave up, since its workers died repeatedly, has no outcomes."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        rows = range(len(task.T_object_tcp))
        return ChunkResult([None for _ in rows], dict.fromkeys(rows, "Dask gave up: its workers died"))


def _itself(case: Case) -> Case:
    return case


_own = threading.local()


def _on_worker(case: Case, T_object_tcp: np.ndarray, limit: float | None) -> ChunkResult:
    """Run trials on a thread of a Dask worker, in the process that the thread keeps for them."""
    if not hasattr(_own, "process"):
        _own.process = WorkerProcess()
    return try_in_process(_own.process, case, T_object_tcp, limit)


def _by_threads(
    submit: Callable[[Task], Future[ChunkResult]], tasks: Iterator[Task], ahead: int
) -> Iterator[tuple[Task, ChunkResult]]:
    waiting: dict[Future[ChunkResult], Task] = {}
    while True:
        waiting.update((submit(task), task) for task in islice(tasks, ahead - len(waiting)))
        if not waiting:
            return
        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
        for future in [
            future for future in waiting if future in done
        ]:  # what ended together, in the order of the tasks
            yield waiting.pop(future), future.result()
