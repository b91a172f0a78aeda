"""Objects described, and learned from, on the workers of a Dask cluster: what is made here otherwise, to the bit.

Sensing, features and collisions of an object depend on the object, its grasps and the settings alone. Workers make what
the caller's cache lacks; they write nothing and need no common disk. The caller takes the objects in their order.

Then each worker is sent all objects as features and poses, and has sets of objects that teach to learn: prototypes, the
shape-grasp space, the votes on objects that are held out. Sets know nothing of each other, and each is learned in one
thread, so that nothing depends on the number of workers, nor on which has what.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from itertools import islice
from typing import Any

from safetensors.torch import load, save
from torch import Tensor

from spgf_torch.cache import Cache
from spgf_torch.errors import IncompleteError
from spgf_torch.experiment.describe import CachedSteps, Describer, Grasps
from spgf_torch.experiment.experiment import Experiment
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.executors import DaskExecutor
from spgf_torch.threads import one_thread

AHEAD = 2  # objects submitted for each thread of the cluster, so that none is idle


class Remembering(Cache):
    """A cache of one object that keeps what was made, by step, in memory."""

    def __init__(self) -> None:
        super().__init__(None)
        self.content: dict[str, dict[str, Tensor]] = {}

    def tensors(self, kind: str, key: str, make: Callable[[], Mapping[str, Tensor]]) -> dict[str, Tensor]:
        """What `make` gives."""
        self.content[kind] = dict(make())
        return self.content[kind]


@dataclass(frozen=True)
class Cluster:
    """The workers behind a Dask client, as the place where objects are described and learned from.

    Attributes:
        client: of `distributed`.
        address: of its scheduler, for messages.
    """

    client: Any
    address: str

    def describe(self, objects: Sequence[CachedSteps], advance: Callable[[int], None]) -> None:
        """Have the workers make the steps that are in no cache.

        Raises IncompleteError where the scheduler or all workers go away, or lack this package.
        """
        with self._answering():
            for steps, made in self._made(objects):
                steps.given.update({step: load(content) for step, content in made.items()})
                advance(1)

    def knowing(self, experiment: Experiment) -> Callable[..., list[Any]]:
        """A function (work, items, advance) -> results, in order, of a method of the experiment called with each item.

        Raises IncompleteError as `describe`.
        """
        with self._answering():
            there = self.client.scatter(experiment, broadcast=True, hash=False)

        def each(
            work: Callable[..., Any], items: Sequence[tuple[Any, ...]], advance: Callable[[int], None]
        ) -> list[Any]:
            results = []
            with self._answering():
                for future in [self.client.submit(in_one_thread, work, there, *item, pure=False) for item in items]:
                    results.append(future.result())
                    advance(1)
            return results

        return each

    @contextmanager
    def _answering(self) -> Iterator[None]:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError
        from distributed.comm.core import CommClosedError

        try:
            yield
        except (CommClosedError, FutureCancelledError, KilledWorker, TimeoutError) as error:
            raise IncompleteError(f"address: the Dask cluster at {self.address} went away ({error})") from None
        except ModuleNotFoundError as error:
            raise IncompleteError(f"address: expected Dask workers with spgf_torch, got: {error}") from None

    def _made(self, objects: Sequence[CachedSteps]) -> Iterator[tuple[CachedSteps, dict[str, bytes]]]:
        """Each object with what was made of it, in order; few are on their way at a time."""
        waiting: deque[tuple[CachedSteps, Any]] = deque()
        coming = ((steps, self._submitted(steps)) for steps in objects)
        waiting.extend(islice(coming, AHEAD * max(1, sum(self.client.nthreads().values()))))
        while waiting:
            steps, future = waiting.popleft()
            yield steps, future.result() if future is not None else {}
            waiting.extend(islice(coming, 1))

    def _submitted(self, steps: CachedSteps) -> Any:
        """The future of an object's missing steps; None where nothing is missing."""
        cache, settings = steps.settings.cache, steps.settings
        missing = [step for step, key in steps.keys.items() if not cache.holds(step, key)]
        if not set(missing) - {"texlets"}:
            return None
        rooms = {f.name: getattr(settings, f.name) for f in fields(settings) if f.name not in ("cache", "cluster")}
        grasps = Grasps(steps.grasps.T_object_tcp, steps.grasps.grasp_type)
        return self.client.submit(made_steps, rooms, steps.obj, grasps, missing, pure=False)


@contextmanager
def cluster_of(address: str | None) -> Iterator[Cluster | None]:
    """The cluster of the scheduler at `address`, left at the end; None where there is no address.

    Raises InputError where no scheduler with a worker answers.
    """
    if address is None:
        yield None
        return
    client = DaskExecutor(address).client
    try:
        yield Cluster(client, address)
    finally:
        with suppress(Exception):  # it may be gone
            client.close()


def made_steps(rooms: Mapping[str, Any], obj: GraspObject, grasps: Grasps, wanted: Sequence[str]) -> dict[str, bytes]:
    """The tensors of the `wanted` steps of an object, a safetensors file each; `rooms` are those of a `Describer`."""
    kept = Remembering()
    steps = CachedSteps(Describer(**rooms, cache=kept), obj, grasps)
    for step in wanted:
        getattr(steps, {"collisions": "collides"}.get(step, step))
    return {step: save({name: t.contiguous().cpu() for name, t in kept.content[step].items()}) for step in wanted}


def in_one_thread(work: Callable[..., Any], *arguments: Any) -> Any:
    """What `work` gives of the arguments: a worker has as many threads as it should use."""
    with one_thread():
        return work(*arguments)
