"""Trials that are kept as soon as they have ended: the same call, cut off by whatever, runs only what is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from torch import Tensor

from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.errors import IncompleteError
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import plain
from spgf_torch.simulation.execute import TrialError, Trials, execute, versions
from spgf_torch.simulation.executors import Executor
from spgf_torch.simulation.worker import physics

# Of entries of the cache.
KIND = "outcomes"
# Object, grasp type, T_object_tcp (M, 4, 4).
Request = tuple[GraspObject, str, Tensor]


def tried(
    requests: Sequence[Request],
    trials: Trials,
    executor: Callable[[], Executor],
    cache: Cache,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Tensor]:
    """For each request the outcomes (M,) int64, codes into `trials.table.OUTCOMES`; `executor` is called if any is new.

    The outcomes of a request are kept in `cache` when they are known. Raises IncompleteError where a trial has none.
    """
    common = (trials.hand.digest, plain(trials.episode), versions(), code_fingerprint(physics.__module__))
    keys = [fingerprint(obj.digest, kind, T, *common) for obj, kind, T in requests]

    def again(request: Request) -> dict[str, Tensor]:
        """Of one whose entry is damaged."""
        return {"outcome": next(execute([request], trials, executor()))}

    found: dict[str, Tensor] = {}
    for key, request in zip(keys, requests, strict=True):
        if cache.holds(KIND, key):
            found[key] = cache.tensors(KIND, key, partial(again, request))["outcome"]
            progress(len(request[2]))
    missing = [(key, request) for key, request in zip(keys, requests, strict=True) if key not in found]
    if not missing:
        return [found[key] for key in keys]
    outcomes = execute([request for _, request in missing], trials, executor(), lambda _, done: progress(done))
    try:
        for (key, _), codes in zip(missing, outcomes, strict=True):
            found[key] = cache.tensors(KIND, key, partial(dict, outcome=codes))["outcome"]
    except TrialError as error:
        kept = "the same call goes on from there" if cache.folder else "cache=FOLDER would have kept what had ended"
        raise IncompleteError(f"a trial without an outcome: {error}; {kept}") from error
    return [found[key] for key in keys]
