"""Trials of many grasps: candidates in, outcomes out, on all cores; the result does not depend on how many there are.

Workers are fresh processes (loky), never forks: a forked child that steps an inherited scene hangs.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
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
    requests = list(requests)
    chunks = [
        (index, obj, kind, T[first : first + CHUNK].numpy())
        for index, (obj, kind, T) in enumerate(requests)
        for first in range(0, len(T), CHUNK)
    ]
    for obj, _, _ in requests:
        obj.digest  # noqa: B018  computed once here, it travels with the object and names it in the workers
    parallel = Parallel(n_jobs=workers or -1, return_as="generator", pre_dispatch="3*n_jobs")
    results = parallel(delayed(_run_chunk)(obj, kind, T, trials) for _, obj, kind, T in chunks)
    done: list[list[int]] = [[] for _ in requests]
    current = 0
    for (index, obj, _, T), codes in zip(chunks, results, strict=True):
        while current < index:
            yield torch.tensor(done[current], dtype=torch.int64)
            current += 1
        done[index] += codes
        progress(obj.name, len(T))
    for rest in done[current:]:
        yield torch.tensor(rest, dtype=torch.int64)


def _poses(obj: GraspObject, sampler: SamplerConfig, count: int, seed: int, kind: str) -> tuple[Tensor, Tensor]:
    rng = np.random.default_rng([seed, zlib.crc32(f"{obj.name}/{kind}".encode())])
    return sample_poses(obj, count, sampler, rng)


def _run_chunk(obj: GraspObject, kind: str, T_object_tcp: np.ndarray, trials: Trials) -> list[int]:
    tester = _tester(obj.digest, kind, trials.hand.digest, repr(trials.episode), _Payload(obj, trials))
    return [OUTCOMES.index(tester(T)) for T in T_object_tcp]


class _Payload:
    """What a tester is made from, invisible to the cache's key (the digests before it are the key)."""

    def __init__(self, obj: GraspObject, trials: Trials) -> None:
        self.obj, self.trials = obj, trials

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Payload)

    def __hash__(self) -> int:
        return 0


@lru_cache(maxsize=2)
def _tester(digest: str, kind: str, hand: str, episode: str, payload: _Payload) -> Callable[[np.ndarray], str]:
    """Pre-check, then the episode, of one object and grasp type; kept by the worker for the chunks to come."""
    from spgf_torch.trials.episode import Simulator  # the parent never steps a scene, so it need not load SAPIEN
    from spgf_torch.trials.precheck import PreCheck

    check = PreCheck(payload.obj, payload.trials.hand.preshapes[kind])
    simulator = Simulator(payload.obj, payload.trials.hand, payload.trials.episode)
    return lambda T: "collision" if check.collides(T) else simulator.run(T, kind)
