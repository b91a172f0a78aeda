"""Trials that are kept as soon as they have ended: the same call, cut off by whatever, runs only what is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import torch
from torch import Tensor

from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.errors import IncompleteError
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import plain
from spgf_torch.simulation.execute import TrialError, Trials, execute_words, versions
from spgf_torch.simulation.executors import Executor
from spgf_torch.simulation.worker import physics

# Of entries of the cache.
KIND = "endings"
# Object, grasp type, T_object_tcp (M, 4, 4).
Request = tuple[GraspObject, str, Tensor]


def tried(
    requests: Sequence[Request],
    trials: Trials,
    executor: Callable[[], Executor],
    cache: Cache,
    progress: Callable[[int], None] = lambda done: None,
) -> list[list[str]]:
    """For each request how each grasp ended, words of `label.Label`; `executor` is called if any is new.

    What a request came to is kept in `cache` when it is known. Raises IncompleteError where a trial has no outcome.
    """
    common = (trials.hand.digest, plain(trials.episode), versions(), code_fingerprint(physics.__module__))
    keys = [fingerprint(obj.digest, kind, T, *common) for obj, kind, T in requests]

    def again(request: Request) -> dict[str, Tensor]:
        """Of one whose entry is damaged."""
        return _packed(next(execute_words([request], trials, executor())))

    found: dict[str, list[str]] = {}
    for key, request in zip(keys, requests, strict=True):
        if cache.holds(KIND, key):
            found[key] = _words(cache.tensors(KIND, key, partial(again, request)))
            progress(len(request[2]))
    missing = [(key, request) for key, request in zip(keys, requests, strict=True) if key not in found]
    if not missing:
        return [found[key] for key in keys]
    ended = execute_words([request for _, request in missing], trials, executor(), lambda _, done: progress(done))
    try:
        for (key, _), words in zip(missing, ended, strict=True):
            found[key] = _words(cache.tensors(KIND, key, partial(_packed, words)))
    except TrialError as error:
        kept = "the same call goes on from there" if cache.folder else "cache=FOLDER would have kept what had ended"
        raise IncompleteError(f"a trial without an outcome: {error}; {kept}") from error
    return [found[key] for key in keys]


def _packed(words: Sequence[str]) -> dict[str, Tensor]:
    """Words without line breaks as an entry of the cache, which holds tensors."""
    return {
        "ended": torch.frombuffer(bytearray("".join(f"{word}\n" for word in ["", *words]).encode()), dtype=torch.uint8)
    }


def _words(entry: Mapping[str, Tensor]) -> list[str]:
    return entry["ended"].numpy().tobytes().decode().split("\n")[1:-1]
