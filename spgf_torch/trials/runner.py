"""Trials of many grasps: candidates in, outcomes out, on all cores; the result does not depend on how many there are.

Workers are fresh processes (loky), never forks: a forked child that steps an inherited scene hangs.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import version

import numpy as np
import torch
from joblib import Parallel, delayed
from torch import Tensor

from spgf_torch.config import GRASP_TYPES, EpisodeConfig, SamplerConfig, plain
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.trials.candidates import sample_poses
from spgf_torch.trials.hand import Hand
from spgf_torch.trials.table import OUTCOMES, Origin, TrialTable, pose_matrix

CHUNK = 50  # candidates a task: a few seconds at most, so that all workers end together
VERSIONS = ("sapien", "trimesh", "numpy", "python-fcl", "embreex", "pytorch-kinematics")


@dataclass(frozen=True)
class Trials:
    """How trials are run: the hand and the settings of an episode."""

    hand: Hand
    episode: EpisodeConfig


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

    Each object's random stream follows from `seed` and its name alone. `workers` processes, 0 = one a core.
    `progress(name, done)` is called whenever `done` more candidates of an object have ended.
    """
    poses = {obj.name: [_poses(obj, sampler, candidates, seed, kind) for kind in GRASP_TYPES] for obj in objects}
    requests = [
        (obj, kind, pose_matrix(*poses[obj.name][index])) for obj in objects for index, kind in enumerate(GRASP_TYPES)
    ]
    outcomes = execute(requests, trials, workers, progress)
    for obj in objects:
        position, quaternion = (torch.cat(parts) for parts in zip(*poses[obj.name], strict=True))
        yield TrialTable(
            origin=origin(obj, trials, sampler, candidates, seed),
            position=position,
            quaternion=quaternion,
            grasp_type=torch.arange(len(GRASP_TYPES)).repeat_interleave(candidates),
            outcome=torch.cat([next(outcomes) for _ in GRASP_TYPES]),
            versions={name: version(name) for name in VERSIONS},
        )


def execute(
    requests: Iterable[tuple[GraspObject, str, Tensor]],
    trials: Trials,
    workers: int = 0,
    progress: Callable[[str, int], None] = lambda name, done: None,
) -> Iterator[Tensor]:
    """For each (object, grasp type, T_object_tcp (M, 4, 4)) the outcomes (M,) int64, codes into `OUTCOMES`."""
    cases = [
        (_Case(f"{o.digest} {trials.hand.digest} {trials.episode}", kind, o, trials), T) for o, kind, T in requests
    ]
    chunks = [
        (index, case, T[first : first + CHUNK].numpy())
        for index, (case, T) in enumerate(cases)
        for first in range(0, len(T), CHUNK)
    ]
    parallel = Parallel(n_jobs=workers or -1, return_as="generator", pre_dispatch="3*n_jobs")
    results = parallel(delayed(_run_chunk)(case, T) for _, case, T in chunks)
    outcomes: list[list[int]] = [[] for _ in cases]
    ended = 0
    for (index, case, T), codes in zip(chunks, results, strict=True):
        for codes_of_case in outcomes[ended:index]:
            yield torch.tensor(codes_of_case, dtype=torch.int64)
        ended = index
        outcomes[index] += codes
        progress(case.obj.name, len(T))
    for codes_of_case in outcomes[ended:]:
        yield torch.tensor(codes_of_case, dtype=torch.int64)


def _poses(obj: GraspObject, sampler: SamplerConfig, count: int, seed: int, kind: str) -> tuple[Tensor, Tensor]:
    rng = np.random.default_rng([seed, zlib.crc32(f"{obj.name}/{kind}".encode())])
    return sample_poses(obj, count, sampler, rng)


@dataclass(frozen=True)
class _Case:
    """One object and grasp type, under one hand and episode; `digests` stands for all that is not compared."""

    digests: str
    kind: str
    obj: GraspObject = field(compare=False)
    trials: Trials = field(compare=False)


def _run_chunk(case: _Case, T_object_tcp: np.ndarray) -> list[int]:
    attempt = _attempt(case)
    return [OUTCOMES.index(attempt(T)) for T in T_object_tcp]


@lru_cache(maxsize=2)
def _attempt(case: _Case) -> Callable[[np.ndarray], str]:
    """Pre-check, then the episode; what both prepare is kept by the worker for the chunks to come."""
    from spgf_torch.trials.episode import Simulator  # a parent of workers never steps a scene: no need of SAPIEN
    from spgf_torch.trials.precheck import PreCheck

    check = PreCheck(case.obj, case.trials.hand.preshapes[case.kind])
    simulator = Simulator(case.obj, case.trials.hand, case.trials.episode)
    return lambda T: "collision" if check.collides(T) else simulator.run(T, case.kind)
