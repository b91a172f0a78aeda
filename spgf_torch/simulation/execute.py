"""Trials of many grasps: candidates in, outcomes out, on all cores; how many these are does not change the result."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.geometry.ray_scenes import forget_scene
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import plain, settings
from spgf_torch.simulation.candidates import sample_poses
from spgf_torch.simulation.causes import Causes, has_causes
from spgf_torch.simulation.config import APPROACH, SamplerConfig
from spgf_torch.simulation.executors import Executor, Task, executor_of
from spgf_torch.simulation.label import Label, outcome_of
from spgf_torch.simulation.table import OUTCOMES, Provenance, TrialTable, pose_matrix
from spgf_torch.simulation.worker import Case, ChunkResult, TrialMaker, Trials, physics

CHUNK = 50  # candidates a task: a few seconds at most, so that all workers end together
VERSIONS = ("sapien", "trimesh", "numpy", "python-fcl", "embreex", "pytorch-kinematics")


class TrialError(RuntimeError):
    """A trial that has no outcome: whose, and why."""


def provenance_of(
    obj: GraspObject, trials: Trials, sampler: SamplerConfig, candidates: int, seed: int, budget: int | None = None
) -> Provenance:
    """Return the provenance of the table that `simulate` makes of this object."""
    return Provenance(
        object_name=obj.name,
        object_digest=obj.digest,
        hand_digest=trials.hand.digest,
        sampler=_settings_of(sampler, trials),
        episode=plain(trials.episode),
        candidates=candidates,
        seed=seed,
        budget=budget,
    )


def made_with(
    trials: Trials, sampler: SamplerConfig, candidates: int, seed: int, budget: int | None = None
) -> dict[str, Any]:
    """Return what all tables of one call share: provenance without the object, and versions of packages."""
    common = {
        "hand_digest": trials.hand.digest,
        "sampler": _settings_of(sampler, trials),
        "episode": plain(trials.episode),
        "candidates": candidates,
        "seed": seed,
    }
    return {**common, **({} if budget is None else {"budget": budget}), "versions": versions()}


def _settings_of(sampler: SamplerConfig, trials: Trials) -> dict[str, Any]:
    """Return the settings of the samplers that the hand uses: tables do not depend on those of others."""
    own = plain(sampler)
    if APPROACH not in trials.samplers.values():
        del own["depth"]
    return own


@dataclass(frozen=True)
class Poses:
    """The candidates of one object, by row of its table: those of each grasp type, one type after the other.

    Attributes:
        position: (M, 3) float32, m, and
        quaternion: (M, 4) float32 wxyz of T_object_tcp.
        grasp_types: names of the hand's grasp types, in this order.
    """

    position: Tensor
    quaternion: Tensor
    grasp_types: tuple[str, ...]

    def T_object_tcp(self, first: int, end: int) -> np.ndarray:  # noqa: N802
        """(end - first, 4, 4) float32 of these rows."""
        return pose_matrix(self.position[first:end], self.quaternion[first:end]).numpy()

    @property
    def grasp_type(self) -> Tensor:
        """(M,) int64, index into `grasp_types`."""
        types = len(self.grasp_types)
        return torch.arange(types).repeat_interleave(len(self) // types)

    def __len__(self) -> int:
        """How many candidates, of all types."""
        return len(self.position)

    def first(self, count: int) -> Poses:
        """The first `count` candidates of each type."""
        types = len(self.grasp_types)
        position, quaternion = (
            column.unflatten(0, (types, -1))[:, :count].flatten(0, 1) for column in (self.position, self.quaternion)
        )
        return Poses(position, quaternion, self.grasp_types)


def sample(obj: GraspObject, provenance: Provenance, samplers: Mapping[str, str]) -> Poses:
    """Sample the candidates of an object, of each grasp type by its sampler (`config.samplers_of`).

    The random stream of a type follows from the seed, the object's name and the type's alone.
    """
    config = settings(SamplerConfig, **provenance.sampler)
    parts = []
    for grasp_type, sampler in samplers.items():
        rng = np.random.default_rng([provenance.seed, zlib.crc32(f"{obj.name}/{grasp_type}".encode())])
        parts.append(sample_poses(obj, provenance.candidates, config, rng, sampler))
    forget_scene(obj.mesh)
    position, quaternion = (torch.cat(columns) for columns in zip(*parts, strict=True))
    return Poses(position, quaternion, tuple(samplers))


def table_of(provenance: Provenance, poses: Poses, outcome: Tensor, causes: Causes | None = None) -> TrialTable:
    """Make the table of an object from its candidates and their outcomes (M,) int64."""
    return TrialTable(
        provenance=provenance,
        position=poses.position,
        quaternion=poses.quaternion,
        grasp_type=poses.grasp_type,
        outcome=outcome,
        versions=versions(),
        grasp_types=poses.grasp_types,
        causes=causes,
    )


def ended_table(provenance: Provenance, poses: Poses, ended: Sequence[str]) -> TrialTable:
    """Make the table of an object from its candidates and how each ended (`label.Label`)."""
    causes = Causes.of([Label.of(word) for word in ended]) if has_causes(provenance.episode) else None
    return table_of(provenance, poses, codes(ended), causes)


def versions() -> dict[str, str]:
    """Return the versions of the packages that outcomes depend on."""
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
    """Yield the table of each object, in order: `candidates` grasps of each type, sampled and executed.

    Nothing is written; `generation.Generation` survives being cut off. `workers` and `progress` as for `execute`.
    """
    provenances = [provenance_of(obj, trials, sampler, candidates, seed) for obj in objects]
    poses = [sample(*pair, trials.samplers) for pair in zip(objects, provenances, strict=True)]
    requests = [
        (obj, grasp_type, torch.from_numpy(its.T_object_tcp(index * candidates, (index + 1) * candidates)))
        for obj, its in zip(objects, poses, strict=True)
        for index, grasp_type in enumerate(trials.grasp_types)
    ]
    ended = execute_words(requests, trials, workers, progress)
    for its_provenance, its_poses in zip(provenances, poses, strict=True):
        yield ended_table(its_provenance, its_poses, [word for _ in trials.grasp_types for word in next(ended)])


def execute(
    requests: Iterable[tuple[GraspObject, str, Tensor]],
    trials: Trials,
    workers: int | Executor = 0,
    progress: Callable[[str, int], None] = lambda name, done: None,
    make: TrialMaker = physics,
) -> Iterator[Tensor]:
    """Yield for each (object, grasp type, T_object_tcp (M, 4, 4)) the outcomes (M,) int64, codes into `OUTCOMES`.

    Arguments and errors as of `execute_words`.
    """
    for words in execute_words(requests, trials, workers, progress, make):
        yield codes(words)


def execute_words(
    requests: Iterable[tuple[GraspObject, str, Tensor]],
    trials: Trials,
    workers: int | Executor = 0,
    progress: Callable[[str, int], None] = lambda name, done: None,
    make: TrialMaker = physics,
) -> Iterator[list[str]]:
    """Yield for each (object, grasp type, T_object_tcp (M, 4, 4)) how each grasp ended: words of `label.Label`.

    `workers`: processes, 0 = one a core, 1 = this one; or an executor. `progress(name, done)` is called whenever
    `done` more candidates of an object have ended. `make` makes the trials, in SAPIEN by default. Raises
    TrialError where one has no outcome.
    """
    cases = [(Case.of(obj, trials, grasp_type, make), T.numpy()) for obj, grasp_type, T in requests]
    tasks = [
        Task((index, first), case, T[first : first + CHUNK])
        for index, (case, T) in enumerate(cases)
        for first in range(0, len(T), CHUNK)
    ]
    executor = executor_of(workers) if isinstance(workers, int) else workers
    outcomes: list[list[str]] = [[] for _ in cases]
    ended = 0
    for task, result in _in_order(executor, tasks):
        index, _ = task.name
        yield from outcomes[ended:index]
        ended = index
        outcomes[index] += _complete(task, result)
        progress(task.case.obj.name, len(result.outcomes))
    yield from outcomes[ended:]


def codes(outcomes: Sequence[str | None]) -> Tensor:
    """Return (M,) int64, the index in `OUTCOMES` of how each ended."""
    return torch.tensor([OUTCOMES.index(outcome_of(word)) for word in outcomes if word], dtype=torch.int64)


def _in_order(executor: Executor, tasks: Sequence[Task]) -> Iterator[tuple[Task, ChunkResult]]:
    """Run tasks and yield their results in the order of the tasks, whatever the order in which they end."""
    early: dict[int, ChunkResult] = {}
    numbers = {task.name: number for number, task in enumerate(tasks)}
    next_up = 0
    with closing(executor.run(tasks)) as results:  # type: ignore[type-var]
        for task, ended in results:
            early[numbers[task.name]] = ended
            while next_up in early:
                yield tasks[next_up], early.pop(next_up)
                next_up += 1


def _complete(task: Task, ended: ChunkResult) -> list[str]:
    reason = ended.unbuilt or next(iter(ended.reasons.values()), "")
    if reason:
        raise TrialError(f"{task.case.obj.name} {task.case.grasp_type}: {reason}")
    return [word for word in ended.outcomes if word]
