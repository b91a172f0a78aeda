"""Trials of many grasps: candidates in, outcomes out, on all cores; how many these are does not change the result."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import plain, typed
from spgf_torch.simulation.attempts import Case, Ended, Trials
from spgf_torch.simulation.candidates import sample_poses
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.executors import Runner, Task, runner_of
from spgf_torch.simulation.table import OUTCOMES, Origin, TrialTable, pose_matrix

CHUNK = 50  # candidates a task: a few seconds at most, so that all workers end together
VERSIONS = ("sapien", "trimesh", "numpy", "python-fcl", "embreex", "pytorch-kinematics")


class TrialError(RuntimeError):
    """A trial that has no outcome: whose, and why."""


def origin(obj: GraspObject, trials: Trials, sampler: SamplerConfig, candidates: int, seed: int) -> Origin:
    """What `simulate` would note as the origin of this object's table."""
    return Origin(
        object_name=obj.name,
        object_digest=obj.digest,
        hand_digest=trials.hand.digest,
        sampler=plain(sampler),
        episode=plain(trials.episode),
        candidates=candidates,
        seed=seed,
    )


def made_with(trials: Trials, sampler: SamplerConfig, candidates: int, seed: int) -> dict[str, Any]:
    """What all tables of one call have in common: an origin but for the object, and the versions of packages."""
    common = {
        "hand_digest": trials.hand.digest,
        "sampler": plain(sampler),
        "episode": plain(trials.episode),
        "candidates": candidates,
        "seed": seed,
    }
    return {**common, "versions": versions()}


@dataclass(frozen=True)
class Poses:
    """The candidates of one object, by row of its table: those of each grasp type, one type after the other.

    Attributes:
        position: (M, 3) float32, m, and
        quaternion: (M, 4) float32 wxyz of T_object_tcp.
    """

    position: Tensor
    quaternion: Tensor

    def T_object_tcp(self, first: int, end: int) -> np.ndarray:  # noqa: N802
        """(end - first, 4, 4) float32 of these rows."""
        return pose_matrix(self.position[first:end], self.quaternion[first:end]).numpy()


def sample(obj: GraspObject, origin: Origin) -> Poses:
    """The candidates of an object: its random stream follows from the seed and its name alone."""
    sampler = typed(SamplerConfig, origin.sampler)
    parts = []
    for kind in GRASP_TYPES:
        rng = np.random.default_rng([origin.seed, zlib.crc32(f"{obj.name}/{kind}".encode())])
        parts.append(sample_poses(obj, origin.candidates, sampler, rng))
    return Poses(*(torch.cat(columns) for columns in zip(*parts, strict=True)))


def table_of(origin: Origin, poses: Poses, outcome: Tensor) -> TrialTable:
    """The table of an object: its candidates and their outcomes (M,) int64."""
    return TrialTable(
        origin=origin,
        position=poses.position,
        quaternion=poses.quaternion,
        grasp_type=torch.arange(len(GRASP_TYPES)).repeat_interleave(origin.candidates),
        outcome=outcome,
        versions=versions(),
    )


def versions() -> dict[str, str]:
    """Of the packages that outcomes depend on."""
    return {name: version(name) for name in VERSIONS}


def simulate(
    objects: Sequence[GraspObject],
    trials: Trials,
    sampler: SamplerConfig,
    candidates: int,
    seed: int,
    workers: int = 0,
    progress: Callable[[str, int], None] = lambda name, done: None,
) -> Iterator[TrialTable]:
    """The table of each object, in order: `candidates` grasps of each type, sampled and executed.

    Nothing is written; what survives being cut off is a `campaign`. `workers` and `progress` as for `execute`.
    """
    origins = [origin(obj, trials, sampler, candidates, seed) for obj in objects]
    poses = [sample(*pair) for pair in zip(objects, origins, strict=True)]
    requests = [
        (obj, kind, torch.from_numpy(its.T_object_tcp(index * candidates, (index + 1) * candidates)))
        for obj, its in zip(objects, poses, strict=True)
        for index, kind in enumerate(GRASP_TYPES)
    ]
    outcomes = execute(requests, trials, workers, progress)
    for its_origin, its_poses in zip(origins, poses, strict=True):
        yield table_of(its_origin, its_poses, torch.cat([next(outcomes) for _ in GRASP_TYPES]))


def execute(
    requests: Iterable[tuple[GraspObject, str, Tensor]],
    trials: Trials,
    workers: int | Runner = 0,
    progress: Callable[[str, int], None] = lambda name, done: None,
) -> Iterator[Tensor]:
    """For each (object, grasp type, T_object_tcp (M, 4, 4)) the outcomes (M,) int64, codes into `OUTCOMES`.

    `workers` processes, 0 = one a core, 1 = this one; or whatever runs them. `progress(name, done)` is called whenever
    `done` more candidates of an object have ended. Raises TrialError where one has no outcome.
    """
    cases = [(Case.of(obj, trials, kind), T.numpy()) for obj, kind, T in requests]
    tasks = [
        Task((index, first), case, T[first : first + CHUNK])
        for index, (case, T) in enumerate(cases)
        for first in range(0, len(T), CHUNK)
    ]
    runner = runner_of(workers) if isinstance(workers, int) else workers
    outcomes: list[list[str | None]] = [[] for _ in cases]
    ended = 0
    for task, result in _in_order(runner, tasks):
        index, _ = task.name
        for words in outcomes[ended:index]:
            yield codes(words)
        ended = index
        outcomes[index] += _complete(task, result).outcomes
        progress(task.case.obj.name, len(result.outcomes))
    for words in outcomes[ended:]:
        yield codes(words)


def codes(outcomes: Sequence[str | None]) -> Tensor:
    """(M,) int64: the index of each into `OUTCOMES`."""
    return torch.tensor([OUTCOMES.index(word) for word in outcomes if word], dtype=torch.int64)


def _in_order(runner: Runner, tasks: Sequence[Task]) -> Iterator[tuple[Task, Ended]]:
    """As they were given, whatever the order in which they end."""
    early: dict[int, Ended] = {}
    numbers = {task.name: number for number, task in enumerate(tasks)}
    turn = 0
    with closing(runner.run(tasks)) as results:  # type: ignore[type-var]
        for task, ended in results:
            early[numbers[task.name]] = ended
            while turn in early:
                yield tasks[turn], early.pop(turn)
                turn += 1


def _complete(task: Task, ended: Ended) -> Ended:
    reason = ended.unbuilt or next(iter(ended.reasons.values()), "")
    if reason:
        raise TrialError(f"{task.case.obj.name} {task.case.kind}: {reason}")
    return ended
