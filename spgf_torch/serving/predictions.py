"""Predictions in another process, one at a time: waiting, time limits, and a new process where one has ended."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Any

from starlette.exceptions import HTTPException

from spgf_torch.errors import InputError
from spgf_torch.serving import predicting
from spgf_torch.serving.bodies import Job
from spgf_torch.serving.config import ServeConfig
from spgf_torch.serving.metrics import Metrics
from spgf_torch.simulation.worker_process import WorkerClosedError, WorkerDiedError, WorkerProcess

# s after which somebody who was turned away may ask again, and between tries to load a model that does not load.
RETRY = 2


class Predictions:
    """Asks the predicting process, which is started anew where it has ended.

    Args:
        process: where it runs; None: one of its own.

    Attributes:
        about: who the model is; None until it is loaded, and while it is loaded anew.
        inside: requests that are read, wait or are predicted.
    """

    def __init__(self, config: ServeConfig, metrics: Metrics, process: WorkerProcess | None = None) -> None:
        self._config, self._metrics = config, metrics
        self._process, self._thread = process or WorkerProcess(), ThreadPoolExecutor(1)  # one thread calls
        self._turn = asyncio.Lock()
        self._loading: asyncio.Task[None] | None = None
        self.about: dict[str, Any] | None = None
        self.inside = 0

    def start(self) -> None:
        """Load the model, before anything is served. Raises InputError for one that cannot be loaded."""
        self._keep(self._thread.submit(self._process.call, predicting.load, self._config).result())

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._thread.shutdown()
        self._process.close()

    @asynccontextmanager
    async def place(self) -> AsyncIterator[None]:
        """Be one of those at once. Raises HTTPException (503) where there is no model yet, or no room."""
        if self.about is None:
            raise _busy("the model is being loaded")
        if self.inside >= self._config.at_once:
            raise _busy(f"{self.inside} requests at once (at_once) are all that are taken")
        self.inside += 1
        self._metrics.in_flight.set(self.inside)
        try:
            yield
        finally:
            self.inside -= 1
            self._metrics.in_flight.set(self.inside)

    async def predict(self, job: Job, wanted: Callable[[], Any]) -> predicting.Answer:
        """The answer to a request, when it is its turn and it is still wanted.

        Args:
            wanted: awaited before the work: raises where nobody waits for the answer any more.

        Raises InputError for what cannot be used; HTTPException: 503 after too long a wait, 504 after too long a
        prediction, 413 for too much memory, 500 where the prediction ended its process.
        """
        answer = await self._called(predicting.predict, job, wanted=wanted)
        if isinstance(answer, predicting.TooLargeError):
            raise HTTPException(413, f"body: {answer}")
        return answer  # type: ignore[no-any-return]

    async def page(self, name: str, wanted: Callable[[], Any]) -> bytes | None:
        """The page of a result; None where it is kept no more. Raises as `predict`."""
        return await self._called(predicting.page, name, wanted=wanted)  # type: ignore[no-any-return]

    async def _called(self, function: Callable[..., Any], *args: Any, wanted: Callable[[], Any]) -> Any:
        try:
            async with asyncio.timeout(self._config.wait_seconds):
                await self._turn.acquire()
        except TimeoutError:
            raise _busy(f"no turn came within {self._config.wait_seconds:g} s (wait_seconds)") from None
        try:
            await wanted()
            call = asyncio.get_running_loop().run_in_executor(self._thread, self._process.call, function, *args)
            answer = await asyncio.shield(call)
        except WorkerDiedError as error:
            self._load_anew()
            if error.overdue:
                raise HTTPException(
                    504, f"expected an answer within {self._config.seconds:g} s (seconds), got none"
                ) from None
            raise HTTPException(500, f"expected an answer, but {error}; it is started anew") from None
        except WorkerClosedError:
            raise _busy("the server is stopping") from None
        finally:
            self._turn.release()
        if isinstance(answer, InputError):
            raise answer
        return answer

    def _load_anew(self) -> None:
        self.about = None
        self._metrics.ready.set(0)
        self._metrics.restarts.inc()
        self._loading = asyncio.get_running_loop().create_task(self._load())

    async def _load(self) -> None:
        """Load the model in a new process, as often as it takes."""
        loop = asyncio.get_running_loop()
        while self.about is None:
            try:
                self._keep(await loop.run_in_executor(self._thread, self._process.call, predicting.load, self._config))
            except (InputError, WorkerDiedError, RuntimeError):
                await asyncio.sleep(RETRY)
            except WorkerClosedError:
                return

    def _keep(self, about: dict[str, Any] | InputError) -> None:
        if isinstance(about, InputError):
            raise about
        self.about = about
        self._metrics.ready.set(1)


def _busy(why: str) -> HTTPException:
    return HTTPException(503, f"expected room for a request, but {why}; ask again", {"Retry-After": str(RETRY)})
