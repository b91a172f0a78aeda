"""Scenes cleared in processes of their own, so that a simulator that crashes ends none of the others.

Each process keeps what is loaded once: the hand in physics, models and judges. PhysX's settings are global to a
process, so scenes are never cleared in the caller's.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import Any

import joblib

from spgf_torch.cache import code_fingerprint, fingerprint
from spgf_torch.clearing.config import OURS, ClutterConfig
from spgf_torch.clearing.methods import method_of
from spgf_torch.clearing.rounds import Bench, ClearedScene
from spgf_torch.errors import InputError
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import plain
from spgf_torch.simulation.arrangements import arranged
from spgf_torch.simulation.attempts import Attempts
from spgf_torch.simulation.execute import versions
from spgf_torch.simulation.worker_process import WorkerDiedError, WorkerProcess, limited

# Settings on which no scene depends; objects are told apart by what they are.
NOT_OF_SCENES = frozenset(
    ("scenes", "workers", "out", "bootstrap", "time_limit", "cache", "cache_gb", "objects", "skip_bad", "beside")
)


@dataclass(frozen=True)
class SceneTask:
    """A scene to be cleared.

    Attributes:
        number: from 0. seed: of the scene. objects: from which it is drawn. fold: whose model plans; None: one for all.
        folders: of model and judge, as `Predictor.load` takes them. filmed: with the motion of each attempt.
    """

    number: int
    seed: int
    objects: tuple[GraspObject, ...]
    fold: int | None
    folders: tuple[str, str]
    filmed: bool


def cleared_scenes(
    tasks: Sequence[SceneTask], config: ClutterConfig
) -> Generator[tuple[SceneTask, ClearedScene | WorkerDiedError], None, None]:
    """Each task with its scene, or why there is none, in the order in which they end.

    Closing the iterator ends all processes. Raises InputError where a scene cannot be set up.
    """
    count = min(config.workers or joblib.cpu_count(), len(tasks))
    processes = [WorkerProcess() for _ in range(count)]
    idle: SimpleQueue[WorkerProcess] = SimpleQueue()
    for process in processes:
        idle.put(process)

    def run(task: SceneTask) -> ClearedScene | InputError | WorkerDiedError:
        process = idle.get()
        try:
            return process.call(clear, task, config)  # type: ignore[no-any-return]
        except WorkerDiedError as error:
            return error
        finally:
            idle.put(process)

    threads = ThreadPoolExecutor(max(1, count))
    try:
        waiting = {threads.submit(run, task): task for task in tasks}
        for future in as_completed(waiting):
            result = future.result()
            if isinstance(result, InputError):
                raise result
            yield waiting[future], result
    finally:
        for process in processes:
            process.kill()
        threads.shutdown(cancel_futures=True)
        for process in processes:
            process.close()


def clear(task: SceneTask, config: ClutterConfig) -> ClearedScene | InputError:
    """Arrange a scene and clear it; runs in a process of its own."""
    try:
        with limited(config.time_limit):
            bench = bench_of(config, task.folders)
            placed = arranged(task.objects, config.count, task.seed, config.arrangement)
            its, measured = bench.clear(placed, task.seed, task.filmed)
    except InputError as error:
        return error
    name = f"{config.arrangement.kind} {task.seed}"
    return ClearedScene(task.number, task.seed, task.fold, replace(its, name=name), measured)


def bench_of(config: ClutterConfig, folders: tuple[str, str]) -> Bench:
    """What rounds need, kept from scene to scene. Raises InputError for what cannot be used."""
    key = fingerprint(plain(config), folders if config.method == OURS else ())
    if key not in _benches:
        hand = load_hand(config.hand)
        known = next(iter(_benches.values()), None)  # of other folders: the hand in physics is the same
        attempts = known.attempts if known else Attempts(hand, config.episode, config.attempt, config.arrangement)
        _benches[key] = Bench(config, method_of(config, hand, folders), attempts)
    return _benches[key]


_benches: dict[str, Bench] = {}


def made_with(config: ClutterConfig, parts: Any) -> str:
    """Fingerprint of all settings that a scene depends on, of the program, and of further parts."""
    settings = {key: value for key, value in plain(config).items() if key not in NOT_OF_SCENES}
    return fingerprint(settings, versions(), code_fingerprint(__name__), parts)
